package api

import (
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"net/http"
	"reflect"
	"time"

	"github.com/danielgtaylor/huma/v2"
	"github.com/danielgtaylor/huma/v2/adapters/humago"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

type eventsInput struct {
	JobPath
	LastEventID uint64 `header:"Last-Event-ID" doc:"Go on after this event."`
	After       uint64 `query:"after" doc:"Like Last-Event-ID, for the first connection."`
}

func (s *server) registerEvents(api huma.API) {
	event := api.OpenAPI().Components.Schemas.Schema(reflect.TypeFor[job.Event](), true, "Event")
	huma.Register(api, huma.Operation{
		OperationID: "get-events", Method: http.MethodGet, Path: "/v1/jobs/{id}/events",
		Tags: []string{"details"}, Summary: "Past events, then live ones, as server-sent events",
		Description: "id is the sequence number, event the kind, data the event as JSON. Progress and image events are for " +
			"live readers: among past events their numbers are missing. job leaves out resolved, request.resolved and " +
			"request.defaults; GET /v1/jobs/{id} has them. Comments keep quiet streams open. The stream ends when the reader is too slow, and when a job that had ended goes on, " +
			"for another coordinator may run it: reconnect with Last-Event-ID. The last event of a deleted job is deleted.",
		Responses: map[string]*huma.Response{"200": {
			Description: "The stream", Content: map[string]*huma.MediaType{eventStreamType: {Schema: event}},
		}},
		Security: needs(auth.Read), Middlewares: huma.Middlewares{s.limitStreams(api)},
	}, s.events)
}

func (s *server) events(ctx context.Context, input *eventsInput) (*huma.StreamResponse, error) {
	ctx, cancel := context.WithCancel(ctx)
	past, live, err := s.Service.Events(ctx, input.ID, max(input.LastEventID, input.After))
	if err != nil {
		cancel()
		return nil, s.fail(ctx, err)
	}
	return &huma.StreamResponse{Body: func(hctx huma.Context) {
		defer cancel()
		s.metrics.streams.Inc()
		defer s.metrics.streams.Dec()
		_, w := humago.Unwrap(hctx)
		stream := &eventStream{w: w, control: http.NewResponseController(w)}
		if stream.run(ctx, past, live, s.Heartbeat) {
			s.tellDeleted(ctx, stream, input.ID)
		}
	}}, nil
}

// tellDeleted says why a stream has ended if its job is there no more.
func (s *server) tellDeleted(ctx context.Context, stream *eventStream, id string) {
	if _, err := s.Service.Job(ctx, id); errors.Is(err, job.ErrNotFound) {
		_ = stream.send(job.Event{Sequence: stream.last + 1, Kind: "deleted", At: s.Now(), Message: "the job was deleted"})
	}
}

// eventStream writes server-sent events to one client.
type eventStream struct {
	w       http.ResponseWriter
	control *http.ResponseController
	last    uint64 // sequence of the last event that was sent
}

const eventStreamType = "text/event-stream"

// reconnectMilliseconds is how long browsers wait before they connect again.
const reconnectMilliseconds = 1000

// run returns when the client leaves, a write fails, or, with true, when the source ends.
func (s *eventStream) run(ctx context.Context, past []job.Event, live <-chan job.Event, heartbeat time.Duration) bool {
	if s.begin() != nil {
		return false
	}
	for _, event := range past {
		if s.send(event) != nil {
			return false
		}
	}
	ticker := time.NewTicker(heartbeat)
	defer ticker.Stop()
	for {
		var err error
		select {
		case <-ctx.Done():
			return false
		case event, open := <-live:
			if !open {
				return ctx.Err() == nil
			}
			err = s.send(event)
		case <-ticker.C:
			err = s.write([]byte(":\n\n"))
		}
		if err != nil {
			return false
		}
	}
}

// begin sends the head of the answer.
func (s *eventStream) begin() error {
	s.w.Header().Set("Content-Type", eventStreamType)
	s.w.Header().Set("Cache-Control", "no-store")
	s.w.Header().Set("X-Accel-Buffering", "no") // proxies: pass events on at once
	return s.write(fmt.Appendf(nil, "retry: %d\n\n", reconnectMilliseconds))
}

func (s *eventStream) send(event job.Event) error {
	data, err := json.Marshal(event)
	if err != nil {
		return err
	}
	s.last = event.Sequence
	return s.write(fmt.Appendf(nil, "id: %d\nevent: %s\ndata: %s\n\n", event.Sequence, event.Kind, data))
}

func (s *eventStream) write(message []byte) error {
	// Recorders in tests have no deadline.
	_ = s.control.SetWriteDeadline(time.Now().Add(stallTimeout))
	if _, err := s.w.Write(message); err != nil {
		return err
	}
	return s.control.Flush()
}
