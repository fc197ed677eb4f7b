package coordinator

import (
	"context"
	"log/slog"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

const (
	// sequenceReserve is how far sequence numbers may run ahead of the stored one: progress events
	// are not stored, and after a restart the sequence must go on above all of them.
	sequenceReserve = 10000
	// streamBuffer is how far a reader of events may fall behind.
	streamBuffer = 256
)

// eventLog is the recent events of a job and who reads along. Guarded by run.mu.
type eventLog struct {
	sequence uint64      // of the last event
	shown    uint64      // sequence of the last event that readers may see
	recent   []job.Event // those of this process that are kept, at most store.MaxEvents
	unsaved  []job.Event // to be stored with the next save
	hidden   []job.Event // not shown yet: they, or some before them, are not stored
	streams  map[chan job.Event]struct{}
	closed   bool
	// progressAt is when the last progress event was published.
	progressAt time.Time
}

// publish appends an event. Requires: mu. Progress and image events are for live readers only, and their
// sequence numbers are missing from what is read later; the others are stored with the next save, and
// shown once they are: what was seen must not be undone by the job's next owner.
func (r *run) publish(kind, message string, point *job.ConvergencePoint, attributes ...slog.Attr) {
	log := &r.events
	log.sequence++
	e := job.Event{
		Sequence: log.sequence, Kind: kind, At: r.c.options.Now(), Message: message, Convergence: point,
		Coordinator: r.c.options.Member.ID, Epoch: r.epoch, Attributes: mapOf(attributes),
	}
	switch kind {
	case "state", "round", "progress":
		snapshot := r.snapshot().ForEvents()
		e.Job = &snapshot
	}
	if kind != "progress" && kind != "image" {
		log.unsaved = append(log.unsaved, e)
		log.keep(e)
	}
	log.hidden = append(log.hidden, e)
	if len(log.unsaved) == 0 {
		log.show()
	}
	if log.sequence >= r.rec.Sequence {
		r.save()
	}
}

// keep appends an event to the recent ones.
func (l *eventLog) keep(e job.Event) {
	l.recent = append(l.recent, e)
	if extra := len(l.recent) - store.MaxEvents; extra > 0 {
		l.recent = append([]job.Event(nil), l.recent[extra:]...)
	}
}

// show passes hidden events on to those who read along.
func (l *eventLog) show() {
	for _, e := range l.hidden {
		for stream := range l.streams {
			select {
			case stream <- e:
			default:
				l.drop(stream)
			}
		}
		l.shown = e.Sequence
	}
	l.hidden = nil
}

func (l *eventLog) drop(stream chan job.Event) {
	if _, open := l.streams[stream]; open {
		delete(l.streams, stream)
		close(stream)
	}
}

// since returns the shown events above after: stored ones of earlier processes, then recent ones.
// Requires: mu.
func (r *run) since(ctx context.Context, after uint64) ([]job.Event, error) {
	var events []job.Event
	first := r.events.sequence + 1
	if len(r.events.recent) > 0 {
		first = r.events.recent[0].Sequence
	}
	if after+1 < first {
		stored, err := r.c.options.Store.Events(ctx, r.id, after)
		if err != nil {
			return nil, err
		}
		for _, e := range stored {
			if e.Sequence < first {
				events = append(events, e)
			}
		}
	}
	for _, e := range r.events.recent {
		if e.Sequence > after && e.Sequence <= r.events.shown {
			events = append(events, e)
		}
	}
	return events, nil
}

// follow returns the events above after and a stream of those to come.
func (r *run) follow(ctx context.Context, after uint64) ([]job.Event, <-chan job.Event, error) {
	r.mu.Lock()
	defer r.mu.Unlock()
	past, err := r.since(ctx, after)
	if err != nil {
		return nil, nil, err
	}
	stream := make(chan job.Event, streamBuffer)
	if r.events.closed {
		close(stream)
		return past, stream, nil
	}
	if r.events.streams == nil {
		r.events.streams = make(map[chan job.Event]struct{})
	}
	r.events.streams[stream] = struct{}{}
	context.AfterFunc(ctx, func() {
		r.mu.Lock()
		defer r.mu.Unlock()
		r.events.drop(stream)
	})
	return past, stream, nil
}

// closeStreams ends all streams: the coordinator stops or the job is deleted.
func (r *run) closeStreams() {
	r.mu.Lock()
	defer r.mu.Unlock()
	r.events.closed = true
	for stream := range r.events.streams {
		r.events.drop(stream)
	}
}
