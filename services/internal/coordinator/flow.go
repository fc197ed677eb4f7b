package coordinator

import (
	"time"

	"metrofarm/services/internal/flow"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/plan"
)

// sealAfter is how long workers should collect segments of this job: all workers together keep to
// the coordinator's budget whatever jobs they work for. Requires: mu.
func (r *run) sealAfter() time.Duration {
	if r.state == nil {
		return flow.MinSeal
	}
	workers := len(r.c.renderers(r.spec.GetWorkerVersion()))
	bytes := r.batchSize.Expect(merge.UnpackedBytes(plan.Shape(r.spec).TileCount()))
	return flow.SealInterval(max(workers, 1), bytes, float64(r.c.options.InboundBytes))
}

func (r *run) sealSeconds() float64 {
	r.mu.Lock()
	defer r.mu.Unlock()
	return r.sealAfter().Seconds()
}

// share is how many of the waiting tasks a worker gets at most: what it has of all render threads,
// so that everybody has work. Requires: mu.
func (r *run) share(w worker, limit int) int {
	threads := max(w.threads, 1)
	all := max(r.c.threadsOf(w.version), threads)
	return min(limit, max(1, (r.table.Waiting()*threads+all-1)/all))
}

// withholds tells whether no segments are granted at the moment, and why to the log.
func (c *Coordinator) withholds() bool {
	withheld, changed := c.merging.Withholds()
	switch {
	case changed && withheld:
		c.log.Warn("leases are withheld: batches that wait to be merged exceed the budget", "budget_bytes", c.options.MergeBudget)
	case changed:
		c.log.Info("leases are granted again")
	}
	return withheld
}
