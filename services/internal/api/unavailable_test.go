package api_test

import (
	"context"
	"fmt"
	"net/http"
	"testing"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/job"
)

// busy is a coordinator that cannot read a job's film now.
type busy struct{ api.Service }

func (busy) Image(context.Context, string) (job.Image, error) {
	return job.Image{}, fmt.Errorf("job j1: %w", job.ErrUnavailable)
}

func TestWhatIsNotAvailableNowSaysWhenToAskAgain(t *testing.T) {
	f := newFixtureWith(t, func(o *api.Options) { o.Service = busy{o.Service} })
	id := f.submit()
	for _, image := range []string{"image.exr", "image.png", "image.pfm"} {
		response, err := http.Get(f.server.URL + "/v1/jobs/" + id + "/" + image)
		if err != nil {
			t.Fatal(err)
		}
		_ = response.Body.Close()
		if response.StatusCode != http.StatusServiceUnavailable || response.Header.Get("Retry-After") == "" {
			t.Errorf("%s: %d, Retry-After %q", image, response.StatusCode, response.Header.Get("Retry-After"))
		}
	}
}
