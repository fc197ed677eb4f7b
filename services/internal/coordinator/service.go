package coordinator

import (
	"context"
	"crypto/sha256"
	"encoding/hex"
	"encoding/json"
	"errors"
	"fmt"
	"slices"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/job"
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
	if err := c.checkRequest(ctx, &request); err != nil {
		return job.Snapshot{}, err
	}
	if err := checkKey(key); err != nil {
		return job.Snapshot{}, err
	}
	unranked := request
	unranked.Priority = 0
	fingerprint, err := fingerprint(unranked)
	if err != nil {
		return job.Snapshot{}, err
	}
	// One at a time: a repeated key must find the job of the first call admitted.
	c.submitMu.Lock()
	defer c.submitMu.Unlock()
	if err := c.checkCrowd(auth.From(ctx).User, 1); err != nil {
		return job.Snapshot{}, err
	}
	rec := store.Record{
		ID: "job-" + c.options.NewID(), User: auth.From(ctx).User, Request: request, State: job.Queued, CreatedAt: c.options.Now(),
	}
	stored, created, err := c.options.Store.CreateJob(ctx, c.claim(), rec, key, fingerprint)
	if errors.Is(err, store.ErrKeyReused) {
		return job.Snapshot{}, fmt.Errorf("%w: %w", job.ErrConflict, err)
	}
	if err != nil {
		return job.Snapshot{}, fmt.Errorf("submit: %w", err)
	}
	if !created {
		return c.Job(ctx, stored.ID)
	}
	c.log.InfoContext(ctx, "job accepted", "job", stored.ID, "user", stored.User)
	return c.admit(stored), nil
}

// admit makes a job run that was just created, under its first epoch.
func (c *Coordinator) admit(rec store.Record) job.Snapshot {
	r := c.newRun(rec, 1)
	defer c.announce()
	r.mu.Lock()
	defer r.mu.Unlock()
	r.startInspection()
	c.insert(r)
	r.publish("state", "accepted", nil)
	r.save()
	return r.snapshot()
}

func (c *Coordinator) checkRequest(ctx context.Context, r *job.Request) error {
	if err := r.Validate(); err != nil {
		return err
	}
	if err := c.options.Limits.CheckRequest(*r); err != nil {
		return err
	}
	files, err := c.options.Blobs.UseManifest(ctx, r.Scene)
	switch {
	case errors.Is(err, blob.ErrNotFound), errors.Is(err, blob.ErrName):
		return &job.FieldError{Field: "scene", Detail: "names no stored bundle: " + r.Scene}
	case err != nil:
		return fmt.Errorf("submit: %w", err)
	}
	if !slices.ContainsFunc(files, func(f blob.File) bool { return f.Path == r.Entry }) {
		return &job.FieldError{Field: "entry", Detail: fmt.Sprintf("the bundle has no file %q", r.Entry)}
	}
	r.SetDefaultName()
	return nil
}

func checkKey(key string) error {
	if len(key) > maxKeyBytes {
		return &job.FieldError{Field: "Idempotency-Key", Detail: fmt.Sprintf("is longer than %d bytes", maxKeyBytes)}
	}
	return nil
}

// fingerprint of what a request asks for. A priority is no part of that: the caller leaves it out.
func fingerprint(request any) (string, error) {
	content, err := json.Marshal(request)
	if err != nil {
		return "", fmt.Errorf("submit: %w", err)
	}
	sum := sha256.Sum256(content)
	return hex.EncodeToString(sum[:]), nil
}

// alter applies a user's action to a job that has not ended. It is stored when alter returns. A job that
// nobody owns cannot be acted on before it is taken over.
func (c *Coordinator) alter(ctx context.Context, id string, act func(*run) error) (job.Snapshot, error) {
	r := c.running(id)
	if r == nil {
		var err error
		if r, err = c.find(ctx, id); err != nil {
			return job.Snapshot{}, err
		}
	}
	defer c.wake()
	defer c.announce()
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State.Ended() {
		return job.Snapshot{}, fmt.Errorf("job %s is %s: %w", id, r.rec.State, job.ErrConflict)
	}
	if r.gone.Load() || r.loading {
		c.room.recall(id)
		return job.Snapshot{}, fmt.Errorf("job %s is between two coordinators: %w", id, job.ErrUnavailable)
	}
	if err := act(r); err != nil {
		return job.Snapshot{}, err
	}
	switch saved := r.save(); {
	case saved:
		return r.snapshot(), nil
	case r.gone.Load():
		return job.Snapshot{}, fmt.Errorf("job %s has moved to another coordinator: %w", id, job.ErrUnavailable)
	}
	return job.Snapshot{}, fmt.Errorf("job %s: %w", id, store.ErrUnavailable)
}

// Change implements api.Service.
func (c *Coordinator) Change(ctx context.Context, id string, change job.Change) (job.Snapshot, error) {
	return c.alter(ctx, id, func(r *run) error {
		before := r.rec.Request
		change.Apply(&r.rec.Request)
		if after := r.rec.Request; after.Priority != before.Priority {
			r.publish("state", fmt.Sprintf("priority changed from %d to %d", before.Priority, after.Priority), nil)
			if r.parked != nil {
				c.room.wait(r, after.Priority, r.rec.FilmBytes)
				r.leaveRoomIfGone()
			}
		} else if after.Name != before.Name {
			r.publish("state", "renamed", nil)
		}
		return nil
	})
}

// Cancel implements api.Service.
func (c *Coordinator) Cancel(ctx context.Context, id string) (job.Snapshot, error) {
	if err := c.takeToCancel(ctx, id); err != nil {
		return job.Snapshot{}, err
	}
	return c.alter(ctx, id, func(r *run) error {
		r.end(job.Canceled, "canceled by the user")
		return nil
	})
}

// Pause implements api.Service. Work under way is still taken.
func (c *Coordinator) Pause(ctx context.Context, id string) (job.Snapshot, error) {
	return c.alter(ctx, id, func(r *run) error {
		if !r.rec.Paused {
			r.rec.Paused = true
			r.stopClock()
			r.standBack()
			r.publish("state", "paused", nil)
		}
		return nil
	})
}

// Resume implements api.Service.
func (c *Coordinator) Resume(ctx context.Context, id string) (job.Snapshot, error) {
	return c.alter(ctx, id, func(r *run) error {
		if r.rec.Paused {
			r.unpause()
			r.publish("state", "resumed", nil)
		}
		return nil
	})
}

// Finish implements api.Service. A paused job is resumed: its last round has to be completed.
func (c *Coordinator) Finish(ctx context.Context, id string) (job.Snapshot, error) {
	return c.alter(ctx, id, func(r *run) error {
		r.unpause()
		r.decideLast(round.StopFinished)
		r.publish("state", "finishing with the round under way", nil)
		return nil
	})
}

// Convergence implements api.Service.
func (c *Coordinator) Convergence(ctx context.Context, id string) ([]job.ConvergencePoint, error) {
	r, err := c.find(ctx, id)
	if err != nil {
		return nil, err
	}
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State.Ended() || r.state == nil {
		return slices.Clone(r.rec.Convergence), nil
	}
	return r.state.History(), nil
}

// SceneReport implements api.Service.
func (c *Coordinator) SceneReport(ctx context.Context, id string) (string, error) {
	r, err := c.find(ctx, id)
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
	// A job at rest may be deleted or go on elsewhere: what happens from now on ends the stream.
	atRest, end := context.WithCancel(ctx)
	stop := c.news.listen(id, end)
	r, err := c.find(ctx, id)
	if err != nil {
		stop()
		end()
		return nil, nil, err
	}
	if r.gone.Load() {
		context.AfterFunc(ctx, stop)
	} else {
		stop() // its owner closes its streams
	}
	return r.follow(atRest, after)
}
