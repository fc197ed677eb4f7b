package api

import (
	"bytes"
	"context"
	"net/http"
	"strconv"
	"strings"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/exr"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/preview"
)

// ImageInput is exported because huma fills embedded structs by reflection.
type ImageInput struct {
	JobPath
	IfNoneMatch string `header:"If-None-Match"`
}

type exrInput struct {
	ImageInput
	Precision string `query:"precision" enum:"half,float" default:"float"`
}

type pngInput struct {
	ImageInput
	Exposure string `query:"exposure" default:"auto" doc:"Stops, -20 to 20, or auto: chosen from the image."`
}

type imageOutput struct {
	Status      int
	ContentType string `header:"Content-Type"`
	ETag        string `header:"ETag"`
	Disposition string `header:"Content-Disposition"`
	Body        []byte
}

func (s *server) registerImages(api huma.API) {
	register := func(name, mediaType, summary string) huma.Operation {
		return huma.Operation{
			OperationID: "get-" + strings.ReplaceAll(name, ".", "-"), Method: http.MethodGet,
			Path: "/v1/jobs/{id}/" + name, Tags: []string{"images"}, Summary: summary,
			Description: "The complete rounds so far; 409 before the first. ETag is the film's hash.",
			Responses: map[string]*huma.Response{
				"200": {Description: "The image", Content: map[string]*huma.MediaType{mediaType: {}}},
				"304": {Description: "If-None-Match names the current film"},
			},
		}
	}
	huma.Register(api, register("image.exr", "image/x-exr", "The image with its variance, as OpenEXR"), s.imageEXR)
	huma.Register(api, register("image.png", "image/png", "The image for looking at, as PNG"), s.imagePNG)
}

func (s *server) imageEXR(ctx context.Context, input *exrInput) (*imageOutput, error) {
	options := exr.Options{Half: input.Precision == "half", Variance: true}
	return s.image(ctx, input.ImageInput, "exr", "image/x-exr", func(buffer *bytes.Buffer, image job.Image) error {
		return exr.Write(buffer, image, options)
	})
}

func (s *server) imagePNG(ctx context.Context, input *pngInput) (*imageOutput, error) {
	exposure, err := parseExposure(input.Exposure)
	if err != nil {
		return nil, err
	}
	return s.image(ctx, input.ImageInput, "png", "image/png", func(buffer *bytes.Buffer, image job.Image) error {
		return preview.WritePNG(buffer, image, exposure)
	})
}

func parseExposure(text string) (float64, error) {
	if text == "auto" {
		return preview.Auto(), nil
	}
	stops, err := strconv.ParseFloat(text, 64)
	if err != nil || !(stops >= -20 && stops <= 20) {
		return 0, huma.Error422UnprocessableEntity("validation failed", &huma.ErrorDetail{
			Message: "expected -20 to 20 stops, or auto", Location: "query.exposure", Value: text,
		})
	}
	return stops, nil
}

func (s *server) image(ctx context.Context, input ImageInput, extension, mediaType string,
	encode func(*bytes.Buffer, job.Image) error,
) (*imageOutput, error) {
	// Asking for the snapshot first saves developing an image that the client has.
	snapshot, err := s.Service.Job(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if snapshot.FilmSHA256 != "" && strings.Contains(input.IfNoneMatch, quoted(snapshot.FilmSHA256)) {
		return &imageOutput{Status: http.StatusNotModified, ETag: quoted(snapshot.FilmSHA256)}, nil
	}
	image, err := s.Service.Image(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	var buffer bytes.Buffer
	if err := encode(&buffer, image); err != nil {
		return nil, s.fail(ctx, err)
	}
	return &imageOutput{
		Status: http.StatusOK, ContentType: mediaType, ETag: quoted(image.FilmSHA256),
		Disposition: `inline; filename="` + input.ID + "." + extension + `"`,
		Body:        buffer.Bytes(),
	}, nil
}

func quoted(text string) string { return `"` + text + `"` }
