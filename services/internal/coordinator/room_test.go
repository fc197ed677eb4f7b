package coordinator_test

import (
	"context"
	"errors"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// filmBytes is what a job of pathRequest may take: three films of one layer of 70 x 41 pixels in two
// halves, 16 bytes for each value.
const filmBytes = 3 * 16 * (2*3*2*32*32*3 + 16*16*16*3)

// roomFor lets a coordinator have room for so many films at once.
func (s *site) roomFor(films float64) {
	tune := s.tune
	s.tune = func(o *coordinator.Options) {
		if tune != nil {
			tune(o)
		}
		o.FilmsMemory = int64(films * filmBytes)
	}
}

// endless jobs last until they are finished or canceled, and let others go first.
func endless() job.Request {
	request := pathRequest(1 << 19)
	request.Priority = -1
	return request
}

// hasFilm waits until a job has its film.
func (s *site) hasFilm(id string) {
	s.t.Helper()
	s.await(id, "rendered", func(j job.Snapshot) bool { return j.State == job.Rendering })
}

// awaitWaiting waits until a job waits for memory.
func (s *site) awaitWaiting(id string) job.Snapshot {
	s.t.Helper()
	return s.await(id, "waiting for memory", func(j job.Snapshot) bool { return strings.Contains(j.Activity, "waiting for memory") })
}

// cancelJob asks again while the answer is 503, as clients do: a lease of a second may be lost on a busy
// machine, and is taken up again.
func (s *site) cancelJob(id string) {
	s.t.Helper()
	_, err := s.c.Cancel(context.Background(), id)
	for deadline := time.Now().Add(patience); errors.Is(err, job.ErrUnavailable) && time.Now().Before(deadline); {
		time.Sleep(10 * time.Millisecond)
		_, err = s.c.Cancel(context.Background(), id)
	}
	s.check(err)
}

func TestAJobWhoseFilmDoesNotFitWaitsForOthers(t *testing.T) {
	t.Parallel()
	want := reference(t, pathRequest(30))
	s := newSite(t)
	s.roomFor(1.5)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, slowly)...)()
	first := s.submit(endless())
	s.hasFilm(first)
	second := s.submit(pathRequest(30))
	waiting := s.awaitWaiting(second)
	if waiting.State != job.Queued || !waiting.WaitingForMemory || waiting.QueuePosition != 0 {
		t.Errorf("a job that waits for memory is %+v", waiting)
	}
	if _, err := s.c.SceneReport(t.Context(), second); err != nil {
		t.Errorf("its scene was not looked at: %v", err)
	}
	gauges := gather(t, s.c.Collector())
	for name, want := range map[string]float64{
		"metrofarm_jobs_waiting_for_memory": 1, "metrofarm_oldest_queued_job_seconds": 0,
		"metrofarm_films_bytes": filmBytes, "metrofarm_films_budget_bytes": 1.5 * filmBytes,
	} {
		if got := gauges[name]; got != want {
			t.Errorf("%s is %g, want %g", name, got, want)
		}
	}
	s.cancelJob(first)
	sameFilm(t, s.finished(second), want)
}

func TestNobodyPassesAJobThatWaitsForMemory(t *testing.T) {
	t.Parallel()
	s := newSite(t)
	s.roomFor(5)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, slowly)...)()
	first := s.submit(endless())
	s.hasFilm(first)
	chains := s.submit(chainsRequest(30)) // a film of more layers
	s.awaitWaiting(chains)
	small := s.submit(pathRequest(30)) // would fit
	s.awaitWaiting(small)
	urgent := pathRequest(30)
	urgent.Priority = 1
	s.finished(s.submit(urgent))
	if j := s.job(small); j.State != job.Queued {
		t.Errorf("a small job has passed one that waits: it is %s", j.State)
	}
	if _, err := s.c.Pause(t.Context(), chains); err != nil {
		t.Fatal(err)
	}
	s.finished(small) // who is paused stands aside
	if _, err := s.c.Resume(t.Context(), chains); err != nil {
		t.Fatal(err)
	}
	s.awaitWaiting(chains)
	s.cancelJob(first)
	s.finished(chains)
}

func TestAFilmLargerThanAllRoomIsRefused(t *testing.T) {
	t.Parallel()
	s := newSite(t)
	s.roomFor(0.5)
	s.start()
	defer s.stop()
	defer s.crew(workers(1, nil)...)()
	request := pathRequest(1)
	request.Scene, request.Entry = s.bundle(), "scene.xml"
	request.Width, request.Height = 70, 41
	var field *job.FieldError
	if _, err := s.c.Submit(t.Context(), request, ""); !errors.As(err, &field) || field.Field != "width" ||
		!strings.Contains(field.Detail, "this server allows 1 MiB") {
		t.Errorf("refused with %v", err)
	}
	request.Width, request.Height = 0, 0 // what the scene asks for is known later
	accepted, err := s.c.Submit(t.Context(), request, "")
	s.check(err)
	failed := s.await(accepted.ID, "ended", func(j job.Snapshot) bool { return j.State.Ended() })
	if failed.State != job.Failed || !strings.Contains(failed.Error, "width: the film and the chains would take 2 MiB in the coordinator") {
		t.Errorf("%s %q", failed.State, failed.Error)
	}
}

func TestARefinementThatDoesNotFitIsPutOff(t *testing.T) {
	t.Parallel()
	s := newSite(t)
	s.roomFor(1.5)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, slowly)...)()
	ended := s.finished(s.submit(pathRequest(30)))
	busy := s.submit(endless())
	s.hasFilm(busy)
	more := job.StopRules{SamplesPerPixel: 60}
	if _, err := s.c.Refine(t.Context(), ended.ID, more); !errors.Is(err, job.ErrUnavailable) || !strings.Contains(err.Error(), "memory") {
		t.Errorf("refined beyond the budget: %v", err)
	}
	s.cancelJob(busy)
	s.await(busy, "out of memory", func(job.Snapshot) bool { return gather(t, s.c.Collector())["metrofarm_films_bytes"] == 0 })
	if _, err := s.c.Refine(t.Context(), ended.ID, more); err != nil {
		t.Fatal(err)
	}
	s.finished(ended.ID)
}

// orphan is a job that has a film and no owner, and the coordinator that is left.
func orphan(t *testing.T, room float64, busy bool) (left *site, id, own string, p *pair) {
	t.Helper()
	p = newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.start()
	dismiss := first.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 20 * time.Millisecond })...)
	request := endless()
	request.Priority = 0
	id = first.submit(request)
	p.checkpointed(id)
	second.roomFor(room)
	second.start()
	t.Cleanup(second.stop)
	second.crew(workers(2, slowly)...)
	if busy {
		own = second.submit(endless())
		second.hasFilm(own)
	}
	dismiss()
	first.stop()
	return second, id, own, p
}

// takenOver waits until a job is the second coordinator's and its checkpoint has been read there.
func (p *pair) takenOver(by *site, id string) {
	p.t.Helper()
	p.eventually("taken over", func() bool {
		_, err := by.c.Job(p.t.Context(), id)
		return p.record(id).Owner.ID == "second" && err == nil
	})
}

func TestAJobIsTakenOverWhenThereIsRoomForIt(t *testing.T) {
	t.Parallel()
	left, id, own, p := orphan(t, 1.5, true)
	left.awaitWaiting(id)
	if j := p.record(id); j.Owner.ID != "" {
		t.Errorf("a job that does not fit was taken by %+v", j.Owner)
	}
	younger := left.submit(pathRequest(30))
	left.awaitWaiting(younger)
	left.cancelJob(own)
	p.takenOver(left, id)
	left.hasFilm(id)
	left.awaitWaiting(younger) // came later
	left.cancelJob(id)
	left.finished(younger)
}

func TestAJobThatFitsNowhereIsTakenOverByWhoHasNoOther(t *testing.T) {
	t.Parallel()
	left, id, _, p := orphan(t, 0.5, false)
	p.takenOver(left, id)
	left.hasFilm(id)
	left.cancelJob(id)
}

func TestAJobThatNobodyHasRoomForCanBeCanceled(t *testing.T) {
	t.Parallel()
	left, id, own, p := orphan(t, 1.5, true)
	left.awaitWaiting(id)
	left.cancelJob(id)
	p.eventually("canceled", func() bool { return p.record(id).State == job.Canceled })
	if image, err := left.c.Image(t.Context(), id); err != nil || image.Rounds == 0 {
		t.Errorf("its image has %d rounds, error %v", image.Rounds, err)
	}
	left.cancelJob(own)
}
