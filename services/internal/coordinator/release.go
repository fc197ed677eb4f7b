package coordinator

import (
	"context"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/lease"
)

// Release takes leases back that a worker will not use, all of them if it ends.
func (c *Coordinator) Release(_ context.Context, in *farmv1.ReleaseRequest) (*farmv1.ReleaseResponse, error) {
	w, err := c.findWorker(in.GetWorkerId())
	if err != nil {
		return nil, err
	}
	refs := make([]lease.Ref, 0, len(in.GetLeases()))
	for _, l := range in.GetLeases() {
		refs = append(refs, ref(l))
	}
	c.giveBack(w.id, refs)
	if in.GetLeaving() {
		c.dismiss(w)
	}
	return &farmv1.ReleaseResponse{}, nil
}

// giveBack returns leases to their tables without blame.
func (c *Coordinator) giveBack(workerID string, refs []lease.Ref) {
	if len(refs) == 0 {
		return
	}
	for _, l := range refs {
		if r := c.runOfTask(l.Task); r != nil {
			r.mu.Lock()
			if r.table.Release(l, workerID) {
				c.metrics.released.Inc()
			}
			r.mu.Unlock()
		}
	}
	c.announce()
}

// dismiss forgets a worker that ends. It is taken off the list first: a lease call of its own that
// is still waiting then finds it unknown.
func (c *Coordinator) dismiss(w worker) {
	c.mu.Lock()
	delete(c.workers, w.id)
	c.rouse()
	c.mu.Unlock()
	for _, r := range c.runs() {
		r.mu.Lock()
		released := r.table.ReleaseWorker(w.id)
		r.left(w, released)
		r.mu.Unlock()
		c.metrics.released.Add(float64(released))
	}
	c.log.Info("worker left", "worker", w.id, "name", w.name)
	c.announce()
}

func refsOf(tasks []*farmv1.Task) []lease.Ref {
	refs := make([]lease.Ref, 0, len(tasks))
	for _, t := range tasks {
		refs = append(refs, lease.Ref{Task: t.GetTaskId(), Epoch: t.GetEpoch()})
	}
	return refs
}
