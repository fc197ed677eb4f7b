// Package logging writes the log of a process as JSON, one object per line, with the names of
// OpenTelemetry's log data model: the ones that workers use, too. doc/logging.md lists the attributes.
package logging

import (
	"context"
	"io"
	"log/slog"
	"net/http"
	"slices"
	"strings"
	"time"

	"go.opentelemetry.io/otel/propagation"
	"go.opentelemetry.io/otel/trace"
)

// Handler is a slog.Handler.
type Handler struct {
	out      slog.Handler
	resource slog.Attr
	// attributes that all lines have, named as they are written; prefix of the names of those to come.
	attributes []slog.Attr
	prefix     string
}

// New returns a handler that writes to w, for a service of this name and version.
func New(w io.Writer, service, version string) *Handler {
	return &Handler{
		out: slog.NewJSONHandler(w, &slog.HandlerOptions{ReplaceAttr: rename}),
		resource: slog.Group("resource",
			slog.String("service.name", service), slog.String("service.version", version)),
	}
}

// rename gives the fields of a record their names.
func rename(groups []string, a slog.Attr) slog.Attr {
	if len(groups) > 0 {
		return a
	}
	switch a.Key {
	case slog.TimeKey:
		return slog.String("timestamp", a.Value.Time().UTC().Format("2006-01-02T15:04:05.000000Z"))
	case slog.LevelKey:
		a.Key = "severity_text"
	case slog.MessageKey:
		a.Key = "body"
	}
	return a
}

// severityNumber is OpenTelemetry's: levels of slog are 4 apart, as these are.
func severityNumber(level slog.Level) int { return int(level) + 9 }

// Enabled implements slog.Handler.
func (h *Handler) Enabled(ctx context.Context, level slog.Level) bool {
	return h.out.Enabled(ctx, level)
}

// Handle implements slog.Handler.
func (h *Handler) Handle(ctx context.Context, r slog.Record) error {
	attributes := slices.Clone(h.attributes)
	r.Attrs(func(a slog.Attr) bool {
		attributes = h.add(attributes, h.prefix, a)
		return true
	})
	line := slog.NewRecord(r.Time, r.Level, r.Message, 0)
	line.AddAttrs(slog.Int("severity_number", severityNumber(r.Level)))
	if span := trace.SpanContextFromContext(ctx); span.IsValid() {
		line.AddAttrs(slog.String("trace_id", span.TraceID().String()), slog.String("span_id", span.SpanID().String()))
	}
	line.AddAttrs(slog.Any("attributes", slog.GroupValue(attributes...)), h.resource)
	return h.out.Handle(ctx, line)
}

// WithAttrs implements slog.Handler.
func (h *Handler) WithAttrs(attributes []slog.Attr) slog.Handler {
	with := *h
	with.attributes = slices.Clone(h.attributes)
	for _, a := range attributes {
		with.attributes = h.add(with.attributes, h.prefix, a)
	}
	return &with
}

// WithGroup implements slog.Handler.
func (h *Handler) WithGroup(name string) slog.Handler {
	with := *h
	if name != "" {
		with.prefix += name + "."
	}
	return &with
}

// add names an attribute and adds it to a list.
func (h *Handler) add(list []slog.Attr, prefix string, a slog.Attr) []slog.Attr {
	value := a.Value.Resolve()
	if value.Kind() == slog.KindGroup {
		if a.Key != "" {
			prefix += a.Key + "."
		}
		for _, part := range value.Group() {
			list = h.add(list, prefix, part)
		}
		return list
	}
	if a.Key == "" {
		return list
	}
	name := attributeName(prefix + a.Key)
	if value.Kind() == slog.KindDuration {
		name, value = name+"_seconds", slog.Float64Value(value.Duration().Seconds())
	}
	if value.Kind() == slog.KindTime {
		value = slog.StringValue(value.Time().UTC().Format(time.RFC3339Nano))
	}
	return append(list, slog.Attr{Key: name, Value: value})
}

// attributeName is OpenTelemetry's where it has one, else a name of our own.
func attributeName(key string) string {
	switch key {
	case "error":
		return "error.message"
	case "user":
		return "user.name"
	case "method":
		return "http.request.method"
	case "path":
		return "url.path"
	case "status":
		return "http.response.status_code"
	case "remote":
		return "client.address"
	}
	if strings.Contains(key, ".") {
		return key
	}
	return "metrofarm." + key
}

// WithTrace returns the request with the trace that its traceparent header names, if it has a right one:
// lines that are logged in its context then have it.
func WithTrace(r *http.Request) *http.Request {
	ctx := propagation.TraceContext{}.Extract(r.Context(), propagation.HeaderCarrier(r.Header))
	return r.WithContext(ctx)
}
