package coordinator

import (
	"fmt"
	"log/slog"
	"time"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/merge"
)

// What workers say beside films has checksums of its own, and names its task twice: by the lease and
// by job, round and segment. Where one of these contradicts the other, the message was changed on its
// way or in its worker's memory, and nothing in it is believed. What then happens to the worker is in
// quarantine.go. A lease whose name was changed is not given back by that: it runs out.

// unsound says which segment of a batch does not fit its checksum, nil if all do. It takes time: the
// states of chains are long.
func unsound(header *farmv1.BatchHeader) error {
	for i, s := range header.GetSegments() {
		if err := checksum.Check(s); err != nil {
			return fmt.Errorf("segment %d, listed at %d: %w", s.GetSegment(), i, err)
		}
	}
	return nil
}

// misplaced says which segment of a batch was not leased for the place that it has in the film, nil if
// all were. Requires: mu.
func (r *run) misplaced(batch *merge.Batch) error {
	for _, s := range batch.Segments {
		key := segmentKey{batch.Round, s.Segment}
		if task := r.segmentTask(key.round, key.segment); s.Task != task && s.Task != r.checkTask(key) {
			return fmt.Errorf("segment %d of round %d comes under the task %q, not %q", key.segment, key.round, s.Task, task)
		}
	}
	return nil
}

// refuse a report that does not fit its checksum.
func (c *Coordinator) refuse(w worker, in *farmv1.ReportRequest, damage error) *farmv1.ReportResponse {
	length := c.quarantine(w.id)
	c.flag(w.id)
	if r := c.runOfTask(in.GetLease().GetTaskId()); r != nil {
		r.noteDamage(w, in.GetLease(), damage, length)
		c.announce() // another worker may have the task
	}
	return &farmv1.ReportResponse{Outcome: farmv1.Outcome_OUTCOME_CONFLICT, Message: damage.Error()}
}

// noteDamage of a report and give its task back, against which it does not speak.
func (r *run) noteDamage(w worker, l *farmv1.LeaseRef, damage error, quarantine time.Duration) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.gone.Load() {
		return
	}
	r.publish("fault", fmt.Sprintf("worker %s sent a damaged report: %v", w.name, damage), nil,
		append(identity(w), slog.Float64("quarantine_seconds", quarantine.Seconds()))...)
	if r.table.Release(ref(l), w.id) {
		r.c.metrics.released.Inc()
	}
	r.save()
}
