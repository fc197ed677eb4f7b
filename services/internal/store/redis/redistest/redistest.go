// Package redistest runs a real redis-server for tests, with an append-only file that is synced with
// every write, so that it can be killed and started again.
package redistest

import (
	"context"
	"errors"
	"os"
	"os/exec"
	"path/filepath"
	"strconv"
	"syscall"
	"testing"
	"time"

	goredis "github.com/redis/go-redis/v9"
)

const startTimeout = 20 * time.Second

// Server is a redis-server on a socket in a directory of its own.
type Server struct {
	// URL for redis.Open.
	URL string

	t       *testing.T
	program string
	dir     string
	command *exec.Cmd
}

// Start starts a server that ends with the test. Without the program the test is skipped.
func Start(t *testing.T) *Server {
	t.Helper()
	program, err := exec.LookPath("redis-server")
	if err != nil {
		t.Skip("redis-server is not installed (Debian package redis-server): tests against a real server are skipped")
	}
	dir, err := os.MkdirTemp("", "redis-") // t.TempDir can be too long for a socket's path
	if err != nil {
		t.Fatal(err)
	}
	s := &Server{URL: "unix://" + filepath.Join(dir, "s") + "?db=0", t: t, program: program, dir: dir}
	s.Restart()
	t.Cleanup(func() {
		s.Kill()
		if err := os.RemoveAll(dir); err != nil {
			t.Error(err)
		}
	})
	return s
}

// Restart starts the server after Kill, from its append-only file.
func (s *Server) Restart() {
	s.t.Helper()
	s.command = exec.Command(s.program,
		"--port", "0", "--unixsocket", filepath.Join(s.dir, "s"), "--dir", s.dir, "--daemonize", "no",
		"--appendonly", "yes", "--appendfsync", "always", "--save", "", "--logfile", filepath.Join(s.dir, "log"))
	if err := s.command.Start(); err != nil {
		s.t.Fatal(err)
	}
	client := s.client()
	defer client.Close()
	deadline := time.Now().Add(startTimeout)
	for client.Ping(context.Background()).Err() != nil {
		if time.Now().After(deadline) {
			log, _ := os.ReadFile(filepath.Join(s.dir, "log"))
			s.t.Fatalf("redis-server does not answer: %s", log)
		}
		time.Sleep(5 * time.Millisecond)
	}
}

func (s *Server) client() *goredis.Client {
	return goredis.NewClient(&goredis.Options{Network: "unix", Addr: filepath.Join(s.dir, "s"), MaxRetries: -1})
}

// Kill kills the server with SIGKILL. A second call does nothing.
func (s *Server) Kill() {
	if s.command == nil {
		return
	}
	s.signal(syscall.SIGKILL)
	_ = s.command.Wait() // "signal: killed"
	s.command = nil
}

// Freeze stops the server's process: connections stay, answers do not come.
func (s *Server) Freeze() { s.signal(syscall.SIGSTOP) }

// Thaw lets a frozen server go on.
func (s *Server) Thaw() { s.signal(syscall.SIGCONT) }

func (s *Server) signal(signal syscall.Signal) {
	if err := s.command.Process.Signal(signal); err != nil && !errors.Is(err, os.ErrProcessDone) {
		s.t.Error(err)
	}
}

// LimitMemory sets how many bytes the server may take before it refuses what takes more; 0: no bound.
func (s *Server) LimitMemory(bytes int) {
	s.t.Helper()
	client := s.client()
	defer client.Close()
	if err := client.ConfigSet(context.Background(), "maxmemory", strconv.Itoa(bytes)).Err(); err != nil {
		s.t.Fatal(err)
	}
}
