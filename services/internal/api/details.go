package api

import (
	"bytes"
	"context"
	"encoding/csv"
	"encoding/json"
	"errors"
	"net/http"
	"reflect"
	"strconv"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/explain"
	"metrofarm/services/internal/job"
)

type convergenceInput struct {
	JobPath
	Format string `query:"format" enum:"json,csv" default:"json"`
}

// rawOutput is an answer whose bytes we make ourselves.
type rawOutput struct {
	ContentType string `header:"Content-Type"`
	Body        []byte
}

type convergenceBody struct {
	Points  []job.ConvergencePoint `json:"points" doc:"One per complete round."`
	Lengths []job.Length           `json:"lengths,omitempty" doc:"Samples by path length (chains), with b from the bootstrap (mmlt)."`
}

type planOutput struct {
	Body struct {
		explain.Plan
		Resolved json.RawMessage `json:"resolved,omitempty" doc:"The resolved spec, once known. Its text as resolved of a new job repeats the image."`
	}
}

type anomaliesOutput struct {
	Body struct {
		Total  uint64            `json:"total"`
		ByKind map[string]uint64 `json:"by_kind" doc:"Contributions set to zero, by kind."`
		Events []job.Event       `json:"events" doc:"What was logged about them."`
	}
}

func (s *server) registerDetails(api huma.API) {
	points := api.OpenAPI().Components.Schemas.Schema(reflect.TypeFor[convergenceBody](), true, "Convergence")
	huma.Register(api, huma.Operation{
		OperationID: "get-convergence", Method: http.MethodGet, Path: "/v1/jobs/{id}/convergence",
		Tags: []string{"details"}, Summary: "Error and cost after each round",
		Responses: map[string]*huma.Response{"200": {Description: "The points", Content: map[string]*huma.MediaType{
			"application/json": {Schema: points}, "text/csv": {},
		}}},
		Security: needs(auth.Read),
	}, s.convergence)
	huma.Register(api, huma.Operation{
		OperationID: "get-plan", Method: http.MethodGet, Path: "/v1/jobs/{id}/plan",
		Tags: []string{"details"}, Summary: "What was decided, and why",
		Security: needs(auth.Read),
	}, s.plan)
	huma.Register(api, huma.Operation{
		OperationID: "get-scene-report", Method: http.MethodGet, Path: "/v1/jobs/{id}/scene",
		Tags: []string{"details"}, Summary: "What is in the job's scene",
		Description: "Shapes, materials, lights, memory and warnings, as a worker found them: " +
			"metrofarm.scene.v1.SceneReport. A job with inspect_only ends with it.",
		Responses: map[string]*huma.Response{"200": {Description: "The report", Content: map[string]*huma.MediaType{"application/json": {}}}},
		Security:  needs(auth.Read),
	}, s.sceneReport)
	huma.Register(api, huma.Operation{
		OperationID: "get-anomalies", Method: http.MethodGet, Path: "/v1/jobs/{id}/anomalies",
		Tags: []string{"details"}, Summary: "Contributions that were not numbers, infinite or negative",
		Security: needs(auth.Read),
	}, s.anomalies)
}

func (s *server) convergence(ctx context.Context, input *convergenceInput) (*rawOutput, error) {
	points, err := s.Service.Convergence(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if input.Format == "csv" {
		return &rawOutput{ContentType: "text/csv; charset=utf-8", Body: convergenceCSV(points)}, nil
	}
	if points == nil {
		points = []job.ConvergencePoint{}
	}
	snapshot, err := s.Service.Job(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	body, err := json.Marshal(convergenceBody{Points: points, Lengths: snapshot.Lengths})
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &rawOutput{ContentType: "application/json", Body: body}, nil
}

func convergenceCSV(points []job.ConvergencePoint) []byte {
	var buffer bytes.Buffer
	w := csv.NewWriter(&buffer)
	write := func(record ...string) { _ = w.Write(record) } // a buffer does not fail
	write("round", "mutations", "path_evaluations", "rays", "rel_mse", "rel_mse_low", "rel_mse_high",
		"b", "b_standard_error", "cpu_seconds", "wall_seconds", "film_sha256",
		"acceptance_large", "acceptance_small", "acceptance_second", "acceptance_second_after_large", "coordinates_per_mutation",
		"effective_samples")
	count := func(n uint64) string { return strconv.FormatUint(n, 10) }
	number := func(x float64) string { return strconv.FormatFloat(x, 'g', -1, 64) }
	ratio := func(x *float64) string {
		if x == nil {
			return ""
		}
		return number(*x)
	}
	for _, p := range points {
		write(strconv.Itoa(p.Round), count(p.Mutations), count(p.PathEvaluations), count(p.Rays),
			number(p.RelMSE), number(p.RelMSEInterval.Low), number(p.RelMSEInterval.High),
			number(p.B), number(p.BStandardError), number(p.CPUSeconds), number(p.WallSeconds), p.FilmSHA256,
			ratio(p.Acceptance.Large), ratio(p.Acceptance.Small), ratio(p.Acceptance.Second),
			ratio(p.Acceptance.SecondAfterLarge), number(p.CoordinatesPerMutation),
			number(p.EffectiveSamples))
	}
	w.Flush()
	return buffer.Bytes()
}

func (s *server) plan(ctx context.Context, input *JobPath) (*planOutput, error) {
	snapshot, err := s.Service.Job(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	output := &planOutput{}
	report, err := s.Service.SceneReport(ctx, input.ID)
	if err != nil && !errors.Is(err, job.ErrNoReport) {
		return nil, s.fail(ctx, err)
	}
	if output.Body.Plan, err = explain.Of(snapshot, report); err != nil {
		return nil, s.fail(ctx, err)
	}
	if snapshot.Resolved != "" {
		output.Body.Resolved = json.RawMessage(snapshot.Resolved)
	}
	return output, nil
}

func (s *server) anomalies(ctx context.Context, input *JobPath) (*anomaliesOutput, error) {
	snapshot, err := s.Service.Job(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	events, err := s.pastEvents(ctx, input.ID, 0)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	output := &anomaliesOutput{}
	output.Body.ByKind = map[string]uint64{}
	for kind, count := range snapshot.Anomalies {
		output.Body.ByKind[kind] = count
		output.Body.Total += count
	}
	output.Body.Events = []job.Event{}
	for _, event := range events {
		if event.Kind == "anomaly" {
			output.Body.Events = append(output.Body.Events, event)
		}
	}
	return output, nil
}

func (s *server) sceneReport(ctx context.Context, input *JobPath) (*rawOutput, error) {
	report, err := s.Service.SceneReport(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &rawOutput{ContentType: "application/json", Body: []byte(report)}, nil
}

// pastEvents returns the events so far above after.
func (s *server) pastEvents(ctx context.Context, id string, after uint64) ([]job.Event, error) {
	ctx, cancel := context.WithCancel(ctx) // ends the subscription
	defer cancel()
	past, _, err := s.Service.Events(ctx, id, after)
	return past, err
}
