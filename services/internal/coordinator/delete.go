package coordinator

import (
	"context"
	"fmt"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Delete implements api.Service.
func (c *Coordinator) Delete(ctx context.Context, id string) error {
	return c.delete(ctx, id, deletable)
}

// DeleteEnded deletes a job that ended at the given time. One that has gone on since fails with
// job.ErrConflict.
func (c *Coordinator) DeleteEnded(ctx context.Context, id string, end time.Time) error {
	return c.delete(ctx, id, func(rec *store.Record) error {
		if err := deletable(rec); err != nil {
			return err
		}
		if rec.EndedAt == nil || !rec.EndedAt.Equal(end) {
			return fmt.Errorf("job %s has gone on since it ended at %s: %w", rec.ID, end.Format(time.RFC3339), job.ErrConflict)
		}
		return nil
	})
}

// delete a job if it may be. The record that is asked about is that which is deleted.
func (c *Coordinator) delete(ctx context.Context, id string, may func(*store.Record) error) error {
	r := c.running(id)
	if r == nil {
		return c.deleteStored(ctx, id, may)
	}
	if err := r.lockAtRest(ctx); err != nil {
		return err
	}
	if r.gone.Load() { // it was given up as soon as its checkpoint was written
		r.mu.Unlock()
		if _, err := c.atRest(ctx, id); err != nil {
			return err
		}
		return c.deleteStored(ctx, id, may)
	}
	if err := may(&r.rec); err != nil {
		r.mu.Unlock()
		return err
	}
	r.state, r.dirty = nil, false
	unneeded := append(r.garbage, checkpointsOf(&r.rec)...)
	err := c.options.Store.DeleteJob(ctx, r.epoch, id)
	if err == nil {
		r.gone.Store(true)
	}
	r.mu.Unlock()
	if err != nil {
		return fmt.Errorf("delete: %w", err)
	}
	c.mu.Lock()
	c.remove(r)
	c.mu.Unlock()
	r.closeStreams()
	c.discard(ctx, unneeded)
	return nil
}

// lockAtRest locks mu while no checkpoint of a job that has ended is being written, which it ends.
func (r *run) lockAtRest(ctx context.Context) error {
	for {
		r.mu.Lock()
		if !r.rec.State.Ended() {
			return nil
		}
		done := r.cancelTransfer()
		if done == nil {
			return nil
		}
		r.mu.Unlock()
		select {
		case <-done:
		case <-ctx.Done():
			return fmt.Errorf("job %s: its checkpoint is being written: %w", r.id, job.ErrUnavailable)
		}
	}
}

// deletable tells what keeps a job from being deleted.
func deletable(rec *store.Record) error {
	if rec.State.Ended() {
		return nil
	}
	return fmt.Errorf("job %s is %s; cancel it first: %w", rec.ID, rec.State, job.ErrConflict)
}

// deleteStored deletes a job that has ended; to do so it must be owned.
func (c *Coordinator) deleteStored(ctx context.Context, id string, may func(*store.Record) error) error {
	r, err := c.find(ctx, id)
	if err != nil {
		return err
	}
	if err := may(&r.rec); err != nil {
		return err
	}
	c.endedMu.Lock()
	defer c.endedMu.Unlock()
	epoch, err := c.acquireEnded(ctx, &r.rec)
	if err != nil {
		return fmt.Errorf("delete: %w", err)
	}
	if err := c.options.Store.DeleteJob(ctx, epoch, id); err != nil {
		return fmt.Errorf("delete: %w", err)
	}
	c.discard(ctx, checkpointsOf(&r.rec))
	return nil
}

// checkpointsOf a record: one or none.
func checkpointsOf(rec *store.Record) []string {
	if rec.Checkpoint == "" {
		return nil
	}
	return []string{rec.Checkpoint}
}
