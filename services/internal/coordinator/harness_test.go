package coordinator_test

import (
	"context"
	"log/slog"
	"net"
	"os"
	"path/filepath"
	"strings"
	"sync"
	"testing"
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/credentials/insecure"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/farm"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/bolt"
)

const (
	testVersion = "v1 avx2 0000"
	testTTL     = 500 * time.Millisecond
	patience    = 60 * time.Second
)

// site is a data directory with at most one coordinator on it. Its address outlives coordinators,
// as a service's would.
type site struct {
	t       *testing.T
	dir     string
	address string
	tune    func(*coordinator.Options)
	shared  store.Store // instead of one in dir
	gate    *gate       // before the blobs; nil: none

	c      *coordinator.Coordinator
	db     store.Store
	blobs  *blob.Store
	server *farm.Server
	cancel context.CancelFunc
	done   chan struct{}
}

func newSite(t *testing.T) *site {
	t.Helper()
	return &site{t: t, dir: t.TempDir(), address: "127.0.0.1:0"}
}

// start opens the data directory and serves it.
func (s *site) start() {
	s.t.Helper()
	var err error
	if s.db = s.shared; s.shared == nil {
		s.db, err = bolt.Open(filepath.Join(s.dir, "metrofarm.db"), nil)
		s.check(err)
	}
	backend, err := dir.Open(filepath.Join(s.dir, "blobs"))
	s.check(err)
	if s.blobs = blob.New(backend); s.gate != nil {
		s.gate.Backend = backend
		s.blobs = blob.New(s.gate)
	}
	logger := slog.New(slog.DiscardHandler)
	if testing.Verbose() && os.Getenv("METROFARM_TEST_LOG") != "" {
		logger = slog.New(slog.NewTextHandler(os.Stderr, &slog.HandlerOptions{Level: slog.LevelDebug}))
	}
	options := coordinator.Options{
		Store: s.db, Blobs: s.blobs, Logger: logger,
		LeaseTTL: testTTL, Heartbeat: testTTL / 4, Tick: 10 * time.Millisecond, CheckpointMin: 20 * time.Millisecond,
		Quarantine: time.Millisecond,
	}
	if s.tune != nil {
		s.tune(&options)
	}
	ctx, cancel := context.WithCancel(context.Background())
	s.cancel = cancel
	s.c, err = coordinator.New(ctx, options)
	s.check(err)
	s.server = farm.NewServer(farm.Options{Farm: s.c, Blobs: s.blobs, Logger: logger})
	listener, err := net.Listen("tcp", s.address)
	s.check(err)
	s.address = listener.Addr().String()
	s.done = make(chan struct{})
	c, server, done := s.c, s.server, s.done
	go func() { _ = server.Serve(listener) }()
	go func() { defer close(done); _ = c.Run(ctx) }()
}

// stop leaves in order.
func (s *site) stop() {
	s.server.Stop()
	s.cancel()
	<-s.done
	if s.shared == nil {
		s.check(s.db.Close())
	}
}

// kill takes the store away before anything can be saved: all that the next coordinator finds is
// what was durable at this moment.
func (s *site) kill() {
	s.check(s.db.Close())
	s.cancel()
	s.server.Stop()
	<-s.done
}

func (s *site) check(err error) {
	s.t.Helper()
	if err != nil {
		s.t.Fatal(err)
	}
}

// bundle stores a scene of one file.
func (s *site) bundle() string {
	s.t.Helper()
	sha, size, err := s.blobs.PutFile(context.Background(), strings.NewReader("<scene/>"), 100)
	s.check(err)
	digest, err := s.blobs.PutManifest(context.Background(), []blob.File{{Path: "scene.xml", Size: size, SHA256: sha}})
	s.check(err)
	return digest
}

func (s *site) submit(request job.Request) string {
	s.t.Helper()
	request.Scene, request.Entry = s.bundle(), "scene.xml"
	snapshot, err := s.c.Submit(context.Background(), request, "")
	s.check(err)
	return snapshot.ID
}

func (s *site) job(id string) job.Snapshot {
	s.t.Helper()
	snapshot, err := s.c.Job(context.Background(), id)
	s.check(err)
	return snapshot
}

// await waits until the job is as wanted.
func (s *site) await(id, what string, wanted func(job.Snapshot) bool) job.Snapshot {
	s.t.Helper()
	deadline := time.Now().Add(patience)
	for {
		snapshot := s.job(id)
		if wanted(snapshot) {
			return snapshot
		}
		if time.Now().After(deadline) {
			s.t.Fatalf("job is not %s after %v: %+v", what, patience, snapshot)
		}
		time.Sleep(2 * time.Millisecond)
	}
}

func (s *site) finished(id string) job.Snapshot {
	s.t.Helper()
	snapshot := s.await(id, "ended", func(j job.Snapshot) bool { return j.State.Ended() })
	if snapshot.State != job.Done {
		s.t.Fatalf("job is %s: %s", snapshot.State, snapshot.Error)
	}
	return snapshot
}

// crew runs workers until the test ends or the returned function is called.
func (s *site) crew(workers ...*fakeworker.Worker) (dismiss func()) {
	s.t.Helper()
	ctx, cancel := context.WithCancel(context.Background())
	var group sync.WaitGroup
	for _, w := range workers {
		connection, err := grpc.NewClient(s.address,
			grpc.WithTransportCredentials(insecure.NewCredentials()),
			grpc.WithDefaultCallOptions(grpc.MaxCallRecvMsgSize(64<<20)),
			grpc.WithConnectParams(fastReconnect()))
		s.check(err)
		w.Client = farmv1.NewFarmServiceClient(connection)
		group.Go(func() {
			defer connection.Close()
			if err := w.Run(ctx); err != nil {
				s.t.Errorf("worker %s: %v", w.Name, err)
			}
		})
	}
	var once sync.Once
	dismiss = func() { once.Do(func() { cancel(); group.Wait() }) }
	s.t.Cleanup(dismiss)
	return dismiss
}

// bystander is a worker that sends heartbeats but takes no work, until it vanishes.
func (s *site) bystander() (vanish func()) {
	s.t.Helper()
	c := s.c
	registered, err := c.Register(context.Background(), &farmv1.RegisterRequest{
		Name: "bystander", Version: testVersion, Threads: 1, Instance: strings.Repeat("b", 32),
	})
	s.check(err)
	ctx, cancel := context.WithCancel(context.Background())
	var beating sync.WaitGroup
	beating.Go(func() {
		for ctx.Err() == nil {
			_, _ = c.Heartbeat(ctx, &farmv1.HeartbeatRequest{WorkerId: registered.GetWorkerId()})
			time.Sleep(testTTL / 10)
		}
	})
	return func() { cancel(); beating.Wait() }
}

// awaitHeld waits until the job waits for a second worker.
func (s *site) awaitHeld(id string) {
	s.t.Helper()
	s.await(id, "waiting for a second worker", func(j job.Snapshot) bool {
		return strings.Contains(j.Activity, "second worker")
	})
}

func workers(n int, change func(*fakeworker.Worker)) []*fakeworker.Worker {
	crew := make([]*fakeworker.Worker, n)
	for i := range crew {
		crew[i] = &fakeworker.Worker{
			Name: string(rune('a' + i)), Version: testVersion, Report: report("pssmlt"),
			StaleDelay: 2 * testTTL,
		}
		if change != nil {
			change(crew[i])
		}
	}
	return crew
}

// report of a small scene whose film has tiles that are cut at the edges.
func report(integrator string) *scenev1.SceneReport {
	return &scenev1.SceneReport{
		Width: 70, Height: 41, Filter: scenev1.Filter_FILTER_GAUSSIAN, FilterRadius: 1.5,
		MaxDepth: -1, RrDepth: 5, SampleCount: 16, Integrator: integrator,
	}
}

func chainsRequest(mutationsPerPixel uint64) job.Request {
	return job.Request{
		Integrator: "pssmlt", Seed: 7, BootstrapSamples: 4096, Chains: 1024,
		Stop: job.StopRules{MutationsPerPixel: mutationsPerPixel},
	}
}

func pathRequest(samplesPerPixel uint64) job.Request {
	return job.Request{Integrator: "path", Seed: 7, Stop: job.StopRules{SamplesPerPixel: samplesPerPixel}}
}
