package sweep

import (
	"context"
	"errors"
	"fmt"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// pageLength is how many jobs are asked for at once.
const pageLength = 500

// StoredJobs are those of a store, of all coordinators that share it.
type StoredJobs struct {
	Store store.Store
	// Coordinator deletes jobs that it owns, and those that nobody owns, which it acquires first.
	Coordinator interface {
		DeleteEnded(ctx context.Context, id string, end time.Time) error
	}
}

// Jobs implements Jobs. The frames of a sequence go together: each stays as long as the one that ended last.
func (s StoredJobs) Jobs(ctx context.Context) ([]Job, error) {
	var jobs []Job
	frames := make(map[string][]int) // indices in jobs, by sequence
	for before := uint64(0); ; {
		page, err := s.Store.Jobs(ctx, before, pageLength)
		if err != nil {
			return nil, fmt.Errorf("listing jobs: %w", err)
		}
		for _, r := range page {
			j := Job{ID: r.ID, Scene: r.Request.Scene, Checkpoint: r.Checkpoint}
			if r.State.Ended() && r.EndedAt != nil {
				j.EndedAt, j.KeptFrom = *r.EndedAt, *r.EndedAt
			}
			if r.FrameOf != nil {
				frames[r.FrameOf.ID] = append(frames[r.FrameOf.ID], len(jobs))
			}
			jobs = append(jobs, j)
		}
		if len(page) < pageLength {
			keepTogether(jobs, frames)
			return jobs, nil
		}
		before = page[len(page)-1].Number
	}
}

// keepTogether keeps the frames of each sequence from the latest of their ends, or for good if one has not
// ended.
func keepTogether(jobs []Job, frames map[string][]int) {
	for _, indices := range frames {
		last := jobs[indices[0]].EndedAt
		for _, i := range indices {
			if end := jobs[i].EndedAt; last.IsZero() || end.IsZero() {
				last = time.Time{}
			} else if end.After(last) {
				last = end
			}
		}
		for _, i := range indices {
			jobs[i].KeptFrom = last
		}
	}
}

// Delete implements Jobs. A job that another coordinator has just deleted is no error.
func (s StoredJobs) Delete(ctx context.Context, j Job) error {
	if err := s.Coordinator.DeleteEnded(ctx, j.ID, j.EndedAt); !errors.Is(err, job.ErrNotFound) {
		return err
	}
	return nil
}
