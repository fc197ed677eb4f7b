package coordinator

import (
	"math"
	"sync/atomic"
	"time"

	"metrofarm/services/internal/fairness"
)

// Which job a free worker gets tasks of is decided by package fairness, anew for every lease call, over
// the jobs that this coordinator owns. Waiting tasks of all jobs come first, in that order, and only
// then copies of tasks that straggle, in the same order. What users used is known to this process alone
// and begins at nothing with it: it matters for minutes.

const (
	// firstCost is the CPU time of a task, in seconds, before any was done.
	firstCost = 1
	// costMemory is the weight of what was known of tasks' cost beside what the last batch took.
	costMemory = 0.5
)

// standing is what the queue looks at in a job. It can be read at any time, without the job's lock,
// which a lease call must not wait for in each of a thousand jobs.
type standing struct {
	priority atomic.Int64
	idle     atomic.Bool   // nothing of the job is to be leased
	ended    atomic.Bool   // it only waits to be stored with all that belongs to it
	cost     atomic.Uint64 // bits of the CPU time of a task, in seconds; 0 while unknown
}

// updateStanding requires: mu. What it depends on is changed before a save.
func (r *run) updateStanding() {
	r.standing.priority.Store(int64(r.rec.Request.Priority))
	r.standing.ended.Store(r.rec.State.Ended())
	r.standing.idle.Store(r.rec.Paused || r.rec.State.Ended() || r.finishing != nil || r.loading)
}

// waits tells whether a task of the job waits for a worker.
func (r *run) waits() bool {
	return !r.standing.idle.Load() && !r.gone.Load() && r.table.Waiting() > 0
}

// ripens tells whether a lease may have run out, or a copy of a task may be worth it.
func (r *run) ripens(now time.Time) bool {
	return !r.standing.idle.Load() && !r.gone.Load() && r.table.Ripe(now)
}

// queue lists the jobs that want a worker, first which goes first. most bounds the list.
func (c *Coordinator) queue(most int, wants func(*run) bool) []*run {
	now := c.options.Now()
	c.mu.Lock()
	defer c.mu.Unlock()
	wanting := 0
	c.standings = c.standings[:0]
	for _, r := range c.order {
		entry := fairness.Job{User: r.user, Priority: int(r.standing.priority.Load()), Number: r.number, Wants: wants(r)}
		if leases := r.table.Leases(); leases > 0 {
			entry.Underway = float64(leases) * c.costOf(r)
		}
		if entry.Wants {
			wanting++
		}
		c.standings = append(c.standings, entry)
	}
	if wanting == 0 {
		return nil
	}
	queue := make([]*run, 0, min(wanting, most))
	for i := range c.usage.Order(c.standings, now) {
		if queue = append(queue, c.order[i]); len(queue) == most {
			break
		}
	}
	return queue
}

// costOf a task of a job, as far as it can be told. Requires: Coordinator.mu.
func (c *Coordinator) costOf(r *run) float64 {
	if known := math.Float64frombits(r.standing.cost.Load()); known > 0 {
		return known
	}
	return c.usualCost
}

// charge counts CPU time of merged work as used by the job's user. Requires: mu.
func (r *run) charge(seconds float64, tasks int) {
	if !(seconds > 0) || math.IsInf(seconds, 0) || tasks <= 0 {
		return
	}
	each := seconds / float64(tasks)
	c := r.c
	c.mu.Lock()
	defer c.mu.Unlock()
	c.usage.Charge(r.user, seconds, c.options.Now())
	c.usualCost = costMemory*c.usualCost + (1-costMemory)*each
	known := math.Float64frombits(r.standing.cost.Load())
	if known == 0 {
		known = each
	}
	r.standing.cost.Store(math.Float64bits(costMemory*known + (1-costMemory)*each))
}

// positions tells at which place of the queue jobs are, from 1: those that wait for a worker.
func (c *Coordinator) positions() map[*run]int {
	queue := c.queue(math.MaxInt, (*run).waits)
	positions := make(map[*run]int, len(queue))
	for i, r := range queue {
		positions[r] = i + 1
	}
	return positions
}
