// Package s3test runs a real S3 server (versitygw on a temporary directory) for tests.
package s3test

import (
	"context"
	"fmt"
	"net"
	"net/http"
	"os"
	"os/exec"
	"path/filepath"
	"strconv"
	"sync/atomic"
	"testing"
	"time"

	"github.com/minio/minio-go/v7"
	"github.com/minio/minio-go/v7/pkg/credentials"

	"metrofarm/services/internal/blob/s3"
)

const (
	program = "versitygw"
	rootKey = "root-access-key"
	secret  = "a-secret-of-tests"
	// Region of the server.
	Region = "us-east-1"
	// startTimeout is long: the machine may be busy.
	startTimeout = 30 * time.Second
)

// Server is an S3 server that can be killed and come back.
type Server struct {
	t       *testing.T
	dir     string
	port    int
	process *exec.Cmd
	buckets atomic.Int64
}

// Start starts a server that ends with the test. Without the program the test is skipped.
func Start(t *testing.T) *Server {
	t.Helper()
	if _, err := exec.LookPath(program); err != nil {
		t.Skipf("no S3 server to test with: %s is not on PATH; tests/setup/setup.sh test builds it", program)
	}
	s := &Server{t: t, dir: t.TempDir(), port: freePort(t)}
	for _, folder := range []string{"buckets", "metadata", "users"} {
		s.check(os.Mkdir(filepath.Join(s.dir, folder), 0o700))
	}
	s.Restart()
	t.Cleanup(s.Kill)
	return s
}

func freePort(t *testing.T) int {
	t.Helper()
	l, err := net.Listen("tcp", "127.0.0.1:0")
	if err != nil {
		t.Fatal(err)
	}
	defer l.Close()
	return l.Addr().(*net.TCPAddr).Port
}

func (s *Server) check(err error) {
	s.t.Helper()
	if err != nil {
		s.t.Fatalf("S3 server: %v", err)
	}
}

// Endpoint is the server's URL.
func (s *Server) Endpoint() string { return "http://127.0.0.1:" + strconv.Itoa(s.port) }

// Restart starts the server on what it kept, and waits until it answers.
func (s *Server) Restart() {
	s.t.Helper()
	log, err := os.OpenFile(filepath.Join(s.dir, "log"), os.O_CREATE|os.O_APPEND|os.O_WRONLY, 0o600)
	s.check(err)
	defer log.Close()
	s.process = exec.Command(program, "--port", fmt.Sprintf("127.0.0.1:%d", s.port), "--region", Region,
		"--iam-dir", filepath.Join(s.dir, "users"), "--health", "/health", "--quiet",
		"posix", "--sidecar", filepath.Join(s.dir, "metadata"), filepath.Join(s.dir, "buckets"))
	s.process.Env = append(os.Environ(), "ROOT_ACCESS_KEY="+rootKey, "ROOT_SECRET_KEY="+secret)
	s.process.Stdout, s.process.Stderr = log, log
	s.check(s.process.Start())
	for end := time.Now().Add(startTimeout); ; time.Sleep(20 * time.Millisecond) {
		if s.answers() {
			return
		}
		if time.Now().After(end) {
			output, _ := os.ReadFile(log.Name())
			s.t.Fatalf("the S3 server does not answer; it says: %s", output)
		}
	}
}

func (s *Server) answers() bool {
	response, err := http.Get(s.Endpoint() + "/health")
	if err != nil {
		return false
	}
	_ = response.Body.Close()
	return response.StatusCode == http.StatusOK
}

// Kill ends the server at once. Killing a dead one does nothing.
func (s *Server) Kill() {
	if s.process == nil {
		return
	}
	_ = s.process.Process.Kill()
	_ = s.process.Wait() // it was killed, and says so
	s.process = nil
}

// Client speaks to the server as its root user, around package s3.
func (s *Server) Client() *minio.Client {
	s.t.Helper()
	client, err := minio.New(fmt.Sprintf("127.0.0.1:%d", s.port), &minio.Options{
		Creds: credentials.NewStaticV4(rootKey, secret, ""), Region: Region,
	})
	s.check(err)
	return client
}

// Bucket makes a new bucket and returns what opens it.
func (s *Server) Bucket() s3.Options {
	s.t.Helper()
	o := s3.Options{
		Bucket: fmt.Sprintf("bucket-%d", s.buckets.Add(1)), Prefix: "farm/one", Endpoint: s.Endpoint(), Region: Region,
		SpoolDir: s.t.TempDir(), Credentials: s3.Credentials{AccessKey: rootKey, SecretKey: secret},
	}
	s.check(s.Client().MakeBucket(s.t.Context(), o.Bucket, minio.MakeBucketOptions{Region: Region}))
	return o
}

// User makes a user who may not use the buckets of others.
func (s *Server) User(ctx context.Context, name string) s3.Credentials {
	s.t.Helper()
	output, err := exec.CommandContext(ctx, program, "admin", "--access", rootKey, "--secret", secret,
		"--endpoint-url", s.Endpoint(), "--region", Region,
		"create-user", "--access", name, "--secret", secret, "--role", "user").CombinedOutput()
	if err != nil {
		s.t.Fatalf("S3 server: create user: %v: %s", err, output)
	}
	return s3.Credentials{AccessKey: name, SecretKey: secret}
}
