package coordinator

import (
	"context"
	"slices"
	"sync"

	"metrofarm/services/internal/store"
)

// news is what a coordinator has heard of jobs at rest. They are nobody's, so whoever deletes one or
// lets it go on notes that in the store, where the others look.
type news struct {
	mu        sync.Mutex
	mark      string   // of the store: what came before it was heard
	deleted   []string // the latest, at most store.MaxChanges
	count     uint64   // of all that were deleted
	listeners map[string]map[*listener]struct{}
}

// listener waits for a change of one job.
type listener struct{ call func() }

// listen has a function called when a job at rest is deleted or goes on, wherever that happens, until
// stop is called.
func (n *news) listen(id string, call func()) (stop func()) {
	l := &listener{call}
	n.mu.Lock()
	defer n.mu.Unlock()
	if n.listeners == nil {
		n.listeners = make(map[string]map[*listener]struct{})
	}
	if n.listeners[id] == nil {
		n.listeners[id] = make(map[*listener]struct{})
	}
	n.listeners[id][l] = struct{}{}
	return func() {
		n.mu.Lock()
		defer n.mu.Unlock()
		delete(n.listeners[id], l)
		if len(n.listeners[id]) == 0 {
			delete(n.listeners, id)
		}
	}
}

// take notes what was heard and returns whom to tell.
func (n *news) take(heard []store.Change, mark string) (concerned []*listener) {
	n.mu.Lock()
	defer n.mu.Unlock()
	n.mark = mark
	for _, change := range heard {
		for l := range n.listeners[change.ID] {
			concerned = append(concerned, l)
		}
		if change.Deleted {
			n.deleted = append(n.deleted, change.ID)
			n.count++
		}
	}
	if extra := len(n.deleted) - store.MaxChanges; extra > 0 {
		n.deleted = slices.Delete(n.deleted, 0, extra)
	}
	return concerned
}

// since returns the deleted jobs after the first so many, and how many there are.
func (n *news) since(count uint64) ([]string, uint64) {
	n.mu.Lock()
	defer n.mu.Unlock()
	fresh := min(n.count-min(count, n.count), uint64(len(n.deleted)))
	return slices.Clone(n.deleted[uint64(len(n.deleted))-fresh:]), n.count
}

// hearOfChanges looks at what happened to jobs at rest. Only one goroutine at a time calls it.
func (c *Coordinator) hearOfChanges(ctx context.Context) error {
	c.news.mu.Lock()
	mark := c.news.mark
	c.news.mu.Unlock()
	heard, next, err := c.options.Store.Changes(ctx, mark)
	if err != nil {
		return err
	}
	for _, l := range c.news.take(heard, next) {
		l.call()
	}
	return nil
}

// Deleted implements api.Service.
func (c *Coordinator) Deleted(after uint64) (ids []string, last uint64) { return c.news.since(after) }
