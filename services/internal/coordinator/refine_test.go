package coordinator_test

import (
	"errors"
	"fmt"
	"io"
	"math/rand/v2"
	"path/filepath"
	"slices"
	"strings"
	"testing"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store/bolt"
	"metrofarm/services/internal/sweep"
)

func (s *site) refine(id string, stop job.StopRules) job.Snapshot {
	s.t.Helper()
	snapshot, err := s.c.Refine(s.t.Context(), id, stop)
	s.check(err)
	return snapshot
}

// settled waits until a job has ended and is nobody's.
func (s *site) settled(id string) job.Snapshot {
	s.t.Helper()
	snapshot := s.finished(id)
	for deadline := time.Now().Add(patience); len(s.c.Own()) > 0; time.Sleep(2 * time.Millisecond) {
		if time.Now().After(deadline) {
			s.t.Fatal("the job is not released")
		}
	}
	return snapshot
}

// refinements lists jobs with what they are refined to, one after the other.
func refinements() map[string][]job.Request {
	steps := func(request job.Request, stops ...job.StopRules) []job.Request {
		var all []job.Request
		for _, stop := range stops {
			request.Stop = stop
			all = append(all, request)
		}
		return all
	}
	direct, multiplexed, scene := chainsRequest(0), chainsRequest(0), pathRequest(0)
	direct.DirectApart = job.On
	multiplexed.Integrator = "mmlt"
	return map[string][]job.Request{
		"chains, by count": steps(chainsRequest(0), job.StopRules{MutationsPerPixel: 20}, job.StopRules{MutationsPerPixel: 25},
			job.StopRules{MutationsPerPixel: 60}),
		"chains, by rounds":    steps(chainsRequest(0), job.StopRules{MutationsPerPixel: 20}, job.StopRules{Rounds: 4}, job.StopRules{Rounds: 6}),
		"chains, direct apart": steps(direct, job.StopRules{MutationsPerPixel: 13}, job.StopRules{MutationsPerPixel: 50}),
		"multiplexed chains":   steps(multiplexed, job.StopRules{MutationsPerPixel: 20}, job.StopRules{MutationsPerPixel: 50}),
		"samples, by count": steps(pathRequest(0), job.StopRules{SamplesPerPixel: 3}, job.StopRules{SamplesPerPixel: 5},
			job.StopRules{SamplesPerPixel: 30}),
		// What is left of a round is cut short, again and again.
		"samples, in one round": steps(pathRequest(0), job.StopRules{SamplesPerPixel: 20}, job.StopRules{SamplesPerPixel: 25},
			job.StopRules{SamplesPerPixel: 30}, job.StopRules{SamplesPerPixel: 40}),
		// Half of a round, so that what is left of it has the size of what is done.
		"samples, half a round":  steps(pathRequest(0), job.StopRules{SamplesPerPixel: 2}, job.StopRules{SamplesPerPixel: 16}),
		"samples of the scene":   steps(scene, job.StopRules{}, job.StopRules{SamplesPerPixel: 30}),
		"samples, whole rounds":  steps(pathRequest(0), job.StopRules{Rounds: 2}, job.StopRules{SamplesPerPixel: 30}),
		"samples, then by error": steps(pathRequest(0), job.StopRules{SamplesPerPixel: 10}, job.StopRules{TargetError: 0.2}),
	}
}

func TestARefinedJobHasTheFilmOfOneThatAskedForItAtOnce(t *testing.T) {
	for name, steps := range refinements() {
		t.Run(name, func(t *testing.T) {
			t.Parallel()
			s := newSite(t)
			s.start()
			defer s.stop()
			defer s.crew(workers(2, nil)...)()
			id := s.submit(steps[0])
			for i, step := range steps {
				if i > 0 {
					if now := s.refine(id, step.Stop); now.ID != id || now.State != job.Rendering || now.EndedAt != nil || now.StopReason != "" {
						t.Fatalf("refined: %+v", now)
					}
				}
				got, want := s.settled(id), reference(t, step)
				sameFilm(t, got, want)
				if got.StopReason != want.StopReason || got.Resolved != want.Resolved || got.Progress != 1 || got.Refinements != uint64(i) {
					t.Errorf("stopped by %s after %d refinements, want %s; resolved\n%s\nwant\n%s",
						got.StopReason, got.Refinements, want.StopReason, got.Resolved, want.Resolved)
				}
				s.sameCourse(id, want)
			}
		})
	}
}

// sameCourse compares image and convergence with the result of another job.
func (s *site) sameCourse(id string, want job.Snapshot) {
	s.t.Helper()
	image, err := s.c.Image(s.t.Context(), id)
	s.check(err)
	if image.FilmSHA256 != want.FilmSHA256 || image.Rounds != want.RoundsDone || image.Mutations != want.Mutations || !image.Final {
		s.t.Errorf("image of film %s, %d rounds, %d mutations, final %v", image.FilmSHA256, image.Rounds, image.Mutations, image.Final)
	}
	points, err := s.c.Convergence(s.t.Context(), id)
	s.check(err)
	for i, p := range points {
		if p.Round != i {
			s.t.Errorf("point %d is of round %d", i, p.Round)
		}
	}
	if len(points) != want.RoundsDone || points[len(points)-1].FilmSHA256 != want.FilmSHA256 {
		s.t.Errorf("%d points, want %d", len(points), want.RoundsDone)
	}
}

func TestWhatARefinedJobShowsMeanwhile(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	dismiss := s.crew(workers(1, nil)...)
	id := s.submit(pathRequest(7)) // rounds of 4 and 3 samples, the second of which goes on to 6
	before := s.settled(id)
	dismiss()
	now := s.refine(id, job.StopRules{SamplesPerPixel: 100})
	if now.RoundsDone != before.RoundsDone || now.FilmSHA256 != before.FilmSHA256 || now.Mutations != before.Mutations ||
		now.B != before.B || now.Progress <= 0 || now.Progress >= 0.1 || now.WallSeconds < before.WallSeconds {
		t.Errorf("before %+v\nnow %+v", before, now)
	}
	image, err := s.c.Image(t.Context(), id)
	s.check(err)
	if image.FilmSHA256 != before.FilmSHA256 || image.Rounds != before.RoundsDone || image.Final {
		t.Errorf("image of film %s, %d rounds, final %v", image.FilmSHA256, image.Rounds, image.Final)
	}
	if again := s.refine(id, job.StopRules{SamplesPerPixel: 100}); again.Refinements != 1 {
		t.Errorf("the same refinement twice counts %d", again.Refinements)
	}
	if _, err := s.c.Refine(t.Context(), id, job.StopRules{SamplesPerPixel: 101}); !errors.Is(err, job.ErrConflict) {
		t.Errorf("refined while it is rendered: %v", err)
	}
	defer s.crew(workers(1, nil)...)()
	sameFilm(t, s.settled(id), reference(t, pathRequest(100)))
	if again := s.refine(id, job.StopRules{SamplesPerPixel: 100}); again.State != job.Done || again.Refinements != 1 {
		t.Errorf("the same refinement afterwards: %+v", again)
	}
}

// TestACanceledJobGoesOn cancels in the middle of rounds that have other sizes afterwards.
func TestACanceledJobGoesOn(t *testing.T) {
	for name, stops := range map[string][2]job.StopRules{
		"to the same":  {{MutationsPerPixel: 60}, {MutationsPerPixel: 60}},
		"to the error": {{MutationsPerPixel: 45}, {Rounds: 7}},
	} {
		t.Run(name, func(t *testing.T) {
			t.Parallel()
			s := newSite(t)
			s.start()
			defer s.stop()
			defer s.crew(workers(2, slowly)...)()
			request := chainsRequest(0)
			request.Stop = stops[0]
			id := s.submit(request)
			for i := range 4 {
				s.await(id, "a round further", func(j job.Snapshot) bool { return j.RoundsDone > i && j.RoundSegmentsDone > 3 || j.State.Ended() })
				if _, err := s.c.Cancel(t.Context(), id); errors.Is(err, job.ErrConflict) {
					break // it is done
				}
				if now := s.refine(id, stops[1]); now.State != job.Rendering {
					t.Fatalf("refined: %+v", now)
				}
			}
			request.Stop = stops[1]
			sameFilm(t, s.settled(id), reference(t, request))
		})
	}
}

func TestARefinementMustAskForMore(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	dismiss := s.crew(workers(2, nil)...)
	defer dismiss()
	id := s.submit(chainsRequest(30))
	done := s.settled(id)
	points, err := s.c.Convergence(t.Context(), id)
	s.check(err)
	reached := max(points[1].RelMSE, points[2].RelMSE) * 1.001
	for field, stop := range map[string]job.StopRules{
		"stop":                     {},
		"stop.mutations_per_pixel": {MutationsPerPixel: 30, TargetError: 1e-9},
		"stop.samples_per_pixel":   {SamplesPerPixel: 100},
		"stop.rounds":              {Rounds: 2},
		"stop.target_error":        {TargetError: reached, Rounds: 60},
		"stop.time_seconds":        {TimeSeconds: done.WallSeconds / 2},
	} {
		_, err := s.c.Refine(t.Context(), id, stop)
		var wrong *job.FieldError
		if !errors.As(err, &wrong) || wrong.Field != field {
			t.Errorf("%s: %v", field, err)
		}
	}
	if now := s.job(id); now.State != job.Done || now.Refinements != 0 {
		t.Errorf("after refusals: %+v", now)
	}
	repeated := job.Request{Resolved: done.Resolved}
	again := s.submit(repeated)
	sameFilm(t, s.settled(again), done)
	if _, err := s.c.Refine(t.Context(), again, job.StopRules{Rounds: 60}); err == nil || !strings.Contains(err.Error(), "resolved") {
		t.Errorf("a repeated job: %v", err)
	}
	if _, err := s.c.Refine(t.Context(), "job-x", job.StopRules{Rounds: 60}); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("no job: %v", err)
	}
	dismiss()
	waiting := s.submit(chainsRequest(30))
	_, err = s.c.Cancel(t.Context(), waiting)
	s.check(err)
	if _, err := s.c.Refine(t.Context(), waiting, job.StopRules{Rounds: 60}); !errors.Is(err, job.ErrConflict) {
		t.Errorf("without a checkpoint: %v", err)
	}
}

// TestLateBatchesOfBeforeARefinement delivers again, once it is refined, what a job was rendered from:
// the first half of a round must not be taken for its second half.
func TestLateBatchesOfBeforeARefinement(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	type batch struct {
		header *farmv1.BatchHeader
		tiles  []*farmv1.Tile
	}
	var late []batch
	crew := workers(1, func(w *fakeworker.Worker) {
		w.Rendered = func(header *farmv1.BatchHeader, tiles []*farmv1.Tile) { late = append(late, batch{header, tiles}) }
	})
	dismiss := s.crew(crew...)
	id := s.submit(pathRequest(2))
	s.settled(id)
	sent := late
	s.refine(id, job.StopRules{SamplesPerPixel: 20})
	_, err := s.c.Pause(t.Context(), id)
	s.check(err)
	outcomes := map[farmv1.Outcome]int{}
	for _, b := range sent {
		answer, err := crew[0].Send(t.Context(), b.header, b.tiles)
		s.check(err)
		outcomes[answer.GetOutcome()]++
	}
	_, err = s.c.Resume(t.Context(), id)
	s.check(err)
	if outcomes[farmv1.Outcome_OUTCOME_SUPERSEDED] == 0 || len(outcomes) != 1 {
		t.Errorf("outcomes %v", outcomes)
	}
	sameFilm(t, s.settled(id), reference(t, pathRequest(20)))
	dismiss()
}

func TestRefinementsSurviveTheirCoordinators(t *testing.T) {
	for name, steps := range map[string][]job.Request{
		"chains":  {chainsRequest(20), chainsRequest(120)},
		"samples": {pathRequest(10), pathRequest(60)},
	} {
		want := reference(t, steps[1])
		for seed := range uint64(2) {
			t.Run(fmt.Sprint(name, seed), func(t *testing.T) {
				t.Parallel()
				s := newSite(t)
				s.start()
				random := rand.New(rand.NewPCG(seed, 3))
				dismiss := s.crew(workers(3, slowly)...)
				id := s.submit(steps[0])
				s.settled(id)
				s.refine(id, steps[1].Stop)
				for deaths := 0; deaths < 6 && !s.job(id).State.Ended(); deaths++ {
					s.kill() // at once the first time: the record alone knows
					s.start()
					time.Sleep(time.Duration(random.IntN(150)) * time.Millisecond)
				}
				sameFilm(t, s.settled(id), want)
				if got := s.job(id); got.Refinements != 1 {
					t.Errorf("%d refinements", got.Refinements)
				}
				dismiss()
				s.stop()
			})
		}
	}
}

func TestAnotherCoordinatorRefinesAndTakesOver(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.start()
	dismiss := first.crew(workers(2, nil)...)
	id := first.submit(chainsRequest(20))
	first.settled(id)
	dismiss()
	second.start()
	defer second.stop()
	second.refine(id, job.StopRules{MutationsPerPixel: 60})
	if owner, err := first.c.Owner(t.Context(), id); err != nil || owner.ID != "second" {
		t.Errorf("owner %+v, error %v", owner, err)
	}
	if err := first.c.Delete(t.Context(), id); !errors.Is(err, job.ErrConflict) {
		t.Errorf("deleted while it is refined: %v", err)
	}
	p.lines[1].frozen.Store(true) // it stands still from now on
	p.eventually("taken over", func() bool { return len(first.c.Own()) == 1 })
	p.lines[1].frozen.Store(false)
	defer first.crew(workers(2, nil)...)()
	sameFilm(t, first.settled(id), reference(t, chainsRequest(60)))
	first.stop()
	p.sweep()
	if got, want := p.blobs(), []string{p.record(id).Checkpoint}; !slices.Equal(got, want) {
		t.Errorf("blobs %v, want %v", got, want)
	}
}

// TestASweepSparesAJobThatWentOn: it was listed as one that ended long ago, and has been refined and ended
// again when its turn comes.
func TestASweepSparesAJobThatWentOn(t *testing.T) {
	t.Parallel()
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(1, nil)...)()
	id := s.submit(pathRequest(10))
	s.settled(id)
	jobs := sweep.StoredJobs{Store: s.db, Coordinator: s.c}
	listed, err := jobs.Jobs(t.Context())
	s.check(err)
	s.refine(id, job.StopRules{SamplesPerPixel: 20})
	if err := jobs.Delete(t.Context(), listed[0]); !errors.Is(err, job.ErrConflict) {
		t.Errorf("deleted while it is refined: %v", err)
	}
	film := s.settled(id).FilmSHA256
	if err := jobs.Delete(t.Context(), listed[0]); !errors.Is(err, job.ErrConflict) {
		t.Errorf("deleted after it was refined: %v", err)
	}
	if got := s.job(id).FilmSHA256; got != film {
		t.Errorf("film %q, want %q", got, film)
	}
	listed, err = jobs.Jobs(t.Context())
	s.check(err)
	s.check(jobs.Delete(t.Context(), listed[0]))
	if _, err := s.c.Job(t.Context(), id); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("after the sweep: %v", err)
	}
}

func TestARefinedJobWithoutItsCheckpointBeginsAgain(t *testing.T) {
	s := newSite(t)
	s.start()
	dismiss := s.crew(workers(1, nil)...)
	id := s.submit(pathRequest(10))
	s.settled(id)
	dismiss()
	s.refine(id, job.StopRules{SamplesPerPixel: 40})
	s.stop() // which writes the last checkpoint
	db, err := bolt.Open(filepath.Join(s.dir, "metrofarm.db"), nil)
	s.check(err)
	j, err := db.Job(t.Context(), id)
	s.check(errors.Join(err, db.Close()))
	s.check(s.blobs.WriteBlob(t.Context(), j.Checkpoint, func(w io.Writer) error { _, err := w.Write([]byte("?")); return err }))
	s.start()
	defer s.stop()
	defer s.crew(workers(1, nil)...)()
	sameFilm(t, s.settled(id), reference(t, pathRequest(40)))
}
