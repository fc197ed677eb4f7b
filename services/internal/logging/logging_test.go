package logging

import (
	"bytes"
	"context"
	"encoding/json"
	"errors"
	"log/slog"
	"net/http"
	"reflect"
	"regexp"
	"testing"
	"time"
)

type line struct {
	Timestamp      string         `json:"timestamp"`
	SeverityText   string         `json:"severity_text"`
	SeverityNumber int            `json:"severity_number"`
	TraceID        string         `json:"trace_id"`
	SpanID         string         `json:"span_id"`
	Body           string         `json:"body"`
	Attributes     map[string]any `json:"attributes"`
	Resource       map[string]any `json:"resource"`
}

func written(t *testing.T, ctx context.Context, log func(context.Context, *slog.Logger)) line {
	t.Helper()
	var buffer bytes.Buffer
	log(ctx, slog.New(New(&buffer, "metrofarm", "1.2")))
	decoder := json.NewDecoder(&buffer)
	decoder.DisallowUnknownFields()
	var l line
	if err := decoder.Decode(&l); err != nil {
		t.Fatal(err)
	}
	if !regexp.MustCompile(`^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z$`).MatchString(l.Timestamp) {
		t.Errorf("timestamp %q", l.Timestamp)
	}
	return l
}

func TestLinesHaveTheNamesOfTheLogDataModel(t *testing.T) {
	l := written(t, t.Context(), func(ctx context.Context, log *slog.Logger) {
		log.With("coordinator", "c-1").WarnContext(ctx, "it \"broke\"", "job", "job-1", "epoch", 3, "error", errors.New("bad"),
			"duration", 1500*time.Millisecond, slog.Group("server", "address", "h:1"))
	})
	want := map[string]any{
		"metrofarm.coordinator": "c-1", "metrofarm.job": "job-1", "metrofarm.epoch": 3.0, "error.message": "bad",
		"metrofarm.duration_seconds": 1.5, "server.address": "h:1",
	}
	if l.Body != `it "broke"` || l.SeverityText != "WARN" || l.SeverityNumber != 13 || !reflect.DeepEqual(l.Attributes, want) ||
		l.TraceID != "" || l.Resource["service.name"] != "metrofarm" || l.Resource["service.version"] != "1.2" {
		t.Errorf("%+v", l)
	}
}

func TestLinesHaveTheTraceOfTheRequest(t *testing.T) {
	const traceID, spanID = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
	for header, known := range map[string]bool{
		"00-" + traceID + "-" + spanID + "-01":           true,
		"00-" + traceID + "-0000000000000000-01":         false,
		"00-" + traceID + "-" + spanID + "\n{\"a\":1}-1": false,
		"": false,
	} {
		r, err := http.NewRequestWithContext(t.Context(), http.MethodGet, "/", nil)
		if err != nil {
			t.Fatal(err)
		}
		r.Header.Set("Traceparent", header)
		l := written(t, WithTrace(r).Context(), func(ctx context.Context, log *slog.Logger) { log.InfoContext(ctx, "hello") })
		if (l.TraceID == traceID && l.SpanID == spanID) != known || !known && l.TraceID+l.SpanID != "" {
			t.Errorf("%q: trace %q, span %q", header, l.TraceID, l.SpanID)
		}
	}
}
