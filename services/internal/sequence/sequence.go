// Package sequence does to all frames of a sequence what is done to jobs one by one. Each frame's change
// is stored by itself; what was interrupted can be repeated.
package sequence

import (
	"context"
	"errors"
	"fmt"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Service is what this package needs of a coordinator; api.Service has it.
type Service interface {
	Sequence(ctx context.Context, id string) (job.Sequence, error)
	Cancel(ctx context.Context, id string) (job.Snapshot, error)
	Pause(ctx context.Context, id string) (job.Snapshot, error)
	Resume(ctx context.Context, id string) (job.Snapshot, error)
	Delete(ctx context.Context, id string) error
}

// Cancel ends the frames that have not ended; the images so far stay.
func Cancel(ctx context.Context, s Service, id string) (job.Sequence, error) {
	return act(ctx, s, id, s.Cancel)
}

// Pause stops handing out work of the frames that have not ended.
func Pause(ctx context.Context, s Service, id string) (job.Sequence, error) {
	return act(ctx, s, id, s.Pause)
}

// Resume goes on with the frames that are paused.
func Resume(ctx context.Context, s Service, id string) (job.Sequence, error) {
	return act(ctx, s, id, s.Resume)
}

// act does something to each frame that has not ended. The last goes first: a worker that is free
// meanwhile shall not begin with one of which it is taken away at once. A frame that is not available at
// the moment keeps none of the others waiting; the first such error is returned at the end. Where the store
// is out of reach none of them is available, and each would be waited for.
func act(ctx context.Context, s Service, id string, do func(context.Context, string) (job.Snapshot, error)) (job.Sequence, error) {
	q, err := s.Sequence(ctx, id)
	if err != nil {
		return q, err
	}
	var unavailable error
	for i := len(q.Frames) - 1; i >= 0; i-- {
		f := &q.Frames[i]
		if f.State == job.Deleted || f.State.Ended() {
			continue
		}
		_, err := do(ctx, f.Job)
		if err == nil || ended(err) {
			continue
		}
		err = fmt.Errorf("frame %d: %w", f.Number, err)
		if ctx.Err() != nil || errors.Is(err, store.ErrUnavailable) || !errors.Is(err, job.ErrUnavailable) {
			return q, err
		}
		if unavailable == nil {
			unavailable = err
		}
	}
	if unavailable != nil {
		return q, unavailable
	}
	return s.Sequence(ctx, id)
}

// ended tells whether an action came too late for a frame.
func ended(err error) bool { return errors.Is(err, job.ErrConflict) || errors.Is(err, job.ErrNotFound) }

// Delete removes a sequence all of whose frames have ended, with their jobs, images and events. The
// sequence goes with its last job, so that what is interrupted can be repeated.
func Delete(ctx context.Context, s Service, id string) error {
	q, err := s.Sequence(ctx, id)
	if err != nil {
		return err
	}
	for _, f := range q.Frames {
		if f.State != job.Deleted && !f.State.Ended() {
			return fmt.Errorf("frame %d of %s is %s; cancel the sequence first: %w", f.Number, id, f.State, job.ErrConflict)
		}
	}
	for _, f := range q.Frames {
		if f.State == job.Deleted {
			continue
		}
		if err := s.Delete(ctx, f.Job); err != nil && !errors.Is(err, job.ErrNotFound) {
			return fmt.Errorf("frame %d: %w", f.Number, err)
		}
	}
	return nil
}
