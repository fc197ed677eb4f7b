package coordinator

import (
	"context"
	"crypto/sha256"
	"encoding/hex"
	"encoding/json"
	"errors"
	"fmt"
	"path"
	"slices"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/store"
)

const (
	defaultPage = 50
	maxPage     = 500
	maxKeyBytes = 256
)

// Submit implements api.Service.
func (c *Coordinator) Submit(ctx context.Context, request job.Request, key string) (job.Snapshot, error) {
	if err := c.checkRequest(&request); err != nil {
		return job.Snapshot{}, err
	}
	if len(key) > maxKeyBytes {
		return job.Snapshot{}, &job.FieldError{Field: "Idempotency-Key", Detail: fmt.Sprintf("is longer than %d bytes", maxKeyBytes)}
	}
	fingerprint, err := fingerprint(request)
	if err != nil {
		return job.Snapshot{}, err
	}
	// One at a time: a repeated key must find the job of the first call admitted.
	c.submitMu.Lock()
	defer c.submitMu.Unlock()
	rec := store.Record{ID: "job-" + c.options.NewID(), Request: request, State: job.Queued, CreatedAt: c.options.Now()}
	stored, created, err := c.options.Store.CreateJob(ctx, c.epoch, rec, key, fingerprint)
	if errors.Is(err, store.ErrKeyReused) {
		return job.Snapshot{}, fmt.Errorf("%w: %w", job.ErrConflict, err)
	}
	if err != nil {
		return job.Snapshot{}, fmt.Errorf("submit: %w", err)
	}
	if !created {
		return c.Job(ctx, stored.ID)
	}
	return c.admit(stored), nil
}

// admit makes a stored job run.
func (c *Coordinator) admit(rec store.Record) job.Snapshot {
	r := c.newRun(rec)
	r.mu.Lock()
	r.startInspection()
	c.mu.Lock()
	c.jobs[r.id] = r
	at, _ := slices.BinarySearchFunc(c.order, rec.Number, func(o *run, n uint64) int { return int(o.number) - int(n) })
	c.order = slices.Insert(c.order, at, r)
	c.mu.Unlock()
	r.publish("state", "accepted", nil)
	r.save()
	snapshot := r.snapshot()
	r.mu.Unlock()
	c.announce()
	return snapshot
}

func (c *Coordinator) checkRequest(r *job.Request) error {
	if err := r.Validate(); err != nil {
		return err
	}
	if r.Resolved != "" {
		if _, err := plan.ParseResolved(r.Resolved); err != nil {
			return err
		}
	}
	files, err := c.options.Blobs.Manifest(r.Scene)
	switch {
	case errors.Is(err, blob.ErrNotFound), errors.Is(err, blob.ErrName):
		return &job.FieldError{Field: "scene", Detail: "names no stored bundle: " + r.Scene}
	case err != nil:
		return fmt.Errorf("submit: %w", err)
	}
	if !slices.ContainsFunc(files, func(f blob.File) bool { return f.Path == r.Entry }) {
		return &job.FieldError{Field: "entry", Detail: fmt.Sprintf("the bundle has no file %q", r.Entry)}
	}
	if r.Name == "" {
		r.Name = clip(path.Base(r.Entry), maxNameBytes)
	}
	return nil
}

func fingerprint(request job.Request) (string, error) {
	content, err := json.Marshal(request)
	if err != nil {
		return "", fmt.Errorf("submit: %w", err)
	}
	sum := sha256.Sum256(content)
	return hex.EncodeToString(sum[:]), nil
}

// find returns a job.
func (c *Coordinator) find(id string) (*run, error) {
	c.mu.Lock()
	defer c.mu.Unlock()
	if r := c.jobs[id]; r != nil {
		return r, nil
	}
	return nil, fmt.Errorf("job %q: %w", id, job.ErrNotFound)
}

// Job implements api.Service.
func (c *Coordinator) Job(_ context.Context, id string) (job.Snapshot, error) {
	r, err := c.find(id)
	if err != nil {
		return job.Snapshot{}, err
	}
	r.mu.Lock()
	defer r.mu.Unlock()
	return r.snapshot(), nil
}

// Jobs implements api.Service.
func (c *Coordinator) Jobs(_ context.Context, cursor string, limit int) ([]job.Snapshot, string, error) {
	if limit <= 0 {
		limit = defaultPage
	}
	limit = min(limit, maxPage)
	runs := c.runs()
	slices.Reverse(runs)
	if cursor != "" {
		at := slices.IndexFunc(runs, func(r *run) bool { return r.id == cursor })
		if at < 0 {
			return nil, "", &job.FieldError{Field: "cursor", Detail: "names no job"}
		}
		runs = runs[at+1:]
	}
	next := ""
	if len(runs) > limit {
		runs = runs[:limit]
		next = runs[limit-1].id
	}
	snapshots := make([]job.Snapshot, 0, len(runs))
	for _, r := range runs {
		r.mu.Lock()
		snapshots = append(snapshots, r.snapshot())
		r.mu.Unlock()
	}
	return snapshots, next, nil
}

// Delete implements api.Service.
func (c *Coordinator) Delete(ctx context.Context, id string) error {
	r, err := c.find(id)
	if err != nil {
		return err
	}
	r.mu.Lock()
	if !r.rec.State.Ended() {
		r.mu.Unlock()
		return fmt.Errorf("job %s is %s; cancel it first: %w", id, r.rec.State, job.ErrConflict)
	}
	r.state, r.dirty = nil, false
	name := r.rec.Checkpoint
	err = c.options.Store.DeleteJob(ctx, c.epoch, id)
	r.mu.Unlock()
	if err != nil {
		return fmt.Errorf("delete: %w", err)
	}
	c.mu.Lock()
	delete(c.jobs, id)
	c.order = slices.DeleteFunc(c.order, func(o *run) bool { return o == r })
	c.mu.Unlock()
	r.closeStreams()
	if name == "" {
		return nil
	}
	return c.options.Blobs.DeleteBlob(name)
}

// change applies a user's action to a job that has not ended.
func (c *Coordinator) change(id string, act func(*run) error) (job.Snapshot, error) {
	r, err := c.find(id)
	if err != nil {
		return job.Snapshot{}, err
	}
	defer c.wake()
	defer c.announce()
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State.Ended() {
		return job.Snapshot{}, fmt.Errorf("job %s is %s: %w", id, r.rec.State, job.ErrConflict)
	}
	if err := act(r); err != nil {
		return job.Snapshot{}, err
	}
	r.save()
	return r.snapshot(), nil
}

// Cancel implements api.Service.
func (c *Coordinator) Cancel(_ context.Context, id string) (job.Snapshot, error) {
	return c.change(id, func(r *run) error {
		r.end(job.Canceled, "canceled by the user")
		return nil
	})
}

// Pause implements api.Service. Work under way is still taken.
func (c *Coordinator) Pause(_ context.Context, id string) (job.Snapshot, error) {
	return c.change(id, func(r *run) error {
		if !r.rec.Paused {
			r.rec.Paused = true
			r.stopClock()
			r.publish("state", "paused", nil)
		}
		return nil
	})
}

// Resume implements api.Service.
func (c *Coordinator) Resume(_ context.Context, id string) (job.Snapshot, error) {
	return c.change(id, func(r *run) error {
		if r.rec.Paused {
			r.unpause()
			r.publish("state", "resumed", nil)
		}
		return nil
	})
}

// Finish implements api.Service. A paused job is resumed: its last round has to be completed.
func (c *Coordinator) Finish(_ context.Context, id string) (job.Snapshot, error) {
	return c.change(id, func(r *run) error {
		r.unpause()
		r.decideLast(round.StopFinished)
		r.publish("state", "finishing with the round under way", nil)
		return nil
	})
}

// Convergence implements api.Service.
func (c *Coordinator) Convergence(_ context.Context, id string) ([]job.ConvergencePoint, error) {
	r, err := c.find(id)
	if err != nil {
		return nil, err
	}
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State.Ended() || r.state == nil {
		return slices.Clone(r.rec.Convergence), nil
	}
	return slices.Clone(r.state.Points), nil
}

// SceneReport implements api.Service.
func (c *Coordinator) SceneReport(_ context.Context, id string) (string, error) {
	r, err := c.find(id)
	if err != nil {
		return "", err
	}
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.SceneReport == "" {
		return "", fmt.Errorf("job %s: %w", id, job.ErrNoReport)
	}
	return r.rec.SceneReport, nil
}

// Events implements api.Service.
func (c *Coordinator) Events(ctx context.Context, id string, after uint64) ([]job.Event, <-chan job.Event, error) {
	r, err := c.find(id)
	if err != nil {
		return nil, nil, err
	}
	return r.follow(ctx, after)
}
