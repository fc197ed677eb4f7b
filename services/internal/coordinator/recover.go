package coordinator

import (
	"context"
	"errors"
	"fmt"
	"strings"

	"google.golang.org/protobuf/proto"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// blobPrefix of checkpoints among the named blobs.
const blobPrefix = "checkpoint-"

// recover rebuilds the jobs from the store and their checkpoints.
func (c *Coordinator) recover(ctx context.Context) error {
	records, err := c.options.Store.Jobs(ctx)
	if err != nil {
		return err
	}
	kept := make(map[string]bool)
	for _, rec := range records {
		r := c.newRun(rec)
		kept[rec.Checkpoint] = true
		c.jobs[rec.ID] = r
		c.order = append(c.order, r)
		if !rec.State.Ended() {
			r.mu.Lock()
			r.resume()
			r.mu.Unlock()
		}
	}
	return c.removeOrphans(kept)
}

// removeOrphans deletes checkpoints that no record points to: a crash came between writing one and
// swinging the pointer, or between that and deleting the old one.
func (c *Coordinator) removeOrphans(kept map[string]bool) error {
	names, err := c.options.Blobs.BlobNames()
	if err != nil {
		return err
	}
	for _, name := range names {
		if strings.HasPrefix(name, blobPrefix) && !kept[name] {
			if err := c.options.Blobs.DeleteBlob(name); err != nil {
				return err
			}
		}
	}
	return nil
}

// resume puts a job back to where its checkpoint was; without one it begins again, to the same
// bits. Requires: mu.
func (r *run) resume() {
	if err := r.load(); err != nil {
		r.publish("fault", fmt.Sprintf("the checkpoint cannot be used, the job begins again: %v", err), nil)
	}
	if r.state == nil {
		r.rec.State, r.rec.Warnings = job.Queued, nil
		r.startInspection()
	} else {
		r.rec.State = job.Rendering
		r.startClock()
		r.openTasks()
	}
	r.publish("state", "the coordinator was restarted", nil)
	r.save()
}

// load reads the job's checkpoint into memory, if there is one. Requires: mu.
func (r *run) load() error {
	if r.rec.Checkpoint == "" {
		return nil
	}
	c, err := r.c.readCheckpoint(r.rec)
	if err != nil {
		return err
	}
	report := &scenev1.SceneReport{}
	if err := proto.Unmarshal(c.Extra.Report, report); err != nil {
		return fmt.Errorf("scene report: %w", err)
	}
	r.state, r.spec, r.report, r.extra = c.State, c.State.Spec, report, c.Extra
	r.lastCheckpoint = r.c.options.Now()
	return nil
}

func (c *Coordinator) readCheckpoint(rec store.Record) (checkpoint.Checkpoint, error) {
	blob, err := c.options.Blobs.OpenBlob(rec.Checkpoint)
	if err != nil {
		return checkpoint.Checkpoint{}, err
	}
	read, err := checkpoint.Read(blob)
	return read, errors.Join(err, blob.Close())
}
