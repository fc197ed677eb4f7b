// Package localfarm runs a whole coordinator in this process: stores in a folder, the gRPC service
// for workers, the REST interface with the dashboard, and worker processes on this machine.
package localfarm

import (
	"cmp"
	"context"
	"errors"
	"log/slog"
	"net"
	"net/http"
	"path/filepath"
	"strconv"
	"sync"
	"time"

	grpcprom "github.com/grpc-ecosystem/go-grpc-middleware/providers/prometheus"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/child"
	"metrofarm/services/internal/cli"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/farm"
	"metrofarm/services/internal/farmid"
	"metrofarm/services/internal/peer"
	"metrofarm/services/internal/store"
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
	db          store.Store
	library     *bundle.Library
	pair        farmid.Pair
	id          string // of the farm that store and blobs belong to
	coordinator *coordinator.Coordinator
	member      store.Member
	farm        *peer.Farm

	farmListener, httpListener net.Listener
	localListener              net.Listener // for workers of this machine; nil: they use farmListener
	farmServers                []*farm.Server
	httpServer                 *http.Server
	calls                      *grpcprom.ServerMetrics

	dashboard string
	workers   *child.Group
	failed    chan error
	stopRun   context.CancelFunc
	wait      sync.WaitGroup
	runError  error
}

// Start starts everything; on failure, nothing stays running. ctx bounds the start only: a farm
// lives until Close.
func Start(ctx context.Context, options cli.FarmOptions) (*Farm, error) {
	f := &Farm{options: options, calls: farm.NewCalls(), failed: make(chan error, 4)}
	if err := f.start(ctx); err != nil {
		return nil, errors.Join(err, f.Close())
	}
	return f, nil
}

func (f *Farm) start(ctx context.Context) error {
	// The store first: where it is a file, it holds the folder's lock.
	if err := f.openStore(ctx); err != nil {
		return err
	}
	blobs, err := f.openBlobs(ctx)
	if err != nil {
		return err
	}
	f.pair = farmid.Pair{Store: f.db, Blobs: blobs}
	if f.id, err = f.pair.Claim(ctx, f.options.Storage.AdoptBlobs); err != nil {
		return err
	}
	if err := f.listen(ctx); err != nil {
		return err
	}
	life := context.WithoutCancel(ctx)
	f.coordinator, err = coordinator.New(life, coordinator.Options{
		Store: f.db, Blobs: blobs, Logger: f.options.Logger, Member: f.member, Limits: f.options.Access.JobLimits,
		MaxJobs: f.options.Access.MaxJobs, MaxUserJobs: f.options.Access.MaxUserJobs,
		MergeBudget: f.options.Flow.MergeBudget, InboundBytes: f.options.Flow.InboundBytes, FilmsMemory: f.options.Flow.FilmsMemory,
	})
	if err != nil {
		return err
	}
	f.farm = peer.New(f.coordinator, peer.Options{
		Logger: f.options.Logger, Secret: f.member.Secret, TLS: f.options.Access.PeerTLS,
	})
	running, stop := context.WithCancel(life)
	f.stopRun = stop
	f.wait.Go(func() {
		if f.runError = f.coordinator.Run(running); f.runError != nil {
			f.failed <- f.runError
		}
	})
	f.startSweeping(running, blobs)
	f.serveWorkers(blobs)
	if err := f.serveHTTP(); err != nil {
		return err
	}
	f.startWorkers(life, cmp.Or(f.localListener, f.farmListener).Addr().String())
	return nil
}

func (f *Farm) startWorkers(ctx context.Context, address string) {
	var supervisors []*child.Supervisor
	for i := range f.options.Workers {
		name := "local-" + strconv.Itoa(i+1)
		arguments := []string{
			"--coordinator", reachable(address), "--name", name,
			"--cache", filepath.Join(f.options.DataDir, "cache", name),
		}
		if !isLoopback(reachable(address)) {
			arguments = append(arguments, "--insecure") // an address of this machine all the same
		}
		if f.options.Threads > 0 {
			arguments = append(arguments, "--threads", strconv.Itoa(f.options.Threads))
		}
		if f.options.SceneMemory > 0 {
			arguments = append(arguments, "--scene-memory", strconv.FormatInt(f.options.SceneMemory, 10))
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

func isLoopback(address string) bool {
	host, _, err := net.SplitHostPort(address)
	return err == nil && net.ParseIP(host).IsLoopback()
}

// Service runs jobs.
func (f *Farm) Service() api.Service { return f.farm }

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
	for _, server := range f.farmServers {
		server.Stop()
	}
	if f.stopRun != nil {
		f.stopRun()
	}
	f.wait.Wait()
	for _, listener := range []net.Listener{f.farmListener, f.localListener, f.httpListener} {
		if listener != nil {
			_ = listener.Close() // closed with its server, unless the start failed before that
		}
	}
	if f.db != nil {
		problems = append(problems, f.db.Close())
	}
	return errors.Join(append(problems, f.runError)...)
}
