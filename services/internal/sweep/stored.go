package sweep

import (
	"context"
	"errors"
	"fmt"

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
		Delete(ctx context.Context, id string) error
	}
}

// Jobs implements Jobs.
func (s StoredJobs) Jobs(ctx context.Context) ([]Job, error) {
	var jobs []Job
	for before := uint64(0); ; {
		page, err := s.Store.Jobs(ctx, before, pageLength)
		if err != nil {
			return nil, fmt.Errorf("listing jobs: %w", err)
		}
		for _, r := range page {
			j := Job{ID: r.ID, Scene: r.Request.Scene, Checkpoint: r.Checkpoint}
			if r.State.Ended() && r.EndedAt != nil {
				j.EndedAt = *r.EndedAt
			}
			jobs = append(jobs, j)
		}
		if len(page) < pageLength {
			return jobs, nil
		}
		before = page[len(page)-1].Number
	}
}

// Delete implements Jobs. A job that another coordinator has just deleted is no error.
func (s StoredJobs) Delete(ctx context.Context, id string) error {
	if err := s.Coordinator.Delete(ctx, id); !errors.Is(err, job.ErrNotFound) {
		return err
	}
	return nil
}
