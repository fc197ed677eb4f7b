package coordinator_test

import (
	"context"
	"errors"
	"io"
	"path/filepath"
	"sync"
	"testing"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// gated blobs are opened one by one, when the test lets them.
type gated struct {
	blob.Backend
	pass chan struct{} // nil: nothing is held up

	mu   sync.Mutex
	open int // that wait
	most int
}

func (g *gated) Open(ctx context.Context, key blob.Key) (io.ReadCloser, error) {
	g.mu.Lock()
	pass := g.pass
	if pass != nil && key.Kind == blob.Named {
		g.open++
		g.most = max(g.most, g.open)
	}
	g.mu.Unlock()
	if pass != nil && key.Kind == blob.Named {
		<-pass
		g.mu.Lock()
		g.open--
		g.mu.Unlock()
	}
	return g.Backend.Open(ctx, key)
}

func (g *gated) waiting() int {
	g.mu.Lock()
	defer g.mu.Unlock()
	return g.open
}

// ended is a coordinator with a job that has ended, whose checkpoint is read when the test lets it.
func ended(t *testing.T, tune func(*coordinator.Options)) (s *site, gate *gated, id string) {
	t.Helper()
	s = newSite(t)
	backend, err := dir.Open(filepath.Join(s.dir, "blobs"))
	s.check(err)
	gate = &gated{Backend: backend}
	s.tune = func(o *coordinator.Options) {
		o.Blobs = blob.New(gate)
		tune(o)
	}
	s.start()
	t.Cleanup(s.stop)
	s.crew(workers(2, nil)...)
	id = s.finished(s.submit(pathRequest(30))).ID
	s.await(id, "given up", func(job.Snapshot) bool { return len(s.c.Own()) == 0 })
	gate.mu.Lock()
	gate.pass = make(chan struct{})
	gate.mu.Unlock()
	return s, gate, id
}

func TestFewCheckpointsAreReadAtATime(t *testing.T) {
	t.Parallel()
	for name, c := range map[string]struct {
		films float64
		most  int
	}{"small": {4, 2}, "large": {3.9, 1}} {
		t.Run(name, func(t *testing.T) {
			t.Parallel()
			s, gate, id := ended(t, func(o *coordinator.Options) {
				o.FilmsMemory, o.ReadPatience = int64(c.films*filmBytes), patience
			})
			var requests sync.WaitGroup
			const images = 6
			for range images {
				requests.Go(func() {
					if _, err := s.c.Image(t.Context(), id); err != nil {
						t.Error(err)
					}
				})
			}
			for range images {
				gate.pass <- struct{}{}
			}
			requests.Wait()
			if gate.most > c.most {
				t.Errorf("%d checkpoints were read at a time, want at most %d", gate.most, c.most)
			}
		})
	}
}

func TestAnImageThatWaitsTooLongIsPutOff(t *testing.T) {
	t.Parallel()
	s, gate, id := ended(t, func(o *coordinator.Options) { o.ReadPatience = 50 * time.Millisecond })
	var requests sync.WaitGroup
	for range 2 {
		requests.Go(func() {
			if _, err := s.c.Image(t.Context(), id); err != nil {
				t.Error(err)
			}
		})
	}
	for deadline := time.Now().Add(patience); gate.waiting() < 2; time.Sleep(time.Millisecond) {
		if time.Now().After(deadline) {
			t.Fatalf("%d checkpoints are read at a time", gate.waiting())
		}
	}
	if _, err := s.c.Image(t.Context(), id); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("a third image: %v", err)
	}
	if _, err := s.c.Refine(t.Context(), id, job.StopRules{SamplesPerPixel: 60}); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("refined meanwhile: %v", err)
	}
	gate.pass <- struct{}{}
	gate.pass <- struct{}{}
	requests.Wait()
}
