// Package fakefarm is a coordinator for tests: it implements api.Service in memory, renders nothing,
// and its jobs advance when the test says so.
package fakefarm

import (
	"context"
	"fmt"
	"reflect"
	"slices"
	"strconv"
	"sync"
	"time"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

// Farm is a fake coordinator. Its methods may be called from several goroutines.
type Farm struct {
	mutex   sync.Mutex
	now     func() time.Time
	order   []string // oldest first
	jobs    map[string]*record
	keys    map[string]string // idempotency key to job
	workers []job.Worker
	deleted []string // ids

	sequences []*sequence // oldest first
}

type record struct {
	submitted job.Request // but for its priority
	snapshot  job.Snapshot
	points    []job.ConvergencePoint
	events    []job.Event
	image     *job.Image
	watchers  map[chan job.Event]bool
}

// New makes a farm without jobs; now nil means time.Now.
func New(now func() time.Time) *Farm {
	if now == nil {
		now = time.Now
	}
	return &Farm{now: now, jobs: make(map[string]*record), keys: make(map[string]string)}
}

// Submit adds a queued job named j1, j2, ...
func (f *Farm) Submit(ctx context.Context, request job.Request, key string) (job.Snapshot, error) {
	if err := request.Validate(); err != nil {
		return job.Snapshot{}, err
	}
	submitted := request
	submitted.Priority = 0
	f.mutex.Lock()
	defer f.mutex.Unlock()
	if id, found := f.keys[key]; found && key != "" {
		if first := f.jobs[id]; reflect.DeepEqual(first.submitted, submitted) {
			return first.snapshot, nil
		}
		return job.Snapshot{}, fmt.Errorf("%w: the Idempotency-Key was used for another job", job.ErrConflict)
	}
	id := f.add(ctx, request, nil)
	f.keys[key] = id
	return f.jobs[id].snapshot, nil
}

// add requires: mutex.
func (f *Farm) add(ctx context.Context, request job.Request, frame *job.FrameOf) (id string) {
	id = "j" + strconv.Itoa(len(f.order)+1)
	submitted := request
	submitted.Priority = 0
	f.order = append(f.order, id)
	f.jobs[id] = &record{
		submitted: submitted,
		snapshot: job.Snapshot{
			ID: id, User: auth.From(ctx).User, Sequence: frame, Request: request, State: job.Queued, CreatedAt: f.now(),
			Seed: request.Seed, Anomalies: map[string]uint64{},
		},
		watchers: make(map[chan job.Event]bool),
	}
	f.publish(f.jobs[id], job.Event{Kind: "state", Message: "queued"})
	return id
}

// Update changes a job and publishes an event of the given kind with the new snapshot.
func (f *Farm) Update(id, kind, message string, change func(*job.Snapshot)) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r := f.jobs[id]
	change(&r.snapshot)
	f.publish(r, job.Event{Kind: kind, Message: message})
}

// CompleteRound adds a convergence point and the image that goes with it.
func (f *Farm) CompleteRound(id string, point job.ConvergencePoint, image job.Image, change func(*job.Snapshot)) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r := f.jobs[id]
	r.points = append(r.points, point)
	image.FilmSHA256 = point.FilmSHA256
	r.image = &image
	r.snapshot.RoundsDone = len(r.points)
	r.snapshot.FilmSHA256 = point.FilmSHA256
	r.snapshot.RelMSE = &point.RelMSE
	r.snapshot.RelMSEInterval = &point.RelMSEInterval
	r.snapshot.B, r.snapshot.BStandardError = point.B, point.BStandardError
	r.snapshot.Mutations = point.Mutations
	change(&r.snapshot)
	f.publish(r, job.Event{Kind: "round", Message: fmt.Sprintf("round %d", point.Round), Convergence: &point})
}

// SetWorkers says which workers there are.
func (f *Farm) SetWorkers(workers ...job.Worker) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	f.workers = workers
}

// publish must be called with the mutex held.
func (f *Farm) publish(r *record, event job.Event) {
	event.Sequence = uint64(len(r.events) + 1)
	event.At = f.now()
	snapshot := r.snapshot.ForEvents()
	event.Job = &snapshot
	r.events = append(r.events, event)
	for watcher := range r.watchers {
		select {
		case watcher <- event:
		default: // too slow
			close(watcher)
			delete(r.watchers, watcher)
		}
	}
}

// find must be called with the mutex held.
func (f *Farm) find(id string) (*record, error) {
	r, found := f.jobs[id]
	if !found {
		return nil, fmt.Errorf("job %q: %w", id, job.ErrNotFound)
	}
	return r, nil
}

// Job returns one job.
func (f *Farm) Job(_ context.Context, id string) (job.Snapshot, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return job.Snapshot{}, err
	}
	return r.snapshot, nil
}

// Jobs lists jobs, newest first.
func (f *Farm) Jobs(_ context.Context, cursor string, limit int) ([]job.Snapshot, string, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	ids := slices.Clone(f.order)
	slices.Reverse(ids)
	if cursor != "" {
		i := slices.Index(ids, cursor)
		if i < 0 {
			return nil, "", &job.FieldError{Field: "cursor", Detail: "no such job"}
		}
		ids = ids[i+1:]
	}
	var jobs []job.Snapshot
	for _, id := range ids[:min(limit, len(ids))] {
		jobs = append(jobs, f.jobs[id].snapshot)
	}
	if len(ids) > limit {
		return jobs, ids[limit-1], nil
	}
	return jobs, "", nil
}

// Live lists the jobs that have not ended.
func (f *Farm) Live(context.Context) ([]job.Snapshot, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	var jobs []job.Snapshot
	for _, id := range f.order {
		if snapshot := f.jobs[id].snapshot; !snapshot.State.Ended() {
			jobs = append(jobs, snapshot)
		}
	}
	return jobs, nil
}

// Deleted returns the jobs that were deleted after the first so many, and how many there are.
func (f *Farm) Deleted(after uint64) ([]string, uint64) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	return slices.Clone(f.deleted[after:]), uint64(len(f.deleted))
}

// Delete removes a job that has ended.
func (f *Farm) Delete(_ context.Context, id string) error {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return err
	}
	if !r.snapshot.State.Ended() {
		return fmt.Errorf("%w: job %s is %s; cancel it first", job.ErrConflict, id, r.snapshot.State)
	}
	f.dropWatchers(r)
	f.deleted = append(f.deleted, id)
	delete(f.jobs, id)
	f.order = slices.DeleteFunc(f.order, func(other string) bool { return other == id })
	return nil
}
