package coordinator

import (
	"context"
	"errors"
	"fmt"

	"google.golang.org/protobuf/proto"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// checkpointName is new for every checkpoint: with the ownership's epoch in it, an owner that was
// fenced off cannot overwrite a blob of the next one. Requires: mu.
func (r *run) checkpointName() string {
	return fmt.Sprintf("%s%s-%d-%d", checkpoint.BlobPrefix, r.id, r.epoch, r.rec.Checkpoints)
}

// resume puts a job back to where its checkpoint was; without a usable one it begins again, to the
// same bits. It fails if the checkpoint cannot be read now. Requires: mu.
func (r *run) resume(c checkpoint.Checkpoint, err error) error {
	if err == nil {
		err = r.load(c)
	}
	switch {
	case unusable(err):
		r.publish("fault", fmt.Sprintf("the checkpoint cannot be used, the job begins again: %v", err), nil)
	case err != nil:
		return err
	}
	if r.state == nil {
		r.rec.State, r.rec.Warnings = job.Queued, nil
		r.startInspection()
	} else {
		r.rec.State = job.Rendering
		r.startClock()
		r.openTasks()
	}
	r.publish("state", "coordinator "+r.c.options.Member.ID+" goes on with the job", nil)
	r.save()
	return nil
}

// load makes a checkpoint the job's state; the zero Checkpoint means that there is none. Requires: mu.
func (r *run) load(c checkpoint.Checkpoint) error {
	if c.State == nil {
		return nil
	}
	report := &scenev1.SceneReport{}
	if err := proto.Unmarshal(c.Extra.Report, report); err != nil {
		return fmt.Errorf("%w: scene report: %w", checkpoint.ErrCorrupt, err)
	}
	r.state, r.spec, r.report, r.extra = c.State, c.State.Spec, report, c.Extra
	r.lastCheckpoint = r.c.options.Now()
	if r.rec.Refinements > 0 && !r.extend() {
		r.state, r.spec, r.report, r.extra = nil, nil, nil, checkpoint.Extra{}
		return fmt.Errorf("%w: it has more rounds than the job asks for", checkpoint.ErrCorrupt)
	}
	if number := r.rec.Contested; number != nil {
		r.discardFrom(*number)
	}
	r.rec.FilmBytes = r.needs()
	return nil
}

// readInTurn is readCheckpoint for few at a time. A job without checkpoint waits for none.
func (c *Coordinator) readInTurn(ctx context.Context, rec store.Record) (checkpoint.Checkpoint, error) {
	if rec.Checkpoint != "" {
		select {
		case c.reads <- struct{}{}:
		case <-ctx.Done():
			return checkpoint.Checkpoint{}, ctx.Err()
		}
		defer func() { <-c.reads }()
	}
	return c.readCheckpoint(ctx, rec)
}

// readCheckpoint returns the zero Checkpoint if the job has none.
func (c *Coordinator) readCheckpoint(ctx context.Context, rec store.Record) (checkpoint.Checkpoint, error) {
	if rec.Checkpoint == "" {
		return checkpoint.Checkpoint{}, nil
	}
	ctx, cancel := context.WithTimeout(ctx, blobTimeout)
	defer cancel()
	r, err := c.options.Blobs.OpenBlob(ctx, rec.Checkpoint)
	if err != nil {
		return checkpoint.Checkpoint{}, err
	}
	read, err := checkpoint.Read(r)
	return read, errors.Join(err, r.Close())
}
