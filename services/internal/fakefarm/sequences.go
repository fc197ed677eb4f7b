package fakefarm

import (
	"context"
	"fmt"
	"slices"
	"strconv"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

// sequence is what a sequence is made of.
type sequence struct {
	id, user string
	request  job.SequenceRequest
	jobs     []string
}

// SubmitSequence adds a sequence named seq-1, seq-2, ... with a queued job for each frame.
func (f *Farm) SubmitSequence(ctx context.Context, request job.SequenceRequest, key string) (job.Sequence, error) {
	if err := request.Validate(); err != nil {
		return job.Sequence{}, err
	}
	request.Job.SetDefaultName()
	f.mutex.Lock()
	if id, found := f.keys[key]; found && key != "" {
		f.mutex.Unlock()
		return f.Sequence(ctx, id)
	}
	q := &sequence{id: job.SequencePrefix + strconv.Itoa(len(f.sequences)+1), user: auth.From(ctx).User, request: request}
	f.keys[key] = q.id
	f.sequences = append(f.sequences, q)
	for i := range request.Frames.Count() {
		frame := request.Frame(i)
		q.jobs = append(q.jobs, f.add(ctx, frame, &job.FrameOf{ID: q.id, Frame: request.Frames.Number(i)}))
	}
	f.mutex.Unlock()
	return f.Sequence(ctx, q.id)
}

// Sequence returns one sequence.
func (f *Farm) Sequence(_ context.Context, id string) (job.Sequence, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	for _, q := range f.sequences {
		if q.id == id {
			return f.view(q), nil
		}
	}
	return job.Sequence{}, fmt.Errorf("sequence %q: %w", id, job.ErrNotFound)
}

// view requires: mutex.
func (f *Farm) view(q *sequence) job.Sequence {
	s := job.NewSequence(q.id, q.user, q.request, f.now(), nil)
	frames := make([]job.Frame, len(q.jobs))
	for i, id := range q.jobs {
		frames[i] = q.request.NewFrame(i, id)
		if r := f.jobs[id]; r != nil {
			frames[i].Take(r.snapshot)
		}
	}
	s.SetFrames(frames)
	return s
}

// Sequences lists sequences, newest first.
func (f *Farm) Sequences(_ context.Context, cursor string, limit int) ([]job.Sequence, string, error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	rest := slices.Clone(f.sequences)
	slices.Reverse(rest)
	if cursor != "" {
		i := slices.IndexFunc(rest, func(q *sequence) bool { return q.id == cursor })
		if i < 0 {
			return nil, "", &job.FieldError{Field: "cursor", Detail: "no such sequence"}
		}
		rest = rest[i+1:]
	}
	var page []job.Sequence
	for _, q := range rest[:min(limit, len(rest))] {
		s := f.view(q)
		s.Frames = nil
		page = append(page, s)
	}
	if len(rest) > limit {
		return page, page[limit-1].ID, nil
	}
	return page, "", nil
}
