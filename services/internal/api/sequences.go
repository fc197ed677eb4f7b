package api

import (
	"context"
	"net/http"
	"net/url"
	"strings"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/sequence"
)

type submitSequenceInput struct {
	IdempotencyKey string `header:"Idempotency-Key" maxLength:"255" doc:"Repeat a request safely: the same key and body return the first sequence."`
	Body           job.SequenceRequest
}

// SequencePath is exported because huma fills embedded structs by reflection.
type SequencePath struct {
	ID string `path:"id" maxLength:"128" doc:"The sequence."`
}

type sequenceOutput struct {
	Body job.Sequence
}

type createdSequenceOutput struct {
	Location string `header:"Location"`
	Body     job.Sequence
}

type listSequencesInput struct {
	Cursor string `query:"cursor" maxLength:"128" doc:"The next of an earlier page; absent for the first."`
	Limit  int    `query:"limit" minimum:"1" maximum:"200" default:"50" doc:"Sequences per page."`
}

type sequenceList struct {
	Sequences []job.Sequence `json:"sequences" doc:"Newest first, without their frames."`
	Next      string         `json:"next,omitempty" doc:"Cursor of the next page; absent on the last."`
}

type listSequencesOutput struct {
	Body sequenceList
}

func (s *server) registerSequences(api huma.API) {
	huma.Register(api, huma.Operation{
		OperationID: "submit-sequence", Method: http.MethodPost, Path: "/v1/sequences", Tags: []string{"sequences"},
		Summary: "Submit a sequence of frames",
		Description: "One job for each frame, with the frame's shutter and seed; stop rules, priority and all else are " +
			"those of the member job. Frame n is centred on the time n / fps seconds, in the time of the scene's keyframes. " +
			"The sequence is stored durably with all of its jobs before the answer, or not at all. Its frames are jobs like " +
			"others: their images, events and controls are those of GET /v1/jobs/{id} and so on.",
		DefaultStatus: http.StatusCreated, MaxBodyBytes: s.Limits.BodyBytes, BodyReadTimeout: jsonBodyTimeout,
		Security: needs(auth.Submit),
	}, s.submitSequence)
	describeFrames(api.OpenAPI())
	huma.Register(api, huma.Operation{
		OperationID: "list-sequences", Method: http.MethodGet, Path: "/v1/sequences", Tags: []string{"sequences"},
		Summary: "List sequences, newest first", Security: needs(auth.Read),
	}, s.listSequences)
	huma.Register(api, huma.Operation{
		OperationID: "get-sequence", Method: http.MethodGet, Path: "/v1/sequences/{id}", Tags: []string{"sequences"},
		Summary: "Get a sequence with its frames", Security: needs(auth.Read),
	}, func(ctx context.Context, input *SequencePath) (*sequenceOutput, error) {
		return s.sequence(ctx)(s.Service.Sequence(ctx, input.ID))
	})
	huma.Register(api, huma.Operation{
		OperationID: "delete-sequence", Method: http.MethodDelete, Path: "/v1/sequences/{id}", Tags: []string{"sequences"},
		Summary: "Delete a sequence whose frames have ended, with their jobs, images and events",
		Description: "The sequences of other users need the role admin. A sequence is also gone when the last of its jobs " +
			"was deleted.",
		DefaultStatus: http.StatusNoContent, Security: needs(auth.Submit),
	}, s.deleteSequence)
	s.registerSequenceActions(api)
}

func (s *server) registerSequenceActions(api huma.API) {
	actions := []struct {
		name, doing, summary string
		act                  func(context.Context, sequence.Service, string) (job.Sequence, error)
	}{
		{"cancel", "canceling", "End the frames that have not ended; the images so far stay", sequence.Cancel},
		{"pause", "pausing", "Stop handing out work of the frames that have not ended", sequence.Pause},
		{"resume", "resuming", "Go on with the frames that are paused", sequence.Resume},
	}
	for _, action := range actions {
		huma.Register(api, huma.Operation{
			OperationID: action.name + "-sequence", Method: http.MethodPost,
			Path: "/v1/sequences/{id}/" + action.name, Tags: []string{"sequences"}, Summary: action.summary,
			Description: "The sequences of other users need the role admin.",
			Security:    needs(auth.Submit),
		}, func(ctx context.Context, input *SequencePath) (*sequenceOutput, error) {
			if err := s.checkOwnSequence(ctx, input.ID, action.doing); err != nil {
				return nil, err
			}
			return s.sequence(ctx)(action.act(ctx, s.Service, input.ID))
		})
	}
}

// describeFrames describes the fields of frames, whose values job.SequenceRequest.Validate checks.
func describeFrames(document *huma.OpenAPI) {
	schema := document.Components.Schemas.Map()["Frames"]
	for _, option := range job.FrameOptions() {
		describeOption(schema.Properties[strings.TrimPrefix(option.Field, "frames.")], option)
	}
	schema.Properties["start"].Description = "first frame, 0 or later"
	schema.Properties["end"].Description = "last frame; there are at most 1000"
	schema.PrecomputeMessages()
}

func (s *server) submitSequence(ctx context.Context, input *submitSequenceInput) (*createdSequenceOutput, error) {
	q, err := s.Service.SubmitSequence(ctx, input.Body, keyOf(auth.From(ctx), input.IdempotencyKey))
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &createdSequenceOutput{Location: "/v1/sequences/" + q.ID, Body: linked(q)}, nil
}

func (s *server) listSequences(ctx context.Context, input *listSequencesInput) (*listSequencesOutput, error) {
	sequences, next, err := s.Service.Sequences(ctx, input.Cursor, input.Limit)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if sequences == nil {
		sequences = []job.Sequence{}
	}
	return &listSequencesOutput{Body: sequenceList{Sequences: sequences, Next: next}}, nil
}

// sequence makes the answer of what a service returns.
func (s *server) sequence(ctx context.Context) func(job.Sequence, error) (*sequenceOutput, error) {
	return func(q job.Sequence, err error) (*sequenceOutput, error) {
		if err != nil {
			return nil, s.fail(ctx, err)
		}
		return &sequenceOutput{Body: linked(q)}, nil
	}
}

// checkOwnSequence refuses what users may do to their own sequences only, unless an admin does it.
func (s *server) checkOwnSequence(ctx context.Context, id, doing string) error {
	q, err := s.Service.Sequence(ctx, id)
	if err != nil {
		return s.fail(ctx, err)
	}
	return checkOwner(ctx, q.User, "sequence", doing)
}

func (s *server) deleteSequence(ctx context.Context, input *SequencePath) (*struct{}, error) {
	if err := s.checkOwnSequence(ctx, input.ID, "deleting"); err != nil {
		return nil, err
	}
	if err := sequence.Delete(ctx, s.Service, input.ID); err != nil {
		return nil, s.fail(ctx, err)
	}
	return &struct{}{}, nil
}

// linked says where the frames are.
func linked(q job.Sequence) job.Sequence {
	for i := range q.Frames {
		f := &q.Frames[i]
		if f.State == job.Deleted {
			continue
		}
		path := "/v1/jobs/" + url.PathEscape(f.Job)
		f.Links = map[string]string{"job": path, "exr": path + "/image.exr", "png": path + "/image.png"}
	}
	return q
}
