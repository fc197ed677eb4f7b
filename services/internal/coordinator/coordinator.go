// Package coordinator runs jobs: it inspects, plans and bootstraps them, leases their segments to
// workers, merges what comes back, stops on complete rounds and survives its own death.
//
// Locks: Coordinator.mu guards the maps of jobs and workers; run.mu guards one job with its tasks
// and film. run.mu is taken before Coordinator.mu, never after it, and the lock of the room for films
// (room.go) last. Whole-film work (folding a round, hashing, developing, writing checkpoints) happens
// on snapshots, off both locks, in the goroutines that Run owns: housekeeping, one that renews the leases
// on the jobs, one that takes over jobs without owner (ownership.go), and one for each checkpoint that is
// read or written (keep.go).
package coordinator

import (
	"context"
	"crypto/rand"
	"encoding/hex"
	"errors"
	"fmt"
	"log/slog"
	"slices"
	"sync"
	"sync/atomic"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/check"
	"metrofarm/services/internal/fairness"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/flow"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/store"
)

// Options of a coordinator. Store and Blobs are required; zero values of the others mean defaults.
type Options struct {
	Store  store.Store
	Blobs  *blob.Store
	Logger *slog.Logger
	// Member tells others where this coordinator is; an empty ID is replaced.
	Member store.Member
	// OwnershipTTL is how long this coordinator owns its jobs after it was last heard of.
	OwnershipTTL time.Duration
	// Limits on what one job may take.
	Limits plan.Limits
	// MaxJobs is how many jobs may be there that have not ended, MaxUserJobs how many of one user;
	// 0: no bound.
	MaxJobs, MaxUserJobs int
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
	// Deliveries is how many batches are read at a time; more wait.
	Deliveries int
	// MergeBudget is the memory, in bytes, of batches that are being read or held.
	MergeBudget int64
	// FilmsMemory is the memory, in bytes, that the films of all jobs together may take, as estimated;
	// 0: no bound. A job beyond it waits, one that is larger than all of it is refused.
	FilmsMemory int64
	// ReadPatience is how long a request waits to read the checkpoint of a job that has ended, for an
	// image or to refine it, while others do.
	ReadPatience time.Duration
	// InboundBytes is what all workers together should deliver per second at most.
	InboundBytes int64
	// CheckOneIn is the reciprocal of the share of segments that are rendered twice where two workers
	// exist, negative for none. The image does not depend on it.
	CheckOneIn int
	// CheckPatience is how long a batch is held for another worker to confirm it, or for a third to
	// decide between two.
	CheckPatience time.Duration
	// Quarantine is how long a worker gets no leases after a damaged batch: one that does not unpack, or
	// whose film does not fit its own digests; twice as long after each further one.
	Quarantine time.Duration
}

// Defaults: a lost worker's segments are leased again within 15 s (the time to live, one tick, and
// a waiting lease call's wake-up).
const (
	defaultTTL           = 12 * time.Second
	defaultOwnershipTTL  = 6 * time.Second // renewed every third of it
	defaultHeartbeat     = 3 * time.Second
	defaultTick          = 200 * time.Millisecond
	defaultCheckpointMin = 2 * time.Second
	defaultCheckpointMax = 60 * time.Second
	defaultDeliveries    = 8
	defaultCheckPatience = 2 * time.Minute
	defaultQuarantine    = time.Second
	defaultReadPatience  = 20 * time.Second
)

// Defaults of what batches may take.
const (
	DefaultMergeBudget  = int64(1) << 30
	DefaultInboundBytes = int64(64) << 20
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
	setDefault(&o.Member.ID, "c-"+o.NewID())
	setDefault(&o.OwnershipTTL, defaultOwnershipTTL)
	setDefault(&o.LeaseTTL, defaultTTL)
	setDefault(&o.Heartbeat, defaultHeartbeat)
	setDefault(&o.Tick, defaultTick)
	setDefault(&o.CheckpointMin, defaultCheckpointMin)
	setDefault(&o.CheckpointMax, defaultCheckpointMax)
	setDefault(&o.Deliveries, defaultDeliveries)
	setDefault(&o.MergeBudget, DefaultMergeBudget)
	setDefault(&o.InboundBytes, DefaultInboundBytes)
	setDefault(&o.CheckOneIn, check.OneIn)
	setDefault(&o.CheckPatience, defaultCheckPatience)
	setDefault(&o.Quarantine, defaultQuarantine)
	setDefault(&o.ReadPatience, defaultReadPatience)
	if films := uint64(o.FilmsMemory); films > 0 && (o.Limits.CoordinatorBytes == 0 || o.Limits.CoordinatorBytes > films) {
		o.Limits.CoordinatorBytes = films
	}
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

// Coordinator owns jobs, and shows those of others as they were last stored. Its methods may be called from several goroutines.
type Coordinator struct {
	options Options
	log     *slog.Logger
	codec   *film.Codec
	metrics *metrics
	down    atomic.Bool // the store did not answer, and has not since
	leases  atomic.Uint32
	slots   chan struct{} // deliveries being read
	merging *flow.Queue
	room    *room         // for films
	readers *places       // of checkpoints of jobs that have ended
	imaging *places       // of images of jobs in memory
	kick    chan struct{} // housekeeping has something to do
	stopped chan struct{} // closed when Run ends
	broken  chan error    // the first failure that ends Run

	reads, writes      chan struct{}  // checkpoints being read, and written
	reading, transfers sync.WaitGroup // likewise
	news               news

	submitMu sync.Mutex // taken before all others
	endedMu  sync.Mutex // one at a time acquires jobs that have ended; taken before mu

	mu      sync.Mutex
	jobs    map[string]*run // that this coordinator owns
	order   []*run          // the same, by creation
	moved   []*run          // not owned any more, their streams are still open
	ended   map[job.State]int
	crowd   map[string]int // jobs of others that have not ended, by user, as last heard
	beatAt  time.Time      // of the last answered beat
	workers map[string]*worker
	changed chan struct{} // closed and replaced when there may be new work

	// The queue (queue.go).
	usage     fairness.Ledger
	usualCost float64        // CPU time of a task of any job, in seconds
	standings []fairness.Job // of the jobs in order; reused
}

// New makes a coordinator a member of the store. Jobs without owner go on from their last checkpoint
// once Run is called.
func New(ctx context.Context, options Options) (*Coordinator, error) {
	if options.Store == nil || options.Blobs == nil {
		return nil, errors.New("coordinator: Store and Blobs are required")
	}
	options.setDefaults()
	codec, err := film.NewCodec()
	if err != nil {
		return nil, err
	}
	c := &Coordinator{
		options: options, log: options.Logger.With("coordinator", options.Member.ID), codec: codec,
		slots:   make(chan struct{}, options.Deliveries),
		merging: flow.NewQueue(options.MergeBudget),
		room:    newRoom(options.FilmsMemory),
		readers: newPlaces(maxReaders, options.FilmsMemory, "the checkpoints of other jobs are being read"),
		imaging: newPlaces(maxDevelopers, options.FilmsMemory, "the images of other jobs are being developed"),
		kick:    make(chan struct{}, 1),
		stopped: make(chan struct{}),
		broken:  make(chan error, 1),
		reads:   make(chan struct{}, maxReads),
		writes:  make(chan struct{}, maxWrites),
		jobs:    make(map[string]*run),
		ended:   make(map[job.State]int),
		workers: make(map[string]*worker),
		changed: make(chan struct{}),

		usualCost: firstCost,
	}
	c.metrics = newMetrics(c)
	if err := errors.Join(c.beat(ctx), c.hearOfChanges(ctx)); err != nil {
		return nil, fmt.Errorf("coordinator: %w", err)
	}
	return c, nil
}

// Run does the housekeeping until ctx ends, then writes the last checkpoints, ends all event streams
// and releases the jobs. It fails if the store does; an outage of the store it waits out.
func (c *Coordinator) Run(ctx context.Context) error {
	defer close(c.stopped)
	taking, stopTaking := context.WithCancel(ctx)
	beating, stopBeating := context.WithCancel(context.WithoutCancel(ctx))
	var takes, beats sync.WaitGroup
	takes.Go(func() { c.takeJobs(taking) })
	beats.Go(func() { c.keepLeases(beating) })
	err := c.keepHouse(ctx)
	stopTaking()
	takes.Wait()
	if err == nil {
		c.shutDown()
	}
	for _, r := range c.runs() { // the store failed
		r.cancelTransfer()
	}
	c.transfers.Wait()
	stopBeating()
	beats.Wait()
	if err == nil {
		c.leave()
	}
	return err
}

func (c *Coordinator) keepHouse(ctx context.Context) error {
	ticker := time.NewTicker(c.options.Tick)
	defer ticker.Stop()
	for {
		select {
		case <-ctx.Done():
			return nil
		case err := <-c.broken:
			return fmt.Errorf("coordinator: %w", err)
		case <-ticker.C:
		case <-c.kick:
		}
		c.housekeep()
	}
}

// shutDown hands each job over as soon as its last checkpoint is written, whatever becomes of the others.
func (c *Coordinator) shutDown() {
	var leaving sync.WaitGroup
	for _, r := range c.runs() {
		leaving.Go(func() {
			r.keepLast()
			r.closeStreams()
			c.handOver(r)
		})
	}
	leaving.Wait()
}

// fatal ends Run: without its store a coordinator must not promise anything.
func (c *Coordinator) fatal(err error) {
	c.log.Error("store failed", "error", err)
	select {
	case c.broken <- err:
	default:
	}
}

// runs lists the jobs in order of creation.
func (c *Coordinator) runs() []*run {
	c.mu.Lock()
	defer c.mu.Unlock()
	return append([]*run(nil), c.order...)
}

// announce wakes the waiting lease calls if there is work for them.
func (c *Coordinator) announce() {
	c.mu.Lock()
	defer c.mu.Unlock()
	if slices.ContainsFunc(c.order, (*run).waits) {
		c.rouse()
	}
}

// rouse wakes them in any case. Requires: mu.
func (c *Coordinator) rouse() {
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
