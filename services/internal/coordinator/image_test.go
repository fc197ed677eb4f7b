package coordinator_test

import (
	"context"
	"errors"
	"io"
	"path/filepath"
	"testing"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// interfering blobs let something happen before a checkpoint is opened.
type interfering struct {
	blob.Backend
	before func(name string)
}

func (i *interfering) Open(ctx context.Context, key blob.Key) (io.ReadCloser, error) {
	if key.Kind == blob.Named {
		i.before(key.Name)
	}
	return i.Backend.Open(ctx, key)
}

// watched is a pair of which the first renders a job, and the second has something happen before it opens
// a checkpoint.
func watched(t *testing.T) (p *pair, blobs *interfering, id string) {
	t.Helper()
	p = newPair(t, 5*time.Second)
	first, second := p.sites[0], p.sites[1]
	backend, err := dir.Open(filepath.Join(second.dir, "blobs"))
	second.check(err)
	blobs = &interfering{Backend: backend}
	tune := second.tune
	second.tune = func(o *coordinator.Options) {
		tune(o)
		o.Blobs = blob.New(blobs)
	}
	first.start()
	t.Cleanup(first.stop)
	second.start()
	t.Cleanup(second.stop)
	first.crew(workers(2, nil)...)
	id = first.submit(pathRequest(10))
	first.settled(id)
	return p, blobs, id
}

// TestAnImageOfAJobThatIsRefinedElsewhere: its checkpoint is replaced between the look at the record and the
// look at the blob.
func TestAnImageOfAJobThatIsRefinedElsewhere(t *testing.T) {
	t.Parallel()
	p, blobs, id := watched(t)
	samples := uint64(10)
	refine := func(string) {
		samples += 10
		p.sites[0].refine(id, job.StopRules{SamplesPerPixel: samples})
		p.sites[0].settled(id)
	}
	refined := false
	blobs.before = func(name string) {
		if !refined {
			refined = true
			refine(name)
		}
	}
	image, err := p.sites[1].c.Image(t.Context(), id)
	if want := p.sites[0].job(id).FilmSHA256; err != nil || image.FilmSHA256 != want {
		t.Errorf("film %q, error %v; want %q", image.FilmSHA256, err, want)
	}
	blobs.before = refine
	if _, err := p.sites[1].c.Image(t.Context(), id); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("refined again and again: %v", err)
	}
}

func TestAnImageWhoseCheckpointIsLost(t *testing.T) {
	t.Parallel()
	p, blobs, id := watched(t)
	opened := 0
	blobs.before = func(name string) {
		opened++
		p.sites[1].check(blobs.Delete(t.Context(), blob.Key{Kind: blob.Named, Name: name}))
	}
	_, err := p.sites[1].c.Image(t.Context(), id)
	if !errors.Is(err, blob.ErrNotFound) || errors.Is(err, job.ErrUnavailable) || opened != 2 {
		t.Errorf("opened %d times, error %v", opened, err)
	}
}

// TestFewImagesAreDevelopedAtATime: also those of jobs that go on. What was developed is there all the same.
func TestFewImagesAreDevelopedAtATime(t *testing.T) {
	t.Parallel()
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.ReadPatience = 50 * time.Millisecond }
	s.start()
	t.Cleanup(s.stop)
	dismiss := s.crew(workers(2, nil)...)
	id := s.submit(longRequest())
	s.await(id, "in its second round", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	dismiss()
	done := s.c.OccupyDevelopers()
	if _, err := s.c.Image(t.Context(), id); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("an image that nobody has developed: %v", err)
	}
	done()
	shown, err := s.c.Image(t.Context(), id)
	s.check(err)
	defer s.c.OccupyDevelopers()()
	if image, err := s.c.Image(t.Context(), id); err != nil || image.FilmSHA256 != shown.FilmSHA256 {
		t.Errorf("one that was developed: film %q, error %v; want %q", image.FilmSHA256, err, shown.FilmSHA256)
	}
}
