package api_test

import (
	"context"
	"fmt"
	"sync"
	"sync/atomic"
	"testing"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/fakefarm"
	"metrofarm/services/internal/job"
)

// developing counts how often an image is developed.
type developing struct {
	*fakefarm.Farm
	times atomic.Int32
}

func (d *developing) Image(ctx context.Context, id string) (job.Image, error) {
	d.times.Add(1)
	return d.Farm.Image(ctx, id)
}

func TestImagesAreDevelopedOncePerFilm(t *testing.T) {
	var service developing
	f := newFixtureWith(t, func(options *api.Options) {
		service.Farm = options.Service.(*fakefarm.Farm)
		options.Service = &service
	})
	id := f.submit()
	round := func(n int, film string) {
		f.farm.CompleteRound(id, job.ConvergencePoint{Round: n, FilmSHA256: film},
			job.Image{Width: 64, Height: 32, RGB: make([]float32, 3*64*32), Variance: make([]float32, 3*64*32), FilmSHA256: film},
			func(s *job.Snapshot) { s.FilmSHA256 = film })
	}
	expect := func(times int32, film, path string) {
		t.Helper()
		got := f.expect(200, "GET", "/v1/jobs/"+id+"/"+path, "")
		if now := service.times.Load(); now != times || got.header.Get("ETag") != `"`+film+`"` {
			t.Errorf("%s: developed %d times, want %d; ETag %s, want %s", path, now, times, got.header.Get("ETag"), film)
		}
	}
	round(1, "f")
	expect(1, "f", "image.png?size=16")
	expect(1, "f", "image.png?size=16")
	expect(2, "f", "image.png?size=32")
	expect(3, "f", "image.pfm?layer=color")
	expect(4, "f", "image.exr")
	expect(4, "f", "image.exr?precision=float")
	round(2, "g")
	expect(5, "g", "image.png?size=16")

	var readers sync.WaitGroup
	for range 8 {
		readers.Go(func() { f.do("GET", fmt.Sprintf("/v1/jobs/%s/image.png?size=64", id), "") })
	}
	readers.Wait()
	if now := service.times.Load(); now != 6 {
		t.Errorf("developed %d times after 8 asked at once, want 6", now)
	}
}
