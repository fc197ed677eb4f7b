// Package localfarm runs a whole coordinator in this process: stores in a folder, the gRPC service
// for workers, the REST interface with the dashboard, and worker processes on this machine.
package localfarm

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"net"
	"net/http"
	"os"
	"path/filepath"
	"strconv"
	"sync"
	"time"

	"github.com/prometheus/client_golang/prometheus"
	"github.com/prometheus/client_golang/prometheus/collectors"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/child"
	"metrofarm/services/internal/cli"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/farm"
	"metrofarm/services/internal/store/bolt"
)

// giveUpAfter so many early ends a worker is taken to be unable to run.
const giveUpAfter = 3

// oneJobGrace lets a worker that is idle leave by itself.
const oneJobGrace = 100 * time.Millisecond

// httpGrace is how long open requests may take when we stop.
const httpGrace = 3 * time.Second

// Farm is a running coordinator.
type Farm struct {
	options     cli.FarmOptions
	db          *bolt.Store
	library     *bundle.Library
	coordinator *coordinator.Coordinator
	farmServer  *farm.Server
	httpServer  *http.Server
	dashboard   string
	workers     *child.Group
	failed      chan error
	stopRun     context.CancelFunc
	wait        sync.WaitGroup
	runError    error
}

// Start starts everything; on failure, nothing stays running. ctx bounds the start only: a farm
// lives until Close.
func Start(ctx context.Context, options cli.FarmOptions) (*Farm, error) {
	f := &Farm{options: options, failed: make(chan error, 4)}
	if err := f.start(ctx); err != nil {
		return nil, errors.Join(err, f.Close())
	}
	return f, nil
}

func (f *Farm) start(ctx context.Context) error {
	// The database first: it holds the folder's lock, and opening the blobs clears what an earlier
	// process left half written.
	db, err := bolt.Open(filepath.Join(f.options.DataDir, "metrofarm.db"))
	if err != nil {
		return fmt.Errorf("data folder %s (used by another coordinator?): %w", f.options.DataDir, err)
	}
	f.db = db
	blobs, err := blob.Open(filepath.Join(f.options.DataDir, "blobs"))
	if err != nil {
		return err
	}
	uploads := filepath.Join(f.options.DataDir, "uploads")
	if err := errors.Join(os.RemoveAll(uploads), os.MkdirAll(uploads, 0o750)); err != nil {
		return err
	}
	f.library = bundle.NewLibrary(blobs, bundle.DefaultLimits(), uploads)
	life := context.WithoutCancel(ctx)
	f.coordinator, err = coordinator.New(life, coordinator.Options{
		Store: f.db, Blobs: blobs, Logger: f.options.Logger,
	})
	if err != nil {
		return err
	}
	running, stop := context.WithCancel(life)
	f.stopRun = stop
	f.wait.Go(func() {
		if f.runError = f.coordinator.Run(running); f.runError != nil {
			f.failed <- f.runError
		}
	})
	address, err := f.serveWorkers(ctx, blobs)
	if err != nil {
		return err
	}
	if err := f.serveHTTP(ctx); err != nil {
		return err
	}
	f.startWorkers(life, address)
	return nil
}

func (f *Farm) serveWorkers(ctx context.Context, blobs *blob.Store) (string, error) {
	listener, err := listen(ctx, f.options.FarmListen, "workers")
	if err != nil {
		return "", err
	}
	f.farmServer = farm.NewServer(farm.Options{Farm: f.coordinator, Blobs: blobs, Logger: f.options.Logger})
	f.wait.Go(func() {
		if err := f.farmServer.Serve(listener); err != nil {
			f.failed <- fmt.Errorf("serving workers: %w", err)
		}
	})
	return listener.Addr().String(), nil
}

func (f *Farm) serveHTTP(ctx context.Context) error {
	if f.options.Listen == "" {
		return nil
	}
	listener, err := listen(ctx, f.options.Listen, "the dashboard")
	if err != nil {
		return err
	}
	registry := prometheus.NewRegistry()
	registry.MustRegister(f.coordinator.Collector(), collectors.NewGoCollector(),
		collectors.NewProcessCollector(collectors.ProcessCollectorOpts{}))
	handler := api.NewHandler(api.Options{
		Service: f.coordinator, Scenes: f.library, Metrics: registry, Logger: f.options.Logger,
		LocalOnly: f.options.LocalOnly, Version: f.options.Version,
	})
	f.httpServer = api.NewHTTPServer(handler, f.options.Logger)
	f.dashboard = "http://" + listener.Addr().String() + "/"
	f.wait.Go(func() {
		if err := f.httpServer.Serve(listener); !errors.Is(err, http.ErrServerClosed) {
			f.failed <- fmt.Errorf("serving HTTP: %w", err)
		}
	})
	return nil
}

func listen(ctx context.Context, address, purpose string) (net.Listener, error) {
	listener, err := (&net.ListenConfig{}).Listen(ctx, "tcp", address)
	if err != nil {
		return nil, fmt.Errorf("listening for %s: %w", purpose, err)
	}
	return listener, nil
}

func (f *Farm) startWorkers(ctx context.Context, address string) {
	var supervisors []*child.Supervisor
	for i := range f.options.Workers {
		name := "local-" + strconv.Itoa(i+1)
		arguments := []string{
			"--coordinator", reachable(address), "--name", name,
			"--cache", filepath.Join(f.options.DataDir, "cache", name),
		}
		if f.options.Threads > 0 {
			arguments = append(arguments, "--threads", strconv.Itoa(f.options.Threads))
		}
		supervisor := &child.Supervisor{
			Program: f.options.WorkerProgram, Arguments: arguments,
			Logger: f.options.Logger.With(slog.String("worker", name)),
		}
		if f.options.OneJob {
			supervisor.GiveUpAfter, supervisor.Grace = giveUpAfter, oneJobGrace
		}
		supervisors = append(supervisors, supervisor)
	}
	f.workers = child.Start(ctx, supervisors...)
	f.wait.Go(func() {
		for err := range f.workers.Failed() {
			f.failed <- err
			return
		}
	})
}

// reachable turns an address that listens on all interfaces into one to connect to.
func reachable(address string) string {
	host, port, err := net.SplitHostPort(address)
	if ip := net.ParseIP(host); err == nil && ip != nil && ip.IsUnspecified() {
		return net.JoinHostPort("127.0.0.1", port)
	}
	return address
}

// Service runs jobs.
func (f *Farm) Service() api.Service { return f.coordinator }

// AddScene stores a scene of this machine.
func (f *Farm) AddScene(ctx context.Context, local bundle.Local) (bundle.Scene, error) {
	return f.library.AddLocal(ctx, local)
}

// Dashboard is the address of the page, "" without one.
func (f *Farm) Dashboard() string { return f.dashboard }

// Failed delivers errors that end the farm.
func (f *Farm) Failed() <-chan error { return f.failed }

// Close stops in the order in which nothing is cut off: requests, workers, their service, the
// coordinator with its last checkpoints, the store. It is safe after a failed start.
func (f *Farm) Close() error {
	var problems []error
	if f.httpServer != nil {
		ctx, cancel := context.WithTimeout(context.Background(), httpGrace)
		defer cancel()
		if f.httpServer.Shutdown(ctx) != nil { // event streams never end by themselves
			problems = append(problems, f.httpServer.Close())
		}
	}
	if f.workers != nil {
		f.workers.Stop()
	}
	if f.farmServer != nil {
		f.farmServer.Stop()
	}
	if f.stopRun != nil {
		f.stopRun()
	}
	f.wait.Wait()
	if f.db != nil {
		problems = append(problems, f.db.Close())
	}
	return errors.Join(append(problems, f.runError)...)
}
