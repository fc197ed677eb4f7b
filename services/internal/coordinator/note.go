package coordinator

import (
	"context"
	"fmt"
	"log/slog"
	"time"
)

// checkpointPace is how often the log of a job tells of its checkpoints, so that they do not push out
// what else happened: the log is as long as the store's list of events.
const checkpointPace = 5 * time.Minute

// notedCheckpoints is what the log of a job said of checkpoints.
type notedCheckpoints struct {
	at      time.Time // of the last line
	written int       // since then
	failed  bool      // the last one was not written, and the log said so
}

// note writes a line to the log of the job and to that of the process. Requires: mu; the line is stored
// with the next save, which housekeeping sees to.
func (r *run) note(message string, attributes ...slog.Attr) {
	r.publish("log", message, nil, attributes...)
	all := append([]slog.Attr{slog.String("job", r.id), slog.Uint64("epoch", r.epoch)}, attributes...)
	r.c.log.LogAttrs(context.Background(), slog.LevelInfo, message, all...)
}

// noteCheckpoint requires: mu.
func (r *run) noteCheckpoint(d draft, bytes int, cost time.Duration) {
	n := &r.noted
	n.written++
	now := r.c.options.Now()
	last := r.finishing != nil || r.rec.State.Ended()
	if !n.at.IsZero() && now.Sub(n.at) < checkpointPace && !n.failed && !last {
		return
	}
	r.note("checkpoint", slog.Uint64("number", r.rec.Checkpoints), slog.Int("round", d.State.Closed), slog.Int("bytes", bytes),
		slog.Float64("seconds", cost.Seconds()), slog.Int("written_since_last_line", n.written))
	*n = notedCheckpoints{at: now}
}

// noteFailedCheckpoint says so of the first that fails. Requires: mu.
func (r *run) noteFailedCheckpoint(err error) {
	if !r.noted.failed {
		r.publish("fault", fmt.Sprintf("the checkpoint cannot be written, it is tried again: %v", err), nil)
	}
	r.noted.failed = true
}

// joined notes that a worker gets tasks of this job for the first time since the coordinator owns it.
// Requires: mu.
func (r *run) joined(w worker) {
	if r.crew[w.id] {
		return
	}
	r.crew[w.id] = true
	r.note("worker joins", append(identity(w), slog.String("worker_version", w.version), slog.Int("threads", w.threads))...)
}

// left notes that a worker of this job ends. Requires: mu.
func (r *run) left(w worker, tasks int) {
	if !r.crew[w.id] {
		return
	}
	delete(r.crew, w.id)
	r.note("worker leaves", append(identity(w), slog.Int("tasks_given_back", tasks))...)
}

// identity of a worker as attributes.
func identity(w worker) []slog.Attr {
	return []slog.Attr{slog.String("worker", w.id), slog.String("worker_name", w.name)}
}

// mapOf attributes; nil without any.
func mapOf(attributes []slog.Attr) map[string]any {
	if len(attributes) == 0 {
		return nil
	}
	m := make(map[string]any, len(attributes))
	for _, a := range attributes {
		m[a.Key] = a.Value.Any()
	}
	return m
}
