package api

import (
	"cmp"
	"context"
	"crypto/sha256"
	"encoding/hex"
	"encoding/json"
	"errors"
	"net/http"
	"strings"
	"time"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
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
	View   string `query:"view" enum:"full,brief" default:"full" doc:"brief leaves out the resolved spec, lengths, techniques and warnings."`
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
		Summary: "Submit a job",
		Description: "The job is stored durably before the answer. 429: as many jobs as the server takes have not ended; " +
			"a repeated Idempotency-Key is answered so, too.",
		DefaultStatus: http.StatusCreated, MaxBodyBytes: s.Limits.BodyBytes, BodyReadTimeout: jsonBodyTimeout,
		Security: needs(auth.Submit),
	}, s.submit)
	relaxRequest(api.OpenAPI())
	huma.Register(api, huma.Operation{
		OperationID: "list-jobs", Method: http.MethodGet, Path: "/v1/jobs", Tags: []string{"jobs"},
		Summary: "List jobs, newest first", Security: needs(auth.Read),
	}, s.list)
	huma.Register(api, huma.Operation{
		OperationID: "get-job", Method: http.MethodGet, Path: "/v1/jobs/{id}", Tags: []string{"jobs"},
		Summary: "Get a job", Security: needs(auth.Read),
	}, s.get)
	huma.Register(api, huma.Operation{
		OperationID: "change-job", Method: http.MethodPatch, Path: "/v1/jobs/{id}", Tags: []string{"jobs"},
		Summary: "Change the name or the priority of a job that has not ended",
		Description: "The body is a JSON merge patch (RFC 7396): what is absent stays, null asks for the default. " +
			"The jobs of other users need the role admin.",
		MaxBodyBytes: s.Limits.BodyBytes, BodyReadTimeout: jsonBodyTimeout,
		Security: needs(auth.Submit),
	}, s.change)
	huma.Register(api, huma.Operation{
		OperationID: "delete-job", Method: http.MethodDelete, Path: "/v1/jobs/{id}", Tags: []string{"jobs"},
		Summary:       "Delete a job that has ended, with its image and events",
		Description:   "The jobs of other users need the role admin.",
		DefaultStatus: http.StatusNoContent, Security: needs(auth.Submit),
	}, s.delete)
}

// relaxRequest makes the stop rules optional in requests: with none, the scene's sample count
// decides. (They are always present in answers, so the type has no omitempty.) It also describes the
// options, whose words job.Request.Validate checks.
func relaxRequest(document *huma.OpenAPI) {
	schemas := document.Components.Schemas.Map()
	schema := schemas["Request"]
	schema.Required = []string{"scene", "entry"}
	schema.Properties["shutter_curve"] = &huma.Schema{OneOf: []*huma.Schema{
		{Type: huma.TypeString}, {Type: huma.TypeArray, Items: &huma.Schema{Type: huma.TypeNumber}},
	}}
	for _, option := range job.Options() {
		owner, name := schema, option.Field
		if rest, nested := strings.CutPrefix(option.Field, "stop."); nested {
			owner, name = schemas["StopRules"], rest
		}
		describeOption(owner.Properties[name], option)
	}
	schema.PrecomputeMessages()
}

func describeOption[T any](property *huma.Schema, option job.OptionOf[T]) {
	property.Description = option.Help()
	if len(option.Choices) > 0 {
		property.Description += ": " + strings.Join(option.Choices, ", ")
	}
	property.Extensions = optionExtensions(option)
}

// optionExtensions tell forms what an option is; an enum would refuse values with words of its own.
func optionExtensions[T any](option job.OptionOf[T]) map[string]any {
	extensions := map[string]any{"x-summary": option.Text}
	if len(option.Choices) > 0 {
		extensions["x-choices"] = option.Choices
	}
	if len(option.Integrators) > 0 {
		extensions["x-integrators"] = option.Integrators
	}
	return extensions
}

func (s *server) submit(ctx context.Context, input *submitInput) (*createdOutput, error) {
	snapshot, err := s.Service.Submit(ctx, input.Body, keyOf(auth.From(ctx), input.IdempotencyKey))
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &createdOutput{Location: "/v1/jobs/" + snapshot.ID, Body: snapshot}, nil
}

// keyOf keeps the idempotency keys of users apart: a key that somebody else used returns no job of
// theirs.
func keyOf(who auth.Identity, key string) string {
	if who.User == "" || key == "" {
		return key
	}
	sum := sha256.Sum256([]byte(who.User + "\n" + key))
	return hex.EncodeToString(sum[:])
}

func (s *server) list(ctx context.Context, input *listInput) (*listOutput, error) {
	jobs, next, err := s.Service.Jobs(ctx, input.Cursor, input.Limit)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if jobs == nil {
		jobs = []job.Snapshot{}
	}
	if input.View == "brief" {
		for i := range jobs {
			jobs[i] = jobs[i].Brief()
		}
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

// changeInput is the merge patch of a job.
type changeInput struct {
	JobPath
	Body changeBody `contentType:"application/merge-patch+json"`
}

type changeBody map[string]json.RawMessage

// Schema describes what can be changed; job.ParseChange says what is wrong with other members.
func (changeBody) Schema(huma.Registry) *huma.Schema {
	return &huma.Schema{Type: huma.TypeObject, AdditionalProperties: true, Properties: map[string]*huma.Schema{
		"name":     {Type: huma.TypeString, Nullable: true, Description: "For people; null: the scene file's name."},
		"priority": {Type: huma.TypeInteger, Nullable: true, Description: "From -100 to 100, higher goes first; null: 0."},
	}}
}

func (s *server) change(ctx context.Context, input *changeInput) (*jobOutput, error) {
	change, err := job.ParseChange(input.Body)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if err := s.checkOwn(ctx, input.ID, "changing"); err != nil {
		return nil, err
	}
	snapshot, err := s.Service.Change(ctx, input.ID, change)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &jobOutput{Body: snapshot}, nil
}

// checkOwn refuses what users may do to their own jobs only, unless an admin does it.
func (s *server) checkOwn(ctx context.Context, id, doing string) error {
	snapshot, err := s.Service.Job(ctx, id)
	if err != nil {
		return s.fail(ctx, err)
	}
	return checkOwner(ctx, snapshot.User, "job", doing)
}

func checkOwner(ctx context.Context, owner, what, doing string) error {
	if who := auth.From(ctx); who.User != owner && !who.Role.Includes(auth.Admin) {
		return huma.Error403Forbidden("this is a " + what + " of " + cmp.Or(owner, "nobody in particular") + "; " + doing + " it needs the role admin")
	}
	return nil
}

func (s *server) delete(ctx context.Context, input *JobPath) (*struct{}, error) {
	if err := s.checkOwn(ctx, input.ID, "deleting"); err != nil {
		return nil, err
	}
	if err := s.Service.Delete(ctx, input.ID); err != nil {
		return nil, s.fail(ctx, err)
	}
	return &struct{}{}, nil
}

type refineInput struct {
	JobPath
	Body job.StopRules
}

// Resolve is called once the body has been read. Its deadline would end the request while a large
// checkpoint is read: the server goes on reading, to see whether the client is there.
func (*refineInput) Resolve(ctx huma.Context) []error {
	_ = ctx.SetReadDeadline(time.Time{})
	return nil
}

func (s *server) registerRefine(api huma.API) {
	huma.Register(api, huma.Operation{
		OperationID: "refine-job", Method: http.MethodPost, Path: "/v1/jobs/{id}/refine", Tags: []string{"jobs"},
		Summary: "Let a job that has ended go on",
		Description: "The jobs of other users need the role admin. " +
			"A job that is done, or was canceled after its first checkpoint, goes on from there under the same " +
			"id. The stop rules of the body replace those it had; each must ask for more than before and than there " +
			"is, else the answer is 422 and names it. The image is, bit by bit, that of a job which was submitted " +
			"with these rules. It is stored durably before the answer; repeated with the same body, it changes nothing.",
		MaxBodyBytes: s.Limits.BodyBytes, BodyReadTimeout: jsonBodyTimeout,
		Security: needs(auth.Submit),
	}, func(ctx context.Context, input *refineInput) (*jobOutput, error) {
		if err := s.checkOwn(ctx, input.ID, "refining"); err != nil {
			return nil, err
		}
		snapshot, err := s.Service.Refine(ctx, input.ID, input.Body)
		var field *job.FieldError
		if errors.As(err, &field) {
			err = field.InBody()
		}
		if err != nil {
			return nil, s.fail(ctx, err)
		}
		return &jobOutput{Body: snapshot}, nil
	})
}

func (s *server) registerActions(api huma.API) {
	actions := []struct {
		name, doing, summary string
		act                  func(context.Context, string) (job.Snapshot, error)
	}{
		{"cancel", "canceling", "End a job; its image so far stays", s.Service.Cancel},
		{"pause", "pausing", "Stop handing out work", s.Service.Pause},
		{"resume", "resuming", "Go on after a pause", s.Service.Resume},
		{"finish", "finishing", "Make the round under way the last", s.Service.Finish},
	}
	for _, action := range actions {
		huma.Register(api, huma.Operation{
			OperationID: action.name + "-job", Method: http.MethodPost,
			Path: "/v1/jobs/{id}/" + action.name, Tags: []string{"jobs"}, Summary: action.summary,
			Description: "The jobs of other users need the role admin.",
			Security:    needs(auth.Submit),
		}, func(ctx context.Context, input *JobPath) (*jobOutput, error) {
			if err := s.checkOwn(ctx, input.ID, action.doing); err != nil {
				return nil, err
			}
			snapshot, err := action.act(ctx, input.ID)
			if err != nil {
				return nil, s.fail(ctx, err)
			}
			return &jobOutput{Body: snapshot}, nil
		})
	}
}
