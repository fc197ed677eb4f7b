package api

import (
	"bytes"
	"cmp"
	"context"
	"encoding/json"
	"fmt"
	"maps"
	"net/http"
	"reflect"
	"slices"
	"strings"
	"time"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

type logInput struct {
	JobPath
	After  uint64 `query:"after" doc:"Only what follows the record with this sequence."`
	Format string `query:"format" enum:"text,json" default:"text" doc:"json: one object per line."`
}

// LogRecord is one line of a job's log, with the names that the log of the process has, too. It is
// exported because huma describes it by reflection.
type LogRecord struct {
	Sequence    uint64    `json:"sequence" doc:"Grows by record, with gaps: the after of the next call."`
	Timestamp   time.Time `json:"timestamp"`
	Severity    string    `json:"severity_text" enum:"INFO,WARN,ERROR"`
	Kind        string    `json:"kind" doc:"state, round, warning, fault, anomaly or log."`
	Body        string    `json:"body"`
	Job         string    `json:"job"`
	Coordinator string    `json:"coordinator,omitempty" doc:"The coordinator that owned the job."`
	Epoch       uint64    `json:"epoch,omitempty" doc:"Grows with each owner of the job."`
	// Attributes of what it is about.
	Attributes map[string]any `json:"attributes,omitempty" doc:"What it is about: worker, round, rel_mse, bytes, ..."`
}

func (s *server) registerLog(api huma.API) {
	record := api.OpenAPI().Components.Schemas.Schema(reflect.TypeFor[LogRecord](), true, "LogRecord")
	huma.Register(api, huma.Operation{
		OperationID: "get-log", Method: http.MethodGet, Path: "/v1/jobs/{id}/log",
		Tags: []string{"details"}, Summary: "What happened to a job, line by line",
		Description: "States, workers that join, leave or are lost, faults, warnings, decisions, rounds with their cost and " +
			"error, checkpoints, and which coordinator took the job over. It is the stored part of the job's events: " +
			"the last 512, also after a restart and after the job has ended. In the text, attributes follow in parentheses.",
		Responses: map[string]*huma.Response{"200": {Description: "The log", Content: map[string]*huma.MediaType{
			"text/plain": {}, "application/x-ndjson": {Schema: record},
		}}},
		Security: needs(auth.Read),
	}, s.log)
}

func (s *server) log(ctx context.Context, input *logInput) (*rawOutput, error) {
	events, err := s.pastEvents(ctx, input.ID, input.After)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	output := &rawOutput{ContentType: "text/plain; charset=utf-8"}
	write := writeLine
	if input.Format == "json" {
		output.ContentType = "application/x-ndjson"
		write = func(buffer *bytes.Buffer, record LogRecord) error { return json.NewEncoder(buffer).Encode(record) }
	}
	var buffer bytes.Buffer
	for _, event := range events {
		if err := write(&buffer, recordOf(input.ID, event)); err != nil {
			return nil, s.fail(ctx, fmt.Errorf("log: %w", err))
		}
	}
	output.Body = buffer.Bytes()
	return output, nil
}

func writeLine(buffer *bytes.Buffer, r LogRecord) error {
	var about []string
	for _, name := range slices.Sorted(maps.Keys(r.Attributes)) {
		about = append(about, fmt.Sprintf("%s=%v", name, r.Attributes[name]))
	}
	text := strings.Join(about, ", ")
	if text != "" {
		text = " (" + text + ")"
	}
	_, err := fmt.Fprintf(buffer, "%s %-8s %s%s\n", r.Timestamp.UTC().Format(time.RFC3339Nano), r.Kind, oneLine(r.Body), oneLine(text))
	return err
}

// oneLine keeps what workers say from looking like records of their own.
func oneLine(text string) string {
	return strings.Map(func(r rune) rune {
		if r < ' ' || r == 0x7f {
			return ' '
		}
		return r
	}, text)
}

func recordOf(id string, e job.Event) LogRecord {
	record := LogRecord{
		Sequence: e.Sequence, Timestamp: e.At.UTC(), Severity: severityOf(e), Kind: e.Kind, Body: e.Message, Job: id,
		Coordinator: e.Coordinator, Epoch: e.Epoch, Attributes: map[string]any{},
	}
	if e.Kind == "state" && e.Job != nil {
		record.Body = cmp.Or(e.Message, "the job is "+string(e.Job.State))
		record.Attributes["state"] = e.Job.State
	}
	if p := e.Convergence; p != nil {
		addPoint(record.Attributes, p, e.Job)
	}
	maps.Copy(record.Attributes, e.Attributes)
	return record
}

// addPoint says what a round came to.
func addPoint(attributes map[string]any, p *job.ConvergencePoint, after *job.Snapshot) {
	maps.Copy(attributes, map[string]any{
		"round": p.Round, "mutations": p.Mutations, "rel_mse": p.RelMSE, "b": p.B, "b_standard_error": p.BStandardError,
		"cpu_seconds": p.CPUSeconds, "wall_seconds": p.WallSeconds, "film_sha256": p.FilmSHA256,
	})
	if after != nil {
		attributes["mutations_per_second"] = after.MutationsPerSecond
	}
}

func severityOf(e job.Event) string {
	switch {
	case e.Kind == "state" && e.Job != nil && e.Job.State == job.Failed:
		return "ERROR"
	case e.Kind == "fault" || e.Kind == "warning" || e.Kind == "anomaly":
		return "WARN"
	}
	return "INFO"
}
