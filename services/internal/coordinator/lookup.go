package coordinator

import (
	"context"
	"errors"
	"fmt"
	"slices"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// running returns a job that this coordinator owns, nil if it does not.
func (c *Coordinator) running(id string) *run {
	c.mu.Lock()
	defer c.mu.Unlock()
	return c.jobs[id]
}

// find returns a job to look at: live, or as it was last stored.
func (c *Coordinator) find(ctx context.Context, id string) (*run, error) {
	if r := c.running(id); r != nil && !r.ahead() {
		return r, nil
	}
	j, err := c.options.Store.Job(ctx, id)
	switch {
	case errors.Is(err, job.ErrNotFound):
		return nil, fmt.Errorf("job %q: %w", id, job.ErrNotFound)
	case err != nil:
		return nil, err
	}
	return c.stored(j.Record), nil
}

// ahead tells whether the job has ended, but not in the store: its next owner could see that
// otherwise.
func (r *run) ahead() bool {
	r.mu.Lock()
	defer r.mu.Unlock()
	return r.behind && r.rec.State.Ended()
}

// stored is a job to look at that this coordinator does not own.
func (c *Coordinator) stored(rec store.Record) *run {
	r := c.newRun(rec, 0)
	r.gone.Store(true)
	// Nothing more happens to a job that has ended. Readers of others must look for its owner.
	r.events.closed = !rec.State.Ended()
	if c.room.strangeTo(rec.ID) {
		r.activity = r.waitsForRoom()
	}
	return r
}

// Job implements api.Service.
func (c *Coordinator) Job(ctx context.Context, id string) (job.Snapshot, error) {
	r, err := c.find(ctx, id)
	if err != nil {
		return job.Snapshot{}, err
	}
	snapshot := r.view()
	if r.waits() {
		snapshot.QueuePosition = c.positions()[r]
	}
	return snapshot, nil
}

// view is the job's public view.
func (r *run) view() job.Snapshot {
	r.mu.Lock()
	defer r.mu.Unlock()
	return r.snapshot()
}

// Owner returns the coordinator to ask about a job, the zero Member if it is this one: because it owns
// the job, or because nobody does that can be asked.
func (c *Coordinator) Owner(ctx context.Context, id string) (store.Member, error) {
	if c.running(id) != nil {
		return store.Member{}, nil
	}
	j, err := c.options.Store.Job(ctx, id)
	if errors.Is(err, job.ErrNotFound) {
		return store.Member{}, nil // said by whoever looks
	}
	if err != nil || !c.elsewhere(j.Owner) {
		return store.Member{}, err
	}
	return j.Owner, nil
}

// elsewhere tells whether a member is another one that can be asked.
func (c *Coordinator) elsewhere(m store.Member) bool {
	return m.ID != c.options.Member.ID && m.REST != ""
}

// Peers returns the other coordinators that can be asked.
func (c *Coordinator) Peers(ctx context.Context) ([]store.Member, error) {
	members, err := c.options.Store.Members(ctx)
	if err != nil {
		return nil, err
	}
	return slices.DeleteFunc(members, func(m store.Member) bool { return !c.elsewhere(m) }), nil
}

// Own returns the jobs that this coordinator owns, newest first.
func (c *Coordinator) Own() []job.Snapshot {
	runs := c.runs()
	slices.Reverse(runs)
	snapshots := make([]job.Snapshot, len(runs))
	positions := c.positions()
	for i, r := range runs {
		snapshots[i] = r.view()
		snapshots[i].QueuePosition = positions[r]
	}
	return snapshots
}

// Live implements api.Service: a job that has ended is soon given up.
func (c *Coordinator) Live(context.Context) ([]job.Snapshot, error) { return c.Own(), nil }

// Jobs implements api.Service. Snapshots of jobs that other coordinators own are marked as stale.
func (c *Coordinator) Jobs(ctx context.Context, cursor string, limit int) ([]job.Snapshot, string, error) {
	page, next, err := readPage(cursor, limit, listed[store.Owned]{
		noun:   "job",
		cursor: func() (uint64, error) { j, err := c.options.Store.Job(ctx, cursor); return j.Number, err },
		read:   func(before uint64, n int) ([]store.Owned, error) { return c.options.Store.Jobs(ctx, before, n) },
		id:     func(j *store.Owned) string { return j.ID },
	})
	if err != nil {
		return nil, "", err
	}
	snapshots := make([]job.Snapshot, 0, len(page))
	positions := c.positions()
	for _, j := range page {
		snapshots = append(snapshots, c.show(j, positions))
	}
	return snapshots, next, nil
}

// show is the public view of a job as this coordinator knows it, with its place in the queue.
func (c *Coordinator) show(j store.Owned, positions map[*run]int) job.Snapshot {
	r := c.running(j.ID)
	if r == nil || r.ahead() {
		r = c.stored(j.Record)
	}
	snapshot := r.view()
	snapshot.QueuePosition = positions[r]
	if c.elsewhere(j.Owner) {
		snapshot.Owner = j.Owner.REST
	}
	return snapshot
}

// listed is a list of the store, newest first.
type listed[T any] struct {
	noun   string                                      // of an item, for errors
	cursor func() (uint64, error)                      // number of the item that the cursor names
	read   func(before uint64, limit int) ([]T, error) // items with lower numbers; before 0: all
	id     func(*T) string
}

// readPage returns at most limit items after the one that the cursor names, and the next cursor if there
// are more.
func readPage[T any](cursor string, limit int, list listed[T]) ([]T, string, error) {
	if limit <= 0 {
		limit = defaultPage
	}
	limit = min(limit, maxPage)
	before := uint64(0)
	if cursor != "" {
		var err error
		before, err = list.cursor()
		switch {
		case errors.Is(err, job.ErrNotFound):
			return nil, "", &job.FieldError{Field: "cursor", Detail: "names no " + list.noun}
		case err != nil:
			return nil, "", err
		}
	}
	page, err := list.read(before, limit+1)
	if err != nil || len(page) <= limit {
		return page, "", err
	}
	return page[:limit], list.id(&page[limit-1]), nil
}
