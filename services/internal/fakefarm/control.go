package fakefarm

import (
	"context"
	"fmt"
	"slices"

	"metrofarm/services/internal/job"
)

// Cancel ends a job.
func (f *Farm) Cancel(_ context.Context, id string) (job.Snapshot, error) {
	return f.act(id, "canceled", func(s *job.Snapshot) { s.State = job.Canceled })
}

// Pause marks a job paused.
func (f *Farm) Pause(_ context.Context, id string) (job.Snapshot, error) {
	return f.act(id, "paused", func(s *job.Snapshot) { s.Paused = true })
}

// Resume undoes Pause.
func (f *Farm) Resume(_ context.Context, id string) (job.Snapshot, error) {
	return f.act(id, "resumed", func(s *job.Snapshot) { s.Paused = false })
}

// Finish ends a job as done.
func (f *Farm) Finish(_ context.Context, id string) (job.Snapshot, error) {
	return f.act(id, "finished", func(s *job.Snapshot) {
		s.State, s.Progress, s.StopReason = job.Done, 1, "asked to finish"
	})
}

// Change changes a job's name or priority.
func (f *Farm) Change(_ context.Context, id string, change job.Change) (job.Snapshot, error) {
	return f.act(id, "changed", func(s *job.Snapshot) { change.Apply(&s.Request) })
}

// Refine lets a job that has ended go on with other stop rules.
func (f *Farm) Refine(_ context.Context, id string, stop job.StopRules) (job.Snapshot, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return job.Snapshot{}, err
	}
	if !r.snapshot.State.Ended() {
		return job.Snapshot{}, fmt.Errorf("%w: job %s is %s", job.ErrConflict, id, r.snapshot.State)
	}
	request, err := r.snapshot.Request.Refined(stop, false)
	if err != nil {
		return job.Snapshot{}, err
	}
	r.snapshot.Request, r.snapshot.State, r.snapshot.StopReason = request, job.Rendering, ""
	r.snapshot.Refinements++
	f.publish(r, job.Event{Kind: "state", Message: "refined"})
	return r.snapshot, nil
}

func (f *Farm) act(id, message string, change func(*job.Snapshot)) (job.Snapshot, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return job.Snapshot{}, err
	}
	if r.snapshot.State.Ended() {
		return job.Snapshot{}, fmt.Errorf("%w: job %s is %s", job.ErrConflict, id, r.snapshot.State)
	}
	change(&r.snapshot)
	f.publish(r, job.Event{Kind: "state", Message: message})
	return r.snapshot, nil
}

// Convergence returns the points so far.
func (f *Farm) Convergence(_ context.Context, id string) ([]job.ConvergencePoint, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return nil, err
	}
	return slices.Clone(r.points), nil
}

// SceneReport returns an empty report for a job that has left the queue.
func (f *Farm) SceneReport(_ context.Context, id string) (string, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return "", err
	}
	if r.snapshot.State == job.Queued {
		return "", fmt.Errorf("job %s: %w", id, job.ErrNoReport)
	}
	return "{}", nil
}

// Image returns the image of the last complete round.
func (f *Farm) Image(_ context.Context, id string) (job.Image, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return job.Image{}, err
	}
	if r.image == nil {
		return job.Image{}, fmt.Errorf("job %s: %w", id, job.ErrNoImage)
	}
	return *r.image, nil
}

const watcherBuffer = 64

// Events returns past events and a channel of those that follow.
func (f *Farm) Events(ctx context.Context, id string, after uint64) ([]job.Event, <-chan job.Event, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	r, err := f.find(id)
	if err != nil {
		return nil, nil, err
	}
	watcher := make(chan job.Event, watcherBuffer)
	r.watchers[watcher] = true
	context.AfterFunc(ctx, func() {
		f.mutex.Lock()
		defer f.mutex.Unlock()
		if r.watchers[watcher] {
			close(watcher)
			delete(r.watchers, watcher)
		}
	})
	return slices.Clone(r.events[min(after, uint64(len(r.events))):]), watcher, nil
}

// DropWatchers closes all event channels of a job, as a coordinator does with slow readers.
func (f *Farm) DropWatchers(id string) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	f.dropWatchers(f.jobs[id])
}

// dropWatchers must be called with the mutex held.
func (f *Farm) dropWatchers(r *record) {
	for watcher := range r.watchers {
		close(watcher)
	}
	clear(r.watchers)
}

// Workers lists the workers.
func (f *Farm) Workers(context.Context) ([]job.Worker, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	return slices.Clone(f.workers), nil
}

// Drain marks a worker as draining.
func (f *Farm) Drain(_ context.Context, id string) (job.Worker, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	for i := range f.workers {
		if f.workers[i].ID == id {
			f.workers[i].State = "draining"
			return f.workers[i], nil
		}
	}
	return job.Worker{}, fmt.Errorf("worker %q: %w", id, job.ErrNotFound)
}
