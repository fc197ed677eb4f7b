package api

import (
	"bytes"
	"context"
	"fmt"

	"github.com/maypok86/otter/v2"

	"metrofarm/services/internal/job"
)

// pictureBudget is for how many bytes of finished answers are kept. Those that take more are made anew.
const pictureBudget = 64 << 20

// picture is a finished answer to a request for an image.
type picture struct {
	film      string
	rounds    int
	mutations uint64
	body      []byte
}

// pictureKey names one. The film is a hash of all that the image shows.
type pictureKey struct {
	job, film string
	final     bool
	form      string
}

// pictures keeps finished answers: of a job that has ended, each would cost reading its checkpoint and
// developing the film, and a list of jobs asks for many at a time.
type pictures struct {
	service Service
	cache   *otter.Cache[pictureKey, picture]
}

func newPictures(service Service) (*pictures, error) {
	cache, err := otter.New(&otter.Options[pictureKey, picture]{
		MaximumWeight: pictureBudget,
		Weigher:       func(_ pictureKey, p picture) uint32 { return uint32(min(len(p.body), 2*pictureBudget)) },
	})
	if err != nil {
		return nil, fmt.Errorf("images to keep: %w", err)
	}
	return &pictures{service: service, cache: cache}, nil
}

// get an image in one form, which names the encoding with its options. Of those who ask at once, one
// has it made.
func (p *pictures) get(ctx context.Context, snapshot job.Snapshot, form string,
	encode func(*bytes.Buffer, job.Image) error,
) (picture, error) {
	develop := func(ctx context.Context) (picture, error) {
		image, err := p.service.Image(ctx, snapshot.ID)
		if err != nil {
			return picture{}, err
		}
		var buffer bytes.Buffer
		if err := encode(&buffer, image); err != nil {
			return picture{}, err
		}
		return picture{image.FilmSHA256, image.Rounds, image.Mutations, buffer.Bytes()}, nil
	}
	if snapshot.FilmSHA256 == "" {
		return develop(ctx)
	}
	key := pictureKey{snapshot.ID, snapshot.FilmSHA256, snapshot.State == job.Done, form}
	// Others may wait for it, so it is made even if the one who asked first goes away.
	return p.cache.Get(context.WithoutCancel(ctx), key, otter.LoaderFunc[pictureKey, picture](
		func(ctx context.Context, _ pictureKey) (picture, error) { return develop(ctx) }))
}
