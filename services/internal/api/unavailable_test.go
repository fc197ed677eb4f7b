package api_test

import (
	"context"
	"fmt"
	"net/http"
	"strings"
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

// full is a coordinator that takes no more jobs.
type full struct{ api.Service }

func (full) Submit(context.Context, job.Request, string) (job.Snapshot, error) {
	return job.Snapshot{}, fmt.Errorf("%w: cancel some", job.ErrTooMany)
}

func TestTooManyJobsAreAnsweredAsTooManyRequestsAre(t *testing.T) {
	f := newFixtureWith(t, func(o *api.Options) { o.Service = full{o.Service} })
	answer := f.expect(http.StatusTooManyRequests, "POST", "/v1/jobs", request)
	if answer.header.Get("Retry-After") == "" || !strings.Contains(string(answer.body), "too many jobs: cancel some") ||
		answer.header.Get("Content-Type") != "application/problem+json" {
		t.Errorf("%v %s", answer.header, answer.body)
	}
}
