package coordinator

import (
	"log/slog"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// A worker whose film does not unpack or does not fit its own digests, or whose segments or reports do not
// fit their checksums or tasks, has bad memory, or something between it and here changes what it sends.
// Nothing of such a batch or report is taken, so that the image is right whatever follows; but it has to
// be rendered again. That says nothing about its tasks: it is not counted towards giving their job up. So
// the worker gets no leases for a time that doubles with every such message and is halved with every
// batch that is merged: one flip costs a moment, a broken machine is asked every few minutes.

// quarantineDoublings bounds the time: 1 s becomes 4 minutes at most.
const quarantineDoublings = 8

// quarantine keeps a worker from leases for a time, and says for how long.
func (c *Coordinator) quarantine(id string) time.Duration {
	c.mu.Lock()
	defer c.mu.Unlock()
	w := c.workers[id]
	if w == nil {
		return 0
	}
	length := c.options.Quarantine << min(w.damaged, quarantineDoublings)
	w.damaged++
	w.quarantined = c.options.Now().Add(length)
	c.metrics.quarantines.Inc()
	return length
}

func (w *worker) inQuarantine(now time.Time) bool { return now.Before(w.quarantined) }

// damaged tells of a batch that is not what its worker packed, or not what it rendered. Requires: run.mu.
func (d *Delivery) damaged(outcome farmv1.Outcome, message string) {
	length := d.c.quarantine(d.worker.id)
	d.flag("damaged", message, slog.Float64("quarantine_seconds", length.Seconds()))
	d.decide(outcome, message)
}
