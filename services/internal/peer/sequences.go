package peer

import (
	"context"
	"errors"
	"fmt"
	"net/http"
	"net/url"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// The frames of a sequence may belong to several coordinators. A request about the whole is answered by
// the one that was asked, which asks the owners of the frames; requests about single jobs never get here
// for jobs of others, they are forwarded.

// Sequence implements api.Service. The owners say how their frames are.
func (f *Farm) Sequence(ctx context.Context, id string) (job.Sequence, error) {
	q, err := f.Coordinator.Sequence(ctx, id)
	if err != nil || alone(ctx) {
		return q, err
	}
	urls := make(map[string]bool)
	for i := range q.Frames {
		if owner := q.Frames[i].Owner; owner != "" {
			urls[owner] = true
		}
	}
	owners, err := f.at(ctx, urls)
	if err != nil {
		return q, err
	}
	live := make(map[string]job.Snapshot)
	for _, answer := range ask(ctx, f, owners, f.jobsOf) {
		for _, j := range answer {
			live[j.ID] = j
		}
	}
	for i := range q.Frames {
		if j, found := live[q.Frames[i].Job]; found && q.Frames[i].Owner != "" {
			q.Frames[i].Take(j)
		}
	}
	q.SetFrames(q.Frames)
	return q, nil
}

// Cancel implements api.Service.
func (f *Farm) Cancel(ctx context.Context, id string) (job.Snapshot, error) {
	return f.act(ctx, id, "cancel", f.Coordinator.Cancel)
}

// Pause implements api.Service.
func (f *Farm) Pause(ctx context.Context, id string) (job.Snapshot, error) {
	return f.act(ctx, id, "pause", f.Coordinator.Pause)
}

// Resume implements api.Service.
func (f *Farm) Resume(ctx context.Context, id string) (job.Snapshot, error) {
	return f.act(ctx, id, "resume", f.Coordinator.Resume)
}

// act lets the owner of a job do something to it.
func (f *Farm) act(ctx context.Context, id, action string, here func(context.Context, string) (job.Snapshot, error)) (s job.Snapshot, err error) {
	owner, err := f.ownerOf(ctx, id)
	switch {
	case err != nil:
		return s, err
	case owner.REST == "":
		return here(ctx, id)
	}
	err = f.call(ctx, http.MethodPost, owner, "/v1/jobs/"+url.PathEscape(id)+"/"+action, &s)
	return s, told(id, err)
}

// Delete implements api.Service.
func (f *Farm) Delete(ctx context.Context, id string) error {
	owner, err := f.ownerOf(ctx, id)
	switch {
	case err != nil:
		return err
	case owner.REST == "":
		return f.Coordinator.Delete(ctx, id)
	}
	return told(id, f.call(ctx, http.MethodDelete, owner, "/v1/jobs/"+url.PathEscape(id), nil))
}

// ownerOf a job, the zero Member if it is this coordinator's to act on.
func (f *Farm) ownerOf(ctx context.Context, id string) (store.Member, error) {
	if alone(ctx) {
		return store.Member{}, nil
	}
	return f.Owner(ctx, id)
}

// told is the error of what another coordinator was asked to do.
func told(id string, err error) error {
	switch {
	case err == nil:
		return nil
	case errors.Is(err, job.ErrNotFound), errors.Is(err, job.ErrConflict):
		return fmt.Errorf("job %s: %w", id, err)
	default:
		return fmt.Errorf("job %s: %w: %w", id, job.ErrUnavailable, err)
	}
}
