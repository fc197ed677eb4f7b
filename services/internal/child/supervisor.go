package child

import (
	"bytes"
	"context"
	"fmt"
	"log/slog"
	"os/exec"
	"runtime"
	"sync"
	"syscall"
	"time"
)

// Supervisor keeps one worker process running.
type Supervisor struct {
	// Program and Arguments of the worker.
	Program   string
	Arguments []string
	// Logger gets the worker's output line by line, and its ends and restarts.
	Logger *slog.Logger
	// GiveUpAfter so many ends in a row that came within Settled of the start; 0: never.
	GiveUpAfter int
	// Settled is how long a worker must live to count as healthy; 0: 5 s.
	Settled time.Duration
	// Backoff is the first pause before a restart; it doubles up to 64 times that. 0: 250 ms.
	Backoff time.Duration
	// Grace is how long a worker has between SIGTERM and SIGKILL; 0: 5 s.
	Grace time.Duration
}

const (
	defaultSettled   = 5 * time.Second
	defaultBackoff   = 250 * time.Millisecond
	defaultGrace     = 5 * time.Second
	maxBackoffFactor = 64
)

// Run starts the worker and starts it again whenever it ends, until ctx ends (then it returns nil,
// with the worker gone) or it gives up.
func (s *Supervisor) Run(ctx context.Context) error {
	settled, backoff := or(s.Settled, defaultSettled), or(s.Backoff, defaultBackoff)
	pause, failures := backoff, 0
	for {
		start := time.Now()
		lastWords, err := s.runOnce(ctx)
		if ctx.Err() != nil {
			return nil
		}
		if time.Since(start) >= settled {
			pause, failures = backoff, 0
		}
		failures++
		if s.GiveUpAfter > 0 && failures >= s.GiveUpAfter {
			return fmt.Errorf("the local worker ended %d times in a row (%s): %s", failures, ending(err), lastWords)
		}
		s.Logger.Warn("local worker ended; starting it again",
			slog.String("ending", ending(err)), slog.Duration("pause", pause))
		select {
		case <-ctx.Done():
			return nil
		case <-time.After(pause):
		}
		pause = min(2*pause, maxBackoffFactor*backoff)
	}
}

// runOnce returns the worker's last line of output and how it ended.
func (s *Supervisor) runOnce(ctx context.Context) (string, error) {
	// The kernel kills the child when the thread that started it ends, so this goroutine keeps its
	// thread until the child is gone.
	runtime.LockOSThread()
	defer runtime.UnlockOSThread()
	command := exec.CommandContext(ctx, s.Program, s.Arguments...)
	command.Cancel = func() error { return command.Process.Signal(syscall.SIGTERM) }
	command.WaitDelay = or(s.Grace, defaultGrace)
	command.SysProcAttr = &syscall.SysProcAttr{
		Pdeathsig: syscall.SIGKILL,
		Setpgid:   true, // Ctrl-C is for us; we tell the worker
	}
	output := &lineLogger{logger: s.Logger}
	command.Stdout, command.Stderr = output, output
	err := command.Run()
	return output.last(), err
}

func ending(err error) string {
	if err == nil {
		return "exit status 0"
	}
	return err.Error()
}

func or(value, otherwise time.Duration) time.Duration {
	if value == 0 {
		return otherwise
	}
	return value
}

// lineLogger logs what is written to it line by line.
type lineLogger struct {
	logger  *slog.Logger
	mutex   sync.Mutex
	pending []byte
	line    string
}

const longestLine = 4096

func (l *lineLogger) Write(p []byte) (int, error) {
	l.mutex.Lock()
	defer l.mutex.Unlock()
	l.pending = append(l.pending, p...)
	for {
		end := bytes.IndexByte(l.pending, '\n')
		if end < 0 && len(l.pending) > longestLine {
			end = longestLine
		}
		if end < 0 {
			return len(p), nil
		}
		l.line = string(bytes.TrimRight(l.pending[:end], "\r\n"))
		l.pending = l.pending[min(end+1, len(l.pending)):]
		l.logger.Info("local worker", slog.String("line", l.line))
	}
}

func (l *lineLogger) last() string {
	l.mutex.Lock()
	defer l.mutex.Unlock()
	if len(l.pending) > 0 {
		return string(l.pending)
	}
	return l.line
}

// Group runs several supervisors and waits for them.
type Group struct {
	cancel context.CancelFunc
	wait   sync.WaitGroup
	failed chan error
}

// Start runs supervisors in the background until Stop.
func Start(ctx context.Context, supervisors ...*Supervisor) *Group {
	ctx, cancel := context.WithCancel(ctx)
	group := &Group{cancel: cancel, failed: make(chan error, len(supervisors))}
	for _, supervisor := range supervisors {
		group.wait.Go(func() {
			if err := supervisor.Run(ctx); err != nil {
				group.failed <- err
			}
		})
	}
	return group
}

// Failed delivers the error of each supervisor that gave up; it is closed by Stop.
func (g *Group) Failed() <-chan error { return g.failed }

// Stop ends the workers and returns when they are gone.
func (g *Group) Stop() {
	g.cancel()
	g.wait.Wait()
	close(g.failed)
}
