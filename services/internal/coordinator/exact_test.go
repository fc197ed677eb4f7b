package coordinator_test

import (
	"context"
	"errors"
	"fmt"
	"math/rand/v2"
	"path/filepath"
	"slices"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// reference renders a request with one well-behaved worker.
func reference(t *testing.T, request job.Request) job.Snapshot {
	t.Helper()
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(1, nil)...)()
	return s.finished(s.submit(request))
}

func sameFilm(t *testing.T, got, want job.Snapshot) {
	t.Helper()
	if got.FilmSHA256 == "" || got.FilmSHA256 != want.FilmSHA256 || got.RoundsDone != want.RoundsDone {
		t.Errorf("film %s after %d rounds, want %s after %d", got.FilmSHA256, got.RoundsDone, want.FilmSHA256, want.RoundsDone)
	}
	if got.B != want.B || got.Mutations != want.Mutations {
		t.Errorf("b %v, %d mutations; want %v, %d", got.B, got.Mutations, want.B, want.Mutations)
	}
}

func TestSameFilmForAnyNumberOfWorkers(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(60), "path": pathRequest(30)} {
		t.Run(name, func(t *testing.T) {
			want := reference(t, request)
			if want.RoundsDone < 3 {
				t.Fatalf("only %d rounds: the test needs several", want.RoundsDone)
			}
			for _, n := range []int{2, 7} {
				s := newSite(t)
				s.start()
				dismiss := s.crew(workers(n, nil)...)
				sameFilm(t, s.finished(s.submit(request)), want)
				dismiss()
				s.stop()
			}
		})
	}
}

// moody returns a source of faults; each worker has its own.
func moody(seed uint64, faults ...fakeworker.Fault) func() fakeworker.Fault {
	random := rand.New(rand.NewPCG(seed, 1))
	vanished := false
	return func() fakeworker.Fault {
		if random.IntN(4) > 0 {
			return fakeworker.None
		}
		fault := faults[random.IntN(len(faults))]
		if fault == fakeworker.Vanish && vanished {
			return fakeworker.None // a task that takes three workers with it fails its job
		}
		vanished = vanished || fault == fakeworker.Vanish
		return fault
	}
}

func TestSameFilmWithEveryFault(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(60), "path": pathRequest(30)} {
		want := reference(t, request)
		for fault, label := range map[fakeworker.Fault]string{
			fakeworker.Vanish: "vanish", fakeworker.Repeat: "repeat", fakeworker.Stale: "stale", fakeworker.BitFlip: "bit flip",
			fakeworker.Truncated: "truncated", fakeworker.Forged: "forged", fakeworker.Abandoned: "abandoned",
		} {
			t.Run(name+" "+label, func(t *testing.T) {
				t.Parallel()
				s := newSite(t)
				s.start()
				defer s.stop()
				crew := workers(3, nil)
				// One honest worker keeps a task from failing on three workers.
				crew[1].Fault, crew[2].Fault = moody(1, fault), moody(2, fault)
				defer s.crew(crew...)()
				sameFilm(t, s.finished(s.submit(request)), want)
			})
		}
	}
}

func TestSameFilmWhenCoordinatorsDie(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(100), "path": pathRequest(40)} {
		want := reference(t, request)
		for seed := range uint64(4) {
			t.Run(fmt.Sprint(name, seed), func(t *testing.T) {
				t.Parallel()
				dieOften(t, request, want, seed)
			})
		}
	}
}

func dieOften(t *testing.T, request job.Request, want job.Snapshot, seed uint64) {
	s := newSite(t)
	s.start()
	random := rand.New(rand.NewPCG(seed, 2))
	crew := workers(3, func(w *fakeworker.Worker) { w.Delay = 10 * time.Millisecond })
	crew[2].Fault = moody(seed, fakeworker.Stale, fakeworker.Vanish, fakeworker.Repeat)
	dismiss := s.crew(crew...)
	id := s.submit(request)
	for deaths := 0; deaths < 8 && !s.job(id).State.Ended(); deaths++ {
		time.Sleep(time.Duration(random.IntN(150)) * time.Millisecond)
		s.kill()
		s.start()
	}
	sameFilm(t, s.finished(id), want)
	image, err := s.c.Image(context.Background(), id)
	if err != nil || !image.Final || image.FilmSHA256 != want.FilmSHA256 {
		t.Errorf("image %s final %v, error %v", image.FilmSHA256, image.Final, err)
	}
	dismiss()
	s.stop()
}

func TestAPointPerRoundAfterRestarts(t *testing.T) {
	s := newSite(t)
	s.start()
	dismiss := s.crew(workers(2, nil)...)
	id := s.submit(chainsRequest(60))
	s.await(id, "in its second round", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	s.stop()
	s.start()
	done := s.finished(id)
	dismiss()
	defer s.stop()
	points, err := s.c.Convergence(context.Background(), id)
	if err != nil || len(points) != done.RoundsDone {
		t.Fatalf("%d points after %d rounds, error %v", len(points), done.RoundsDone, err)
	}
	for i, p := range points {
		if p.Round != i || p.FilmSHA256 == "" || p.RelMSE <= 0 || i > 0 && p.Mutations <= points[i-1].Mutations {
			t.Errorf("point %d: %+v", i, p)
		}
	}
}

func TestFinishedImageCanBeRepeated(t *testing.T) {
	request := chainsRequest(0)
	request.Stop = job.StopRules{TimeSeconds: 3600}
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 3 * time.Millisecond })...)()
	id := s.submit(request)
	s.await(id, "in its third round", func(j job.Snapshot) bool { return j.RoundsDone >= 2 })
	if _, err := s.c.Finish(context.Background(), id); err != nil {
		t.Fatal(err)
	}
	first := s.finished(id)
	if first.StopReason != "finished" {
		t.Errorf("stopped because of %q", first.StopReason)
	}
	request.Stop = job.StopRules{Rounds: first.RoundsDone}
	sameFilm(t, s.finished(s.submit(request)), first)
	// From the resolved spec, whatever the request says beside it.
	again := job.Request{Resolved: first.Resolved, Stop: job.StopRules{Rounds: first.RoundsDone}}
	sameFilm(t, s.finished(s.submit(again)), first)
}

func TestResolvedPathJobSkipsThePilot(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(1, nil)...)()
	first := s.finished(s.submit(pathRequest(20)))
	again := s.finished(s.submit(job.Request{Resolved: first.Resolved}))
	sameFilm(t, again, first)
	if again.Rays >= first.Rays {
		t.Errorf("%d rays, the first job with its pilot took %d", again.Rays, first.Rays)
	}
}

func TestTimeLimitEndsOnARound(t *testing.T) {
	request := chainsRequest(0)
	request.Stop = job.StopRules{TimeSeconds: 0.4}
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 3 * time.Millisecond })...)()
	limited := s.finished(s.submit(request))
	if limited.StopReason != "time" || limited.RoundsDone == 0 {
		t.Errorf("stopped because of %q after %d rounds", limited.StopReason, limited.RoundsDone)
	}
	request.Stop = job.StopRules{Rounds: limited.RoundsDone}
	sameFilm(t, s.finished(s.submit(request)), limited)
}

func TestFinishDecisionSurvivesDeath(t *testing.T) {
	request := chainsRequest(0)
	request.Stop = job.StopRules{TimeSeconds: 3600}
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.CheckpointMin = time.Hour }
	s.start()
	dismiss := s.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 3 * time.Millisecond })...)
	id := s.submit(request)
	s.await(id, "in its third round", func(j job.Snapshot) bool { return j.RoundsDone >= 2 })
	at, err := s.c.Finish(context.Background(), id)
	s.check(err)
	s.kill()
	s.start()
	defer s.stop()
	defer dismiss()
	done := s.finished(id)
	if done.RoundsDone < at.RoundsDone || done.RoundsDone > at.RoundsDone+3 || done.StopReason != "finished" {
		t.Errorf("%d rounds, stopped because of %q; was finished at round %d", done.RoundsDone, done.StopReason, at.RoundsDone)
	}
}

func TestTargetErrorNeedsTwoRounds(t *testing.T) {
	request := chainsRequest(0)
	request.Stop = job.StopRules{TargetError: 1e6}
	done := reference(t, request)
	if done.StopReason != "target_error" || done.RoundsDone != 2 {
		t.Errorf("stopped because of %q after %d rounds", done.StopReason, done.RoundsDone)
	}
}

func TestPauseResumeCancel(t *testing.T) {
	ctx := context.Background()
	request := chainsRequest(0)
	request.Stop = job.StopRules{TimeSeconds: 3600}
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 3 * time.Millisecond })...)()
	id := s.submit(request)
	s.await(id, "rendering", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	if j, err := s.c.Pause(ctx, id); err != nil || !j.Paused {
		t.Fatalf("pause: %+v %v", j, err)
	}
	paused := s.job(id)
	before := s.await(id, "still", func(j job.Snapshot) bool { // what was leased comes in
		last := j.Mutations
		time.Sleep(300 * time.Millisecond)
		return s.job(id).Mutations == last
	})
	if before.WallSeconds != paused.WallSeconds {
		t.Errorf("the clock of a paused job went on from %v to %v", paused.WallSeconds, before.WallSeconds)
	}
	if err := s.c.Delete(ctx, id); !errors.Is(err, job.ErrConflict) {
		t.Errorf("a running job was deleted: %v", err)
	}
	if _, err := s.c.Resume(ctx, id); err != nil {
		t.Fatal(err)
	}
	s.await(id, "going on", func(j job.Snapshot) bool { return j.Mutations > before.Mutations })
	canceled, err := s.c.Cancel(ctx, id)
	if err != nil || canceled.State != job.Canceled {
		t.Fatalf("cancel: %+v %v", canceled, err)
	}
	if _, err := s.c.Cancel(ctx, id); !errors.Is(err, job.ErrConflict) {
		t.Errorf("canceled twice: %v", err)
	}
	if image, err := s.c.Image(ctx, id); err != nil || image.Rounds < 1 || image.Final {
		t.Errorf("image of a canceled job: %d rounds, final %v, error %v", image.Rounds, image.Final, err)
	}
	if err := s.c.Delete(ctx, id); err != nil {
		t.Error(err)
	}
	if _, err := s.c.Job(ctx, id); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("a deleted job is there: %v", err)
	}
}

func TestBlackScene(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(1, func(w *fakeworker.Worker) { w.Black = true })...)()
	id := s.submit(chainsRequest(20))
	done := s.finished(id)
	if done.StopReason != "black" || len(done.Warnings) == 0 || done.FilmSHA256 == "" {
		t.Errorf("%+v", done)
	}
	image, err := s.c.Image(context.Background(), id)
	if err != nil || len(image.RGB) != 70*41*3 || slices.Max(image.RGB) != 0 {
		t.Errorf("image of %d values, error %v", len(image.RGB), err)
	}
}

// heldDeletes is a backend in which deleting a checkpoint, once begun while it holds, ends only when
// nobody wants it any more.
type heldDeletes struct {
	blob.Backend
	holds   atomic.Bool
	waiting atomic.Int64
}

func (h *heldDeletes) Delete(ctx context.Context, key blob.Key) error {
	if key.Kind == blob.Named && h.holds.Load() {
		h.waiting.Add(1)
		defer h.waiting.Add(-1)
		<-ctx.Done()
		return ctx.Err()
	}
	return h.Backend.Delete(ctx, key)
}

// A job that has ended is given up as soon as nothing is written of it any more, at times before
// those go on who wait for that to delete the job.
func TestDeletedWhileItIsGivenUp(t *testing.T) {
	t.Parallel()
	ctx := t.Context()
	s := newSite(t)
	backend, err := dir.Open(filepath.Join(s.dir, "blobs"))
	s.check(err)
	held := &heldDeletes{Backend: backend}
	s.tune = func(o *coordinator.Options) { o.Blobs, o.Tick = blob.New(held), 20*time.Microsecond }
	s.start()
	defer s.stop()
	defer s.crew(workers(2, nil)...)()
	for range 20 {
		held.holds.Store(true)
		id := s.submit(longRequest())
		s.await(id, "held up", func(job.Snapshot) bool { return held.waiting.Load() > 0 })
		if _, err := s.c.Cancel(ctx, id); err != nil {
			t.Fatal(err)
		}
		held.holds.Store(false)
		if err := s.c.Delete(ctx, id); err != nil {
			t.Fatal(err)
		}
		if _, err := s.c.Job(ctx, id); !errors.Is(err, job.ErrNotFound) {
			t.Fatalf("a deleted job is there: %v", err)
		}
	}
}
