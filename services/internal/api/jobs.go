package api

import (
	"context"
	"net/http"
	"strings"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/job"
)

type submitInput struct {
	IdempotencyKey string `header:"Idempotency-Key" maxLength:"255" doc:"Repeat a request safely: the same key and body return the first job."`
	Body           job.Request
}

// JobPath is exported because huma fills embedded structs by reflection.
type JobPath struct {
	ID string `path:"id" maxLength:"128" doc:"The job."`
}

type jobOutput struct {
	Body job.Snapshot
}

type createdOutput struct {
	Location string `header:"Location"`
	Body     job.Snapshot
}

type listInput struct {
	Cursor string `query:"cursor" maxLength:"128" doc:"The next of an earlier page; absent for the first."`
	Limit  int    `query:"limit" minimum:"1" maximum:"200" default:"50" doc:"Jobs per page."`
}

type jobList struct {
	Jobs []job.Snapshot `json:"jobs" doc:"Newest first."`
	Next string         `json:"next,omitempty" doc:"Cursor of the next page; absent on the last."`
}

type listOutput struct {
	Body jobList
}

func (s *server) registerJobs(api huma.API) {
	huma.Register(api, huma.Operation{
		OperationID: "submit-job", Method: http.MethodPost, Path: "/v1/jobs", Tags: []string{"jobs"},
		Summary:       "Submit a job",
		Description:   "The job is stored durably before the answer.",
		DefaultStatus: http.StatusCreated, MaxBodyBytes: jsonBodyLimit, BodyReadTimeout: jsonBodyTimeout,
	}, s.submit)
	relaxRequest(api.OpenAPI())
	huma.Register(api, huma.Operation{
		OperationID: "list-jobs", Method: http.MethodGet, Path: "/v1/jobs", Tags: []string{"jobs"},
		Summary: "List jobs, newest first",
	}, s.list)
	huma.Register(api, huma.Operation{
		OperationID: "get-job", Method: http.MethodGet, Path: "/v1/jobs/{id}", Tags: []string{"jobs"},
		Summary: "Get a job",
	}, s.get)
	huma.Register(api, huma.Operation{
		OperationID: "delete-job", Method: http.MethodDelete, Path: "/v1/jobs/{id}", Tags: []string{"jobs"},
		Summary:       "Delete a job that has ended, with its image and events",
		DefaultStatus: http.StatusNoContent,
	}, s.delete)
}

// relaxRequest makes the stop rules optional in requests: with none, the scene's sample count
// decides. (They are always present in answers, so the type has no omitempty.) It also describes the
// options, whose words job.Request.Validate checks.
func relaxRequest(document *huma.OpenAPI) {
	schemas := document.Components.Schemas.Map()
	schema := schemas["Request"]
	schema.Required = []string{"scene", "entry"}
	for _, option := range job.Options() {
		owner, name := schema, option.Field
		if rest, nested := strings.CutPrefix(option.Field, "stop."); nested {
			owner, name = schemas["StopRules"], rest
		}
		property := owner.Properties[name]
		property.Description = option.Help()
		if len(option.Choices) > 0 {
			property.Description += ": " + strings.Join(option.Choices, ", ")
		}
	}
	schema.PrecomputeMessages()
}

func (s *server) submit(ctx context.Context, input *submitInput) (*createdOutput, error) {
	snapshot, err := s.Service.Submit(ctx, input.Body, input.IdempotencyKey)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &createdOutput{Location: "/v1/jobs/" + snapshot.ID, Body: snapshot}, nil
}

func (s *server) list(ctx context.Context, input *listInput) (*listOutput, error) {
	jobs, next, err := s.Service.Jobs(ctx, input.Cursor, input.Limit)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if jobs == nil {
		jobs = []job.Snapshot{}
	}
	return &listOutput{Body: jobList{Jobs: jobs, Next: next}}, nil
}

func (s *server) get(ctx context.Context, input *JobPath) (*jobOutput, error) {
	snapshot, err := s.Service.Job(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &jobOutput{Body: snapshot}, nil
}

func (s *server) delete(ctx context.Context, input *JobPath) (*struct{}, error) {
	if err := s.Service.Delete(ctx, input.ID); err != nil {
		return nil, s.fail(ctx, err)
	}
	return &struct{}{}, nil
}

func (s *server) registerActions(api huma.API) {
	actions := []struct {
		name, summary string
		act           func(context.Context, string) (job.Snapshot, error)
	}{
		{"cancel", "End a job; its image so far stays", s.Service.Cancel},
		{"pause", "Stop handing out work", s.Service.Pause},
		{"resume", "Go on after a pause", s.Service.Resume},
		{"finish", "Make the round under way the last", s.Service.Finish},
	}
	for _, action := range actions {
		huma.Register(api, huma.Operation{
			OperationID: action.name + "-job", Method: http.MethodPost,
			Path: "/v1/jobs/{id}/" + action.name, Tags: []string{"jobs"}, Summary: action.summary,
		}, func(ctx context.Context, input *JobPath) (*jobOutput, error) {
			snapshot, err := action.act(ctx, input.ID)
			if err != nil {
				return nil, s.fail(ctx, err)
			}
			return &jobOutput{Body: snapshot}, nil
		})
	}
}
