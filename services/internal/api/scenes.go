package api

import (
	"context"
	"errors"
	"fmt"
	"io"
	"mime"
	"mime/multipart"
	"net/http"
	"strings"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/job"
)

// uploadInput keeps the body as a stream: bundles are far larger than memory should be asked for.
type uploadInput struct {
	ContentType   string `header:"Content-Type" hidden:"true"`
	ContentLength int64  `header:"Content-Length" hidden:"true"`
	ctx           huma.Context
}

// Resolve takes the way to the body, which huma otherwise hides.
func (u *uploadInput) Resolve(ctx huma.Context) []error {
	u.ctx = ctx
	return nil
}

type sceneOutput struct {
	Body bundle.Scene
}

type scenesOutput struct {
	Body struct {
		Scenes []bundle.Listed `json:"scenes" doc:"The latest used first."`
	}
}

type scenePath struct {
	Digest string `path:"sha256" maxLength:"64" doc:"The bundle's digest."`
}

func (s *server) registerScenes(api huma.API) {
	binary := &huma.MediaType{Schema: &huma.Schema{Type: huma.TypeString, Format: "binary"}}
	form := &huma.MediaType{Schema: &huma.Schema{
		Type: huma.TypeObject, Required: []string{"file"},
		Properties: map[string]*huma.Schema{"file": binary.Schema},
	}}
	huma.Register(api, huma.Operation{
		OperationID: "upload-scene", Method: http.MethodPost, Path: "/v1/scenes", Tags: []string{"scenes"},
		Summary: "Upload a bundle: the scene file and all that it names",
		Description: "A zip, or a tar (plain, gzip or zstd), told by its content; as the body or as the form " +
			"field file. Bundles are named by their content: uploading again changes nothing.",
		DefaultStatus: http.StatusCreated,
		Security:      needs(auth.Submit), Middlewares: huma.Middlewares{s.limitUploads(api)},
	}, s.upload)
	// Told to huma only now: it would read the body itself if the operation had named it before.
	api.OpenAPI().Paths["/v1/scenes"].Post.RequestBody = &huma.RequestBody{
		Required: true, Content: map[string]*huma.MediaType{
			"application/zip": binary, "application/x-tar": binary, "application/gzip": binary,
			"application/zstd": binary, "multipart/form-data": form,
		},
	}
	huma.Register(api, huma.Operation{
		OperationID: "list-scenes", Method: http.MethodGet, Path: "/v1/scenes", Tags: []string{"scenes"},
		Summary: "List the stored bundles that have a scene file", Security: needs(auth.Read),
	}, s.scenes)
	huma.Register(api, huma.Operation{
		OperationID: "get-scene", Method: http.MethodGet, Path: "/v1/scenes/{sha256}", Tags: []string{"scenes"},
		Summary: "List what a bundle holds", Security: needs(auth.Read),
	}, s.scene)
}

// formOverhead is what a form may have around its file.
const formOverhead = 64 << 10

func (s *server) upload(ctx context.Context, input *uploadInput) (*sceneOutput, error) {
	// A client that waits for our word, as curl does, then sends nothing at all.
	if err := s.Scenes.Limits().CheckUpload(input.ContentLength - formOverhead); err != nil {
		return nil, s.fail(ctx, err)
	}
	archive, err := archiveOf(input.ContentType, s.newUploadReader(input.ctx))
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	scene, err := s.Scenes.AddArchive(ctx, archive)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &sceneOutput{Body: scene}, nil
}

// archiveOf finds the archive in the body: the body itself, or a form's file.
func archiveOf(contentType string, body io.Reader) (io.Reader, error) {
	mediaType, parameters, err := mime.ParseMediaType(contentType)
	if err != nil || !strings.HasPrefix(mediaType, "multipart/") {
		return body, nil
	}
	parts := multipart.NewReader(body, parameters["boundary"])
	for {
		part, err := parts.NextPart()
		switch {
		case errors.Is(err, io.EOF):
			return nil, &job.FieldError{Field: "file", Detail: "the form has no file of this name"}
		case err != nil:
			return nil, fmt.Errorf("%w: reading the form: %w", job.ErrInvalid, err)
		case part.FormName() == "file":
			return part, nil
		}
	}
}

func (s *server) scenes(ctx context.Context, _ *struct{}) (*scenesOutput, error) {
	scenes, err := s.Scenes.Scenes(ctx)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	output := &scenesOutput{}
	output.Body.Scenes = scenes
	return output, nil
}

func (s *server) scene(ctx context.Context, input *scenePath) (*sceneOutput, error) {
	scene, err := s.Scenes.Scene(ctx, input.Digest)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &sceneOutput{Body: scene}, nil
}
