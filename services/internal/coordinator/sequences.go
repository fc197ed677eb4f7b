package coordinator

import (
	"context"
	"errors"
	"fmt"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// A sequence is created whole or not at all, in one step of the store. From then on its frames are jobs
// like others: the coordinator that created them owns them, unless it dies before it knows; their leases
// then run out and others take them over. Nobody owns a sequence, and nothing of it changes: what there is
// to know about it the frames know.

// SubmitSequence implements api.Service.
func (c *Coordinator) SubmitSequence(ctx context.Context, request job.SequenceRequest, key string) (job.Sequence, error) {
	if err := c.checkSequence(ctx, &request); err != nil {
		return job.Sequence{}, err
	}
	if err := checkKey(key); err != nil {
		return job.Sequence{}, err
	}
	unranked := request
	unranked.Job.Priority = 0
	fingerprint, err := fingerprint(unranked)
	if err != nil {
		return job.Sequence{}, err
	}
	c.submitMu.Lock()
	defer c.submitMu.Unlock()
	if err := c.checkCrowd(auth.From(ctx).User, request.Frames.Count()); err != nil {
		return job.Sequence{}, err
	}
	q, jobs := c.newSequence(request, auth.From(ctx).User)
	stored, created, err := c.options.Store.CreateSequence(ctx, c.claim(), q, jobs, key, fingerprint)
	if errors.Is(err, store.ErrKeyReused) {
		return job.Sequence{}, fmt.Errorf("%w: %w", job.ErrConflict, err)
	}
	if err != nil {
		return job.Sequence{}, fmt.Errorf("submit: %w", err)
	}
	if created {
		c.log.InfoContext(ctx, "sequence accepted", "sequence", stored.ID, "user", stored.User, "frames", len(jobs))
		for i := range jobs {
			jobs[i].Number = stored.Number + uint64(i)
		}
		c.admitFrames(jobs)
	}
	return c.Sequence(ctx, stored.ID)
}

// checkSequence looks at what the frames have in common, and at one of them.
func (c *Coordinator) checkSequence(ctx context.Context, s *job.SequenceRequest) error {
	if err := s.Validate(); err != nil {
		return err
	}
	err := c.checkRequest(ctx, &s.Job)
	var field *job.FieldError
	if errors.As(err, &field) {
		return field.In("job")
	}
	return err
}

// newSequence makes the records of a sequence and its jobs. Requires: the request was checked.
func (c *Coordinator) newSequence(request job.SequenceRequest, user string) (store.Sequence, []store.Record) {
	name, now := c.options.NewID(), c.options.Now()
	q := store.Sequence{ID: job.SequencePrefix + name, User: user, Request: request, CreatedAt: now}
	jobs := make([]store.Record, request.Frames.Count())
	for i := range jobs {
		number := request.Frames.Number(i)
		jobs[i] = store.Record{
			ID: fmt.Sprintf("job-%s-f%d", name, number), User: user, FrameOf: &job.FrameOf{ID: q.ID, Frame: number},
			Request: request.Frame(i), State: job.Queued, CreatedAt: now,
		}
		q.Jobs = append(q.Jobs, jobs[i].ID)
	}
	return q, jobs
}

// admitFrames makes jobs run that were just created, under their first epoch. That they were accepted is
// stored by housekeeping, which lets none of them be leased before: a write for each would keep the
// answer waiting.
func (c *Coordinator) admitFrames(jobs []store.Record) {
	for _, rec := range jobs {
		r := c.newRun(rec, 1)
		r.mu.Lock()
		r.behind = true
		r.rec.Sequence = sequenceReserve
		r.startInspection()
		c.insert(r)
		r.publish("state", "accepted", nil)
		r.mu.Unlock()
	}
	c.wake()
}

// Sequence implements api.Service. Frames whose jobs other coordinators own are marked as stale.
func (c *Coordinator) Sequence(ctx context.Context, id string) (job.Sequence, error) {
	q, err := c.options.Store.Sequence(ctx, id)
	if errors.Is(err, job.ErrNotFound) {
		return job.Sequence{}, fmt.Errorf("sequence %q: %w", id, job.ErrNotFound)
	}
	if err != nil {
		return job.Sequence{}, err
	}
	jobs, err := c.options.Store.JobsByID(ctx, q.Jobs)
	if err != nil {
		return job.Sequence{}, err
	}
	sequence := viewOf(&q)
	frames, at := make([]job.Frame, len(q.Jobs)), make(map[string]*job.Frame, len(q.Jobs))
	for i, id := range q.Jobs {
		frames[i] = q.Request.NewFrame(i, id)
		at[id] = &frames[i]
	}
	for _, j := range jobs {
		at[j.ID].Take(c.show(j, nil))
	}
	sequence.SetFrames(frames)
	return sequence, nil
}

func viewOf(q *store.Sequence) job.Sequence {
	return job.NewSequence(q.ID, q.User, q.Request, q.CreatedAt, q.States)
}

// Sequences implements api.Service. The states are those that were last stored.
func (c *Coordinator) Sequences(ctx context.Context, cursor string, limit int) ([]job.Sequence, string, error) {
	page, next, err := readPage(cursor, limit, listed[store.Sequence]{
		noun:   "sequence",
		cursor: func() (uint64, error) { q, err := c.options.Store.Sequence(ctx, cursor); return q.Number, err },
		read: func(before uint64, n int) ([]store.Sequence, error) {
			return c.options.Store.Sequences(ctx, before, n)
		},
		id: func(q *store.Sequence) string { return q.ID },
	})
	if err != nil {
		return nil, "", err
	}
	sequences := make([]job.Sequence, len(page))
	for i := range page {
		sequences[i] = viewOf(&page[i])
	}
	return sequences, next, nil
}
