package coordinator

import (
	"context"
	"fmt"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Delete implements api.Service.
func (c *Coordinator) Delete(ctx context.Context, id string) error {
	r := c.running(id)
	if r == nil {
		return c.deleteStored(ctx, id)
	}
	if err := r.lockAtRest(ctx); err != nil {
		return err
	}
	if r.gone.Load() { // it was given up as soon as its checkpoint was written
		r.mu.Unlock()
		if _, err := c.atRest(ctx, id); err != nil {
			return err
		}
		return c.deleteStored(ctx, id)
	}
	if !r.rec.State.Ended() {
		defer r.mu.Unlock()
		return undeletable(&r.rec)
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

func undeletable(rec *store.Record) error {
	return fmt.Errorf("job %s is %s; cancel it first: %w", rec.ID, rec.State, job.ErrConflict)
}

// deleteStored deletes a job that has ended; to do so it must be owned.
func (c *Coordinator) deleteStored(ctx context.Context, id string) error {
	r, err := c.find(ctx, id)
	if err != nil {
		return err
	}
	if !r.rec.State.Ended() {
		return undeletable(&r.rec)
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
