package coordinator_test

import (
	"context"
	"fmt"
	"math/rand/v2"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// checking makes a site check one segment in oneIn, with leases that outlive a busy machine.
func checking(t *testing.T, oneIn int, tune func(*coordinator.Options)) *site {
	t.Helper()
	s := newSite(t)
	s.tune = func(o *coordinator.Options) {
		o.CheckOneIn, o.LeaseTTL = oneIn, 20*testTTL
		if tune != nil {
			tune(o)
		}
	}
	s.start()
	return s
}

func (s *site) workers() map[string]job.Worker {
	s.t.Helper()
	list, err := s.c.Workers(context.Background())
	s.check(err)
	named := make(map[string]job.Worker)
	for _, w := range list {
		named[w.Name] = w
	}
	return named
}

// awaitWorkers waits until so many are registered: before, nothing can be checked.
func (s *site) awaitWorkers(n int) {
	s.t.Helper()
	for deadline := time.Now().Add(patience); len(s.workers()) < n; time.Sleep(time.Millisecond) {
		if time.Now().After(deadline) {
			s.t.Fatalf("%d workers, not %d", len(s.workers()), n)
		}
	}
}

// countEvents tells how many events of the job contain the text.
func (s *site) countEvents(id, text string) int {
	s.t.Helper()
	events, _, err := s.c.Events(s.t.Context(), id, 0)
	s.check(err)
	n := 0
	for _, e := range events {
		if strings.Contains(e.Message, text) {
			n++
		}
	}
	return n
}

func TestSameFilmWhateverIsChecked(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(20), "path": pathRequest(4)} {
		want := reference(t, request)
		for _, oneIn := range []int{-1, 1000, 1} {
			for n := 1; n <= 3; n++ {
				t.Run(fmt.Sprintf("%s 1 in %d, %d workers", name, oneIn, n), func(t *testing.T) {
					t.Parallel()
					s := checking(t, oneIn, nil)
					defer s.stop()
					defer s.crew(workers(n, nil)...)()
					s.awaitWorkers(n)
					id := s.submit(request)
					sameFilm(t, s.finished(id), want)
					if faults := s.countEvents(id, "unchecked") + s.countEvents(id, "conflict"); faults > 0 {
						t.Errorf("%d faults", faults)
					}
				})
			}
		}
	}
}

func TestALiarAmongThreeIsExcluded(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(30), "path": pathRequest(4)} {
		want := reference(t, request)
		t.Run(name, func(t *testing.T) {
			s := checking(t, 1, nil)
			defer s.stop()
			crew := workers(3, nil)
			crew[1].Lie = 12345
			defer s.crew(crew...)()
			s.awaitWorkers(3)
			id := s.submit(request)
			sameFilm(t, s.finished(id), want)
			for name, w := range s.workers() {
				liar := name == "b"
				if liar != strings.Contains(w.Exclusion, id) || liar != (w.Conflicts > 0) {
					t.Errorf("worker %s: %d conflicts, excluded %q", name, w.Conflicts, w.Exclusion)
				}
			}
			if n := s.countEvents(id, "is excluded"); n != 1 {
				t.Errorf("%d exclusions in the job's events", n)
			}
		})
	}
}

func TestALiarAmongTwoPausesTheJob(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	s := checking(t, 1, func(o *coordinator.Options) { o.CheckPatience = 5 * time.Second })
	defer s.stop()
	crew := workers(3, nil)
	crew[0].Lie = 12345
	defer s.crew(crew[:2]...)()
	s.awaitWorkers(2)
	id := s.submit(request)
	paused := s.await(id, "paused", func(j job.Snapshot) bool { return j.Paused })
	for _, part := range []string{"worker a (w-", "worker b (w-", "digest", "add a worker"} {
		if !strings.Contains(paused.PauseReason, part) {
			t.Errorf("paused because %q, which does not name %q", paused.PauseReason, part)
		}
	}
	if paused.Mutations != 0 {
		t.Errorf("%d mutations were counted", paused.Mutations)
	}
	if seen := s.workers(); seen["a"].Conflicts == 0 || seen["b"].Conflicts == 0 {
		t.Errorf("not flagged: %+v", seen)
	}
	defer s.crew(crew[2])()
	s.awaitWorkers(3)
	resumed, err := s.c.Resume(context.Background(), id)
	if err != nil || resumed.PauseReason != "" {
		t.Errorf("resumed: %q, %v", resumed.PauseReason, err)
	}
	sameFilm(t, s.finished(id), want)
	if seen := s.workers(); seen["a"].Exclusion == "" || seen["b"].Exclusion != "" || seen["c"].Exclusion != "" {
		t.Errorf("excluded: %+v", seen)
	}
}

func TestThreeThatDisagreePauseTheJob(t *testing.T) {
	s := checking(t, 1, nil)
	defer s.stop()
	crew := workers(3, nil)
	crew[0].Lie, crew[1].Lie = 12345, 54321
	defer s.crew(crew...)()
	s.awaitWorkers(3)
	id := s.submit(chainsRequest(30))
	paused := s.await(id, "paused", func(j job.Snapshot) bool { return j.Paused })
	if n := strings.Count(paused.PauseReason, "has digest"); n != 3 || !strings.Contains(paused.PauseReason, "no two agree") {
		t.Errorf("paused because %q", paused.PauseReason)
	}
	if _, err := s.c.Cancel(context.Background(), id); err != nil {
		t.Error(err)
	}
}

func TestHeldBatchIsMergedWhenTheSecondWorkerVanishes(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	s := checking(t, 1, func(o *coordinator.Options) { o.LeaseTTL = testTTL })
	defer s.stop()
	vanish := s.bystander()
	defer s.crew(workers(1, nil)...)()
	id := s.submit(request)
	s.awaitHeld(id)
	vanish()
	sameFilm(t, s.finished(id), want)
	if s.countEvents(id, "unchecked") == 0 {
		t.Error("no event says that segments stay unchecked")
	}
}

func TestHeldBatchIsMergedWhenTheSecondWorkerNeverComes(t *testing.T) {
	s := checking(t, 3, func(o *coordinator.Options) { o.CheckPatience = 50 * time.Millisecond })
	defer s.stop()
	defer s.bystander()()
	defer s.crew(workers(1, nil)...)()
	s.finished(s.submit(pathRequest(4)))
}

func TestHeldBatchIsRenderedAgainAfterDeath(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	s := checking(t, 1, nil)
	defer func() { s.stop() }()
	vanish := s.bystander()
	crew := workers(2, nil)
	defer s.crew(crew[0])()
	id := s.submit(request)
	s.awaitHeld(id)
	s.kill()
	vanish()
	s.start()
	defer s.crew(crew[1])()
	sameFilm(t, s.finished(id), want)
}

func TestSameFilmWithEveryFaultAndDeathWhileAllIsChecked(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(40), "path": pathRequest(8)} {
		want := reference(t, request)
		for seed := range uint64(2) {
			t.Run(fmt.Sprint(name, seed), func(t *testing.T) {
				t.Parallel()
				s := newSite(t)
				s.tune = func(o *coordinator.Options) { o.CheckOneIn = 1 + int(seed) }
				s.start()
				dieAndFail(t, s, request, want, seed)
			})
		}
	}
}

func dieAndFail(t *testing.T, s *site, request job.Request, want job.Snapshot, seed uint64) {
	random := rand.New(rand.NewPCG(seed, 3))
	crew := workers(3, nil)
	crew[1].Fault = moody(seed, fakeworker.Stale, fakeworker.Repeat, fakeworker.BitFlip, fakeworker.Truncated)
	crew[2].Fault = moody(seed+9, fakeworker.Vanish, fakeworker.Forged, fakeworker.Abandoned)
	dismiss := s.crew(crew...)
	id := s.submit(request)
	for range 4 {
		time.Sleep(time.Duration(random.IntN(300)) * time.Millisecond)
		s.kill()
		s.start()
	}
	sameFilm(t, s.finished(id), want)
	dismiss()
	s.stop()
}

func TestHeldBatchesDoNotStopTheUser(t *testing.T) {
	ctx := context.Background()
	s := checking(t, 1, nil)
	defer s.stop()
	vanish := s.bystander()
	defer vanish()
	defer s.crew(workers(1, nil)...)()
	canceled, finished := s.submit(chainsRequest(30)), s.submit(pathRequest(15))
	s.awaitHeld(canceled)
	if _, err := s.c.Pause(ctx, canceled); err != nil {
		t.Fatal(err)
	}
	if _, err := s.c.Resume(ctx, canceled); err != nil {
		t.Fatal(err)
	}
	if _, err := s.c.Cancel(ctx, canceled); err != nil {
		t.Fatal(err)
	}
	s.awaitHeld(finished)
	if _, err := s.c.Finish(ctx, finished); err != nil {
		t.Fatal(err)
	}
	drained := s.workers()["bystander"]
	if _, err := s.c.Drain(ctx, drained.ID); err != nil {
		t.Fatal(err)
	}
	if done := s.finished(finished); done.StopReason != "finished" || done.RoundsDone != 1 {
		t.Errorf("stopped because of %q after %d rounds", done.StopReason, done.RoundsDone)
	}
}
