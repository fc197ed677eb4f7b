package coordinator

import (
	"context"
	"fmt"
	"time"

	"golang.org/x/sync/semaphore"

	"metrofarm/services/internal/job"
)

const (
	// maxReaders is how many checkpoints of jobs that have ended are in memory at a time.
	maxReaders = 2
	// maxDevelopers is how many films of jobs in memory are developed at a time: each takes as much again.
	maxDevelopers = 4
)

// places bound what requests do with films beside those that the budget holds: so many at a time, and one
// alone where so many of its size would take more than half of what films may.
type places struct {
	slots *semaphore.Weighted
	count int64
	films int64  // 0: no bound
	busy  string // what is going on where there is no place
}

func newPlaces(count, films int64, busy string) *places {
	return &places{slots: semaphore.NewWeighted(count), count: count, films: films, busy: busy}
}

// enter waits until there is a place for the film of a job, in order of arrival. done is to be called when
// it is not needed any more. Fails with job.ErrUnavailable after the patience.
func (p *places) enter(ctx context.Context, id string, film int64, patience time.Duration) (done func(), err error) {
	slots := int64(1)
	if p.films > 0 && p.count*film > p.films/2 {
		slots = p.count
	}
	waiting, cancel := context.WithTimeout(ctx, patience)
	defer cancel()
	if err := p.slots.Acquire(waiting, slots); err != nil {
		if ctx.Err() != nil {
			return nil, ctx.Err()
		}
		return nil, fmt.Errorf("job %s: %s: %w", id, p.busy, job.ErrUnavailable)
	}
	return func() { p.slots.Release(slots) }, nil
}
