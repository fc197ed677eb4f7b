package api

import (
	"bytes"
	"context"
	"fmt"
	"io"
	"net/http"
	"strconv"
	"strings"

	"github.com/danielgtaylor/huma/v2"
	"github.com/klauspost/compress/gzip"

	"metrofarm/services/internal/auth"
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
	Size     int    `query:"size" minimum:"16" maximum:"1024" doc:"Pixels of the longer side at most; absent: the image's own size."`
	Film     string `query:"film" maxLength:"128" doc:"The film's hash, from the job: caches may keep the answer if that is the film shown."`
	Exposure string `query:"exposure" default:"auto" doc:"Stops, -20 to 20, or auto: chosen from the image."`
}

type pfmInput struct {
	ImageInput
	Layer    string `query:"layer" enum:"color,variance" default:"color" doc:"variance: the estimated variance of each pixel's mean."`
	Encoding string `header:"Accept-Encoding"`
}

type imageOutput struct {
	Status      int
	ContentType string `header:"Content-Type"`
	Encoding    string `header:"Content-Encoding"`
	Vary        string `header:"Vary"`
	ETag        string `header:"ETag"`
	Cache       string `header:"Cache-Control"`
	Disposition string `header:"Content-Disposition"`
	Rounds      string `header:"Metrofarm-Rounds" doc:"Complete rounds that the image shows."`
	Mutations   string `header:"Metrofarm-Mutations" doc:"Mutations, or samples, in them."`
	Body        []byte
}

func (s *server) registerImages(api huma.API) {
	register := func(name, mediaType, summary string) huma.Operation {
		return huma.Operation{
			OperationID: "get-" + strings.ReplaceAll(name, ".", "-"), Method: http.MethodGet,
			Path: "/v1/jobs/{id}/" + name, Tags: []string{"images"}, Summary: summary,
			Description: "The complete rounds so far; 409 before the first. ETag is the film's hash. A job goes on while " +
				"one reads: Metrofarm-Rounds and Metrofarm-Mutations tell of this image, the job's snapshot of another moment.",
			Security: needs(auth.Read),
			Responses: map[string]*huma.Response{
				"200": {Description: "The image", Content: map[string]*huma.MediaType{mediaType: {}}},
				"304": {Description: "If-None-Match names the current film"},
			},
		}
	}
	huma.Register(api, register("image.exr", "image/x-exr", "The image with its variance, as OpenEXR"), s.imageEXR)
	huma.Register(api, register("image.png", "image/png", "The image for looking at, as PNG"), s.imagePNG)
	pfm := register("image.pfm", pfmType, "The image's values, as portable float map")
	pfm.Description += " After three lines of text (PF, width and height, -1.0) come red, green and blue of each pixel as " +
		"little-endian floats, row by row from the bottom. Compressed by gzip for those who accept it."
	huma.Register(api, pfm, s.imagePFM)
}

func (s *server) imageEXR(ctx context.Context, input *exrInput) (*imageOutput, error) {
	options := exr.Options{Half: input.Precision == "half", Variance: true}
	return s.image(ctx, input.ImageInput, imageForm{
		extension: "exr", mediaType: "image/x-exr", options: input.Precision,
		encode: func(buffer *bytes.Buffer, image job.Image) error { return exr.Write(buffer, image, options) },
	})
}

func (s *server) imagePNG(ctx context.Context, input *pngInput) (*imageOutput, error) {
	exposure, err := parseExposure(input.Exposure)
	if err != nil {
		return nil, err
	}
	output, err := s.image(ctx, input.ImageInput, imageForm{
		extension: "png", mediaType: "image/png", options: fmt.Sprint(input.Size, exposure),
		encode: func(buffer *bytes.Buffer, image job.Image) error {
			if input.Size > 0 {
				image = preview.Shrink(image, input.Size)
			}
			return preview.WritePNG(buffer, image, exposure)
		},
	})
	if err == nil && output.ETag == quoted(input.Film) {
		output.Cache = "private, max-age=86400" // the address names the film
	}
	return output, err
}

const pfmType = "image/x-portable-floatmap"

func (s *server) imagePFM(ctx context.Context, input *pfmInput) (*imageOutput, error) {
	zipped := strings.Contains(input.Encoding, "gzip")
	output, err := s.image(ctx, input.ImageInput, imageForm{
		extension: "pfm", mediaType: pfmType, options: fmt.Sprint(input.Layer, zipped),
		encode: func(buffer *bytes.Buffer, image job.Image) error {
			if input.Layer == "variance" {
				image.RGB = image.Variance
			}
			if zipped {
				return zip(buffer, func(w io.Writer) error { return preview.WritePFM(w, image) })
			}
			return preview.WritePFM(buffer, image)
		},
	})
	if err != nil {
		return nil, err
	}
	output.Vary = "Accept-Encoding"
	if zipped && output.Status == http.StatusOK {
		output.Encoding = "gzip"
	}
	return output, nil
}

// zip compresses what write writes: fast rather than small, for noise hardly shrinks.
func zip(w io.Writer, write func(io.Writer) error) error {
	compressor, err := gzip.NewWriterLevel(w, gzip.BestSpeed)
	if err != nil {
		return err
	}
	if err := write(compressor); err != nil {
		return err
	}
	return compressor.Close()
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

// imageForm is how an image is asked for.
type imageForm struct {
	extension, mediaType string
	// options tell forms of one extension apart.
	options string
	encode  func(*bytes.Buffer, job.Image) error
}

// String tells forms apart.
func (f imageForm) String() string { return f.extension + " " + f.options }

func (s *server) image(ctx context.Context, input ImageInput, form imageForm) (*imageOutput, error) {
	// Asking for the snapshot first saves developing an image that the client has.
	snapshot, err := s.Service.Job(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	if snapshot.FilmSHA256 != "" && strings.Contains(input.IfNoneMatch, quoted(snapshot.FilmSHA256)) {
		return &imageOutput{Status: http.StatusNotModified, ETag: quoted(snapshot.FilmSHA256)}, nil
	}
	made, err := s.pictures.get(ctx, snapshot, form.String(), form.encode)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &imageOutput{
		Status: http.StatusOK, ContentType: form.mediaType, ETag: quoted(made.film),
		Disposition: `inline; filename="` + input.ID + "." + form.extension + `"`,
		Rounds:      strconv.Itoa(made.rounds), Mutations: strconv.FormatUint(made.mutations, 10),
		Body: made.body,
	}, nil
}

func quoted(text string) string { return `"` + text + `"` }
