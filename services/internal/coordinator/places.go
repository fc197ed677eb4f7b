package coordinator

import (
	"context"
	"fmt"
	"time"

	"golang.org/x/sync/semaphore"

	"metrofarm/services/internal/job"
)

// maxReaders is how many checkpoints of jobs that have ended are in memory at a time.
const maxReaders = 2

// readers bounds the checkpoints that requests read: two at a time, and one alone where two of its
// size would take more than half of what films may.
type readers struct {
	slots *semaphore.Weighted
	films int64 // 0: no bound
}

func newReaders(films int64) *readers {
	return &readers{slots: semaphore.NewWeighted(maxReaders), films: films}
}

// enter waits until the checkpoint of a job may be read, in order of arrival. done is to be called when
// it is not needed any more. Fails with job.ErrUnavailable after the patience.
func (r *readers) enter(ctx context.Context, id string, film int64, patience time.Duration) (done func(), err error) {
	slots := int64(1)
	if r.films > 0 && maxReaders*film > r.films/2 {
		slots = maxReaders
	}
	waiting, cancel := context.WithTimeout(ctx, patience)
	defer cancel()
	if err := r.slots.Acquire(waiting, slots); err != nil {
		if ctx.Err() != nil {
			return nil, ctx.Err()
		}
		return nil, fmt.Errorf("job %s: the checkpoints of other jobs are being read: %w", id, job.ErrUnavailable)
	}
	return func() { r.slots.Release(slots) }, nil
}
