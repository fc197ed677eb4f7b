package coordinator

import (
	"cmp"
	"context"
	"fmt"
	"slices"
	"strings"
	"time"

	"metrofarm/services/internal/job"
)

// forgetAfter is how long a lost worker stays in the list.
const forgetAfter = 10 * time.Minute

// worker is one worker process. Guarded by Coordinator.mu.
type worker struct {
	id, name, version, instance string
	threads                     int
	lastContact                 time.Time
	draining                    bool
	activity                    string
	conflicts                   int    // batches and reports that cannot be right, batches that another worker contradicts
	exclusion                   string // why it gets no more work; empty if it does
	damaged                     int    // batches and reports that contradicted themselves; halved by each batch that is merged
	quarantined                 time.Time
	meter                       meter
}

// findWorker returns a copy of what is known of a worker and notes the contact. job.ErrNotFound
// makes the worker register again.
func (c *Coordinator) findWorker(id string) (worker, error) {
	c.mu.Lock()
	w := c.workers[id]
	if w == nil {
		c.mu.Unlock()
		return worker{}, fmt.Errorf("worker %q: %w", id, job.ErrNotFound)
	}
	back := c.lost(w)
	w.lastContact = c.options.Now()
	found := worker{
		id: w.id, name: w.name, version: w.version, threads: w.threads, draining: w.draining, quarantined: w.quarantined,
	}
	c.mu.Unlock()
	if back {
		c.forgive(id)
	}
	return found, nil
}

// forgive takes back what was held against tasks because a worker was lost with them: it was only out of
// reach.
func (c *Coordinator) forgive(id string) {
	for _, r := range c.runs() {
		r.mu.Lock()
		r.table.Forgive(id)
		r.mu.Unlock()
	}
}

// hearsOf tells whether a worker of a version was heard of within a lease's time.
func (c *Coordinator) hearsOf(version string) bool {
	c.mu.Lock()
	defer c.mu.Unlock()
	for _, w := range c.workers {
		if w.version == version && !c.lost(w) {
			return true
		}
	}
	return false
}

// lost tells whether a worker is silent for longer than a lease lives. Requires: mu. A worker that
// waits for a lease counts as heard of: its call looks for work, and here, every second.
func (c *Coordinator) lost(w *worker) bool {
	return c.options.Now().Sub(w.lastContact) > c.options.LeaseTTL
}

// lostWorkers tells which of these workers are lost. Who has left is not.
func (c *Coordinator) lostWorkers(ids map[string]int) map[string]bool {
	c.mu.Lock()
	defer c.mu.Unlock()
	lost := make(map[string]bool)
	for id := range ids {
		w := c.workers[id]
		lost[id] = w != nil && c.lost(w)
	}
	return lost
}

// credit counts the mutations of a worker's merged batch.
func (c *Coordinator) credit(id string, mutations uint64) {
	c.mu.Lock()
	defer c.mu.Unlock()
	if w := c.workers[id]; w != nil {
		w.meter.add(mutations, c.options.Now())
		w.damaged /= 2
	}
}

// flag notes that a worker delivered what cannot be right.
func (c *Coordinator) flag(id string) {
	c.mu.Lock()
	defer c.mu.Unlock()
	if w := c.workers[id]; w != nil {
		w.conflicts++
		c.metrics.conflicts.Inc()
		c.log.Warn("worker sent what cannot be right", "worker", w.id, "name", w.name, "version", w.version, "conflicts", w.conflicts)
	}
}

// unflag takes a flag back: another worker was at fault.
func (c *Coordinator) unflag(id string) {
	c.mu.Lock()
	defer c.mu.Unlock()
	if w := c.workers[id]; w != nil && w.conflicts > 0 {
		w.conflicts--
	}
}

// exclude drains a worker that was found to render wrong.
func (c *Coordinator) exclude(id, reason string) {
	c.mu.Lock()
	defer c.mu.Unlock()
	if w := c.workers[id]; w != nil {
		if w.exclusion == "" {
			c.metrics.excluded.Inc()
		}
		w.draining, w.exclusion = true, reason
		c.rouse()
		c.log.Error("worker is excluded", "worker", w.id, "name", w.name, "version", w.version, "reason", reason)
	}
}

// isExcluded tells whether a worker was found to render wrong.
func (c *Coordinator) isExcluded(id string) bool {
	c.mu.Lock()
	defer c.mu.Unlock()
	w := c.workers[id]
	return w != nil && w.exclusion != ""
}

// excluded lists the workers that were found to render wrong.
func (c *Coordinator) excluded() map[string]bool {
	c.mu.Lock()
	defer c.mu.Unlock()
	var excluded map[string]bool
	for id, w := range c.workers {
		if w.exclusion == "" {
			continue
		}
		if excluded == nil {
			excluded = make(map[string]bool)
		}
		excluded[id] = true
	}
	return excluded
}

// renders tells whether a worker may be counted on: it is heard of, and neither draining, excluded (which
// drains it) nor in quarantine. Requires: mu.
func (c *Coordinator) renders(w *worker) bool {
	return !c.lost(w) && !w.draining && !w.inQuarantine(c.options.Now())
}

// renderers lists the workers of a version that may be counted on; of any version if that is empty.
func (c *Coordinator) renderers(version string) []string {
	c.mu.Lock()
	defer c.mu.Unlock()
	var ids []string
	for id, w := range c.workers {
		if (version == "" || w.version == version) && c.renders(w) {
			ids = append(ids, id)
		}
	}
	return ids
}

// eligible lists the workers that could get tasks of this job now. Requires: mu.
func (r *run) eligible() []string {
	return slices.DeleteFunc(r.c.renderers(r.spec.GetWorkerVersion()), func(id string) bool { return r.checks.suspects[id] })
}

// threadsOf counts the render threads of the workers of a version that may be counted on.
func (c *Coordinator) threadsOf(version string) int {
	c.mu.Lock()
	defer c.mu.Unlock()
	n := 0
	for _, w := range c.workers {
		if w.version == version && c.renders(w) {
			n += max(w.threads, 1)
		}
	}
	return n
}

// describe names a worker for people.
func (c *Coordinator) describe(id string) string {
	c.mu.Lock()
	defer c.mu.Unlock()
	if w := c.workers[id]; w != nil {
		return fmt.Sprintf("%s (%s)", w.name, id)
	}
	if id == unknown {
		return "that delivered to this job's coordinator before"
	}
	return id
}

func (c *Coordinator) describeAll(ids []string) string {
	described := make([]string, len(ids))
	for i, id := range ids {
		described[i] = c.describe(id)
	}
	return strings.Join(described, ", ")
}

func (c *Coordinator) forgetWorkers() {
	c.mu.Lock()
	defer c.mu.Unlock()
	for id, w := range c.workers {
		if c.options.Now().Sub(w.lastContact) > forgetAfter {
			delete(c.workers, id)
		}
	}
}

// Workers implements api.Service.
func (c *Coordinator) Workers(context.Context) ([]job.Worker, error) {
	held := c.heldByWorker()
	c.mu.Lock()
	defer c.mu.Unlock()
	views := make([]job.Worker, 0, len(c.workers))
	for _, w := range c.workers {
		views = append(views, c.workerView(w, held[w.id]))
	}
	slices.SortFunc(views, func(a, b job.Worker) int {
		return cmp.Or(cmp.Compare(a.Name, b.Name), cmp.Compare(a.ID, b.ID))
	})
	return views, nil
}

// heldByWorker counts leases by worker, over all jobs.
func (c *Coordinator) heldByWorker() map[string]int {
	held := make(map[string]int)
	for _, r := range c.runs() {
		r.mu.Lock()
		r.table.CountHeld(held)
		r.mu.Unlock()
	}
	return held
}

// workerView requires: mu.
func (c *Coordinator) workerView(w *worker, held int) job.Worker {
	state := "idle"
	switch {
	case c.lost(w):
		state = "lost"
	case w.draining:
		state = "draining"
	case w.inQuarantine(c.options.Now()):
		state = "quarantined"
	case held > 0:
		state = "busy"
	}
	return job.Worker{
		ID: w.id, Name: w.name, Version: w.version, Threads: w.threads, State: state,
		LastContact: w.lastContact, LeasedSegments: held, Activity: w.activity,
		MutationsPerSecond: w.meter.rate(c.options.Now()),
		Conflicts:          w.conflicts, Exclusion: w.exclusion,
	}
}

// Drain implements api.Service.
func (c *Coordinator) Drain(_ context.Context, id string) (job.Worker, error) {
	held := c.heldByWorker()
	c.mu.Lock()
	defer c.mu.Unlock()
	w := c.workers[id]
	if w == nil {
		return job.Worker{}, fmt.Errorf("worker %q: %w", id, job.ErrNotFound)
	}
	w.draining = true
	c.rouse() // a waiting lease call then tells the worker
	return c.workerView(w, held[id]), nil
}
