package api

import (
	"bytes"
	"context"
	"crypto/rand"
	"encoding/json"
	"errors"
	"fmt"
	"net/http"
	"reflect"
	"slices"
	"strconv"
	"strings"
	"sync"
	"time"

	"github.com/danielgtaylor/huma/v2"
	"github.com/danielgtaylor/huma/v2/adapters/humago"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

// farmInterval is the least time between two messages of a farm stream.
const farmInterval = time.Second

// contactGrain is how exactly the time of a worker's last contact is told: else each message would
// name every worker.
const contactGrain = 5 * time.Second

// FarmChange is a message of the farm's stream. It is exported because huma describes it by
// reflection.
type FarmChange struct {
	Full    bool              `json:"full" doc:"The first message of a stream that could not go on: jobs and workers that are not in it are gone or have ended."`
	Jobs    []json.RawMessage `json:"jobs" doc:"Jobs that changed, as lists with view=brief show them."`
	Workers []json.RawMessage `json:"workers" doc:"Workers that changed."`
	Gone    []string          `json:"gone" doc:"Ids of jobs that were deleted, also of those that had ended long before, and of workers that have left."`
}

type farmEventsInput struct {
	LastEventID string `header:"Last-Event-ID" maxLength:"128" doc:"Go on after this message."`
}

func (s *server) registerFarmEvents(api huma.API) {
	change := api.OpenAPI().Components.Schemas.Schema(reflect.TypeFor[FarmChange](), true, "FarmChange")
	huma.Register(api, huma.Operation{
		OperationID: "get-farm-events", Method: http.MethodGet, Path: "/v1/events", Tags: []string{"details"},
		Summary: "Changes of all jobs and workers, as server-sent events",
		Description: "The first message has all jobs that have not ended and all workers; those that follow, at most " +
			"one a second, have what has changed, put together. A job that ends is told of once more. With " +
			"Last-Event-ID the stream goes on where the last one ended, if the coordinator still knows.",
		Responses: map[string]*huma.Response{"200": {
			Description: "The stream", Content: map[string]*huma.MediaType{eventStreamType: {Schema: change}},
		}},
		Security: needs(auth.Read), Middlewares: huma.Middlewares{s.limitStreams(api)},
	}, s.farmEvents)
}

func (s *server) farmEvents(ctx context.Context, input *farmEventsInput) (*huma.StreamResponse, error) {
	if err := s.feed.refresh(ctx, s.Service, s.Now()); err != nil {
		return nil, s.fail(ctx, err)
	}
	return &huma.StreamResponse{Body: func(hctx huma.Context) {
		s.metrics.streams.Inc()
		defer s.metrics.streams.Dec()
		_, w := humago.Unwrap(hctx)
		stream := &eventStream{w: w, control: http.NewResponseController(w)}
		s.runFarmStream(ctx, stream, s.feed.versionOf(input.LastEventID))
	}}, nil
}

// runFarmStream returns when the client leaves or a write fails. A farm that cannot be read for a
// moment ends it, too: the client then connects again and is told.
func (s *server) runFarmStream(ctx context.Context, stream *eventStream, after uint64) {
	if stream.begin() != nil {
		return
	}
	ticker := time.NewTicker(s.FarmInterval)
	defer ticker.Stop()
	quiet := s.Now()
	for {
		message, version, err := s.feed.since(after)
		if err != nil {
			return
		}
		if message != nil {
			err = stream.write(message)
			after, quiet = version, s.Now()
		} else if s.Now().Sub(quiet) >= s.Heartbeat {
			err = stream.write([]byte(":\n\n"))
			quiet = s.Now()
		}
		if err != nil {
			return
		}
		select {
		case <-ctx.Done():
			return
		case <-ticker.C:
		}
		if s.feed.refresh(ctx, s.Service, s.Now()) != nil {
			return
		}
	}
}

// item is a job or a worker as it was last told of.
type item struct {
	id      string
	worker  bool
	content []byte // JSON; nil: gone
	version uint64 // of the feed when this changed
	seen    uint64 // refresh in which it was last there
	ended   bool   // a job that has ended: nothing more comes
}

// feed is what the farm's streams tell of. Nobody drives it: a stream that finds it old reads the farm
// anew, for all. What ended or left is kept for keepGone refreshes, for streams that go on.
type feed struct {
	interval time.Duration
	start    string // tells the versions of this process from those of another

	mutex     sync.Mutex
	read      time.Time // of the last refresh
	refreshes uint64
	version   uint64
	oldest    uint64 // version since which changes are complete
	items     map[string]*item
	deleted   uint64 // jobs that were deleted, as far as this tells
}

// keepGone is how many refreshes a message stays of what is there no more.
const keepGone = 120

func newFeed(interval time.Duration) *feed {
	return &feed{interval: interval, start: rand.Text(), items: make(map[string]*item)}
}

// versionOf what a client has seen last; 0 asks for everything.
func (f *feed) versionOf(lastEventID string) uint64 {
	start, text, _ := strings.Cut(lastEventID, "-")
	version, err := strconv.ParseUint(text, 10, 64)
	f.mutex.Lock()
	defer f.mutex.Unlock()
	if err != nil || start != f.start || version > f.version || version < f.oldest {
		return 0
	}
	return version
}

// refresh reads the farm unless that was done within the interval.
func (f *feed) refresh(ctx context.Context, service Service, now time.Time) error {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	if f.refreshes > 0 && now.Sub(f.read) < f.interval*9/10 {
		return nil
	}
	jobs, err := service.Live(ctx)
	if err != nil {
		return err
	}
	workers, err := service.Workers(ctx)
	if err != nil {
		return err
	}
	f.read = now
	f.refreshes++
	f.version++
	deleted, last := service.Deleted(f.deleted)
	if f.refreshes == 1 {
		deleted = nil // of before anybody was told of a job
	}
	f.deleted = last
	for _, snapshot := range jobs {
		f.put(snapshot.ID, false, snapshot.State.Ended(), snapshot.Brief())
	}
	for _, w := range workers {
		w.LastContact = w.LastContact.Truncate(contactGrain)
		f.put(w.ID, true, false, w)
	}
	for _, id := range deleted {
		f.remove(id)
	}
	return f.settle(ctx, service)
}

// put requires: mutex.
func (f *feed) put(id string, worker, ended bool, value any) {
	content, err := json.Marshal(value)
	if err != nil {
		return // a value that is not finite; the next refresh may have another
	}
	known := f.items[id]
	if known == nil {
		known = &item{id: id, worker: worker}
		f.items[id] = known
	}
	known.seen, known.ended = f.refreshes, ended
	if !bytes.Equal(content, known.content) {
		known.content, known.version = content, f.version
	}
}

// remove a job that was deleted, which streams may not have told of: lists did. Requires: mutex.
func (f *feed) remove(id string) {
	f.items[id] = &item{id: id, version: f.version, seen: f.refreshes}
}

// settle finds out what became of those that are not there any more. Requires: mutex.
func (f *feed) settle(ctx context.Context, service Service) error {
	for id, known := range f.items {
		switch {
		case known.seen == f.refreshes:
		case known.ended || known.content == nil:
			if f.refreshes-known.seen > keepGone {
				f.oldest = max(f.oldest, known.version)
				delete(f.items, id)
			}
		case known.worker:
			known.content, known.version = nil, f.version
		default:
			snapshot, err := service.Job(ctx, id)
			switch {
			case errors.Is(err, job.ErrNotFound):
				known.content, known.version = nil, f.version
			case err != nil:
				return err
			default:
				seen := known.seen
				f.put(id, false, snapshot.State.Ended(), snapshot.Brief())
				if known.ended {
					known.seen = seen
				}
			}
		}
	}
	return nil
}

// since returns the message that brings a client from one version to the present one; nil if nothing
// has changed.
func (f *feed) since(after uint64) (message []byte, version uint64, err error) {
	f.mutex.Lock()
	defer f.mutex.Unlock()
	change := FarmChange{Full: after == 0, Jobs: []json.RawMessage{}, Workers: []json.RawMessage{}, Gone: []string{}}
	for _, known := range f.items {
		switch {
		case known.version <= after:
		case known.content == nil:
			change.Gone = append(change.Gone, known.id)
		case known.worker:
			change.Workers = append(change.Workers, known.content)
		default:
			change.Jobs = append(change.Jobs, known.content)
		}
	}
	if !change.Full && len(change.Jobs)+len(change.Workers)+len(change.Gone) == 0 {
		return nil, after, nil
	}
	slices.Sort(change.Gone)
	data, err := json.Marshal(change)
	if err != nil {
		return nil, 0, err
	}
	return fmt.Appendf(nil, "id: %s-%d\nevent: farm\ndata: %s\n\n", f.start, f.version, data), f.version, nil
}
