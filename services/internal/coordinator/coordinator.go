// Package coordinator runs jobs: it inspects, plans and bootstraps them, leases their segments to
// workers, merges what comes back, stops on complete rounds and survives its own death.
//
// Locks: Coordinator.mu guards the maps of jobs and workers; run.mu guards one job with its tasks
// and film. run.mu is taken before Coordinator.mu, never after it. Whole-film work (folding a
// round, hashing, developing, writing checkpoints) happens on snapshots, off both locks, in the one
// housekeeping goroutine that Run owns.
package coordinator

import (
	"context"
	"crypto/rand"
	"encoding/hex"
	"errors"
	"fmt"
	"log/slog"
	"sync"
	"sync/atomic"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/check"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/store"
)

// Options of a coordinator. Store and Blobs are required; zero values of the others mean defaults.
type Options struct {
	Store  store.Store
	Blobs  *blob.Store
	Logger *slog.Logger
	// Now is the clock.
	Now func() time.Time
	// NewID returns unguessable text for identities.
	NewID func() string
	// LeaseTTL is how long a lease lives without heartbeat; Heartbeat is what workers are told.
	LeaseTTL, Heartbeat time.Duration
	// Tick is the pace of housekeeping: expiry, time limits, progress events.
	Tick time.Duration
	// CheckpointMin and CheckpointMax bound the time between two checkpoints of a job.
	CheckpointMin, CheckpointMax time.Duration
	// Deliveries is how many batches are unpacked at a time; more wait.
	Deliveries int
	// CheckOneIn is the reciprocal of the share of segments that are rendered twice where two workers
	// exist, negative for none. The image does not depend on it.
	CheckOneIn int
	// CheckPatience is how long a batch is held for another worker to confirm it, or for a third to
	// decide between two.
	CheckPatience time.Duration
}

// Defaults: a lost worker's segments are leased again within 15 s (the time to live, one tick, and
// a waiting lease call's wake-up).
const (
	defaultTTL           = 12 * time.Second
	defaultHeartbeat     = 3 * time.Second
	defaultTick          = 200 * time.Millisecond
	defaultCheckpointMin = 2 * time.Second
	defaultCheckpointMax = 60 * time.Second
	defaultDeliveries    = 8
	defaultCheckPatience = 2 * time.Minute
)

func (o *Options) setDefaults() {
	if o.Logger == nil {
		o.Logger = slog.New(slog.DiscardHandler)
	}
	if o.Now == nil {
		o.Now = time.Now
	}
	if o.NewID == nil {
		o.NewID = randomID
	}
	setDefault(&o.LeaseTTL, defaultTTL)
	setDefault(&o.Heartbeat, defaultHeartbeat)
	setDefault(&o.Tick, defaultTick)
	setDefault(&o.CheckpointMin, defaultCheckpointMin)
	setDefault(&o.CheckpointMax, defaultCheckpointMax)
	setDefault(&o.Deliveries, defaultDeliveries)
	setDefault(&o.CheckOneIn, check.OneIn)
	setDefault(&o.CheckPatience, defaultCheckPatience)
}

func setDefault[T comparable](value *T, fallback T) {
	var zero T
	if *value == zero {
		*value = fallback
	}
}

func randomID() string {
	var b [6]byte
	_, _ = rand.Read(b[:]) // never fails
	return hex.EncodeToString(b[:])
}

// Coordinator is one owner of jobs. Its methods may be called from several goroutines.
type Coordinator struct {
	options Options
	log     *slog.Logger
	codec   *film.Codec
	metrics *metrics
	epoch   uint64 // of the claim on the store
	leases  atomic.Uint32
	slots   chan struct{} // deliveries being unpacked
	kick    chan struct{} // housekeeping has something to do
	stopped chan struct{} // closed when Run ends
	broken  chan error    // the first failure that ends Run

	submitMu sync.Mutex // taken before all others

	mu      sync.Mutex
	jobs    map[string]*run
	order   []*run // by creation
	workers map[string]*worker
	changed chan struct{} // closed and replaced when there may be new work
}

// New claims the store and recovers its jobs: those that had not ended go on from their last
// checkpoint once Run is called.
func New(ctx context.Context, options Options) (*Coordinator, error) {
	if options.Store == nil || options.Blobs == nil {
		return nil, errors.New("coordinator: Store and Blobs are required")
	}
	options.setDefaults()
	codec, err := film.NewCodec()
	if err != nil {
		return nil, err
	}
	epoch, err := options.Store.Claim(ctx)
	if err != nil {
		return nil, fmt.Errorf("coordinator: %w", err)
	}
	c := &Coordinator{
		options: options, log: options.Logger, codec: codec, epoch: epoch,
		slots:   make(chan struct{}, options.Deliveries),
		kick:    make(chan struct{}, 1),
		stopped: make(chan struct{}),
		broken:  make(chan error, 1),
		jobs:    make(map[string]*run),
		workers: make(map[string]*worker),
		changed: make(chan struct{}),
	}
	c.metrics = newMetrics(c)
	if err := c.recover(ctx); err != nil {
		return nil, fmt.Errorf("coordinator: recover: %w", err)
	}
	return c, nil
}

// Run does the housekeeping until ctx ends, then writes the last checkpoints and ends all event
// streams. It fails if the store does, or if another coordinator claimed it.
func (c *Coordinator) Run(ctx context.Context) error {
	defer close(c.stopped)
	ticker := time.NewTicker(c.options.Tick)
	defer ticker.Stop()
	for {
		select {
		case <-ctx.Done():
			c.shutDown()
			return nil
		case err := <-c.broken:
			return fmt.Errorf("coordinator: %w", err)
		case <-ticker.C:
		case <-c.kick:
		}
		c.housekeep()
	}
}

func (c *Coordinator) shutDown() {
	for _, r := range c.runs() {
		if r.checkpointDue(true) {
			r.checkpoint()
		}
		r.closeStreams()
	}
}

// fatal ends Run: without its store a coordinator must not promise anything.
func (c *Coordinator) fatal(err error) {
	c.log.Error("store failed", "error", err)
	select {
	case c.broken <- err:
	default:
	}
}

// nextEpoch grows over restarts: the claim's epoch is its high part.
func (c *Coordinator) nextEpoch() uint64 {
	return c.epoch<<32 | uint64(c.leases.Add(1))
}

// runs lists the jobs in order of creation.
func (c *Coordinator) runs() []*run {
	c.mu.Lock()
	defer c.mu.Unlock()
	return append([]*run(nil), c.order...)
}

// announce wakes the waiting lease calls.
func (c *Coordinator) announce() {
	c.mu.Lock()
	defer c.mu.Unlock()
	close(c.changed)
	c.changed = make(chan struct{})
}

// wake lets housekeeping run now.
func (c *Coordinator) wake() {
	select {
	case c.kick <- struct{}{}:
	default:
	}
}
