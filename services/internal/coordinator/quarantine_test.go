package coordinator_test

import (
	"fmt"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// A worker that damages whatever it delivers gets into quarantine at once; another one does its work.
func TestADamagedBatchPutsItsWorkerInQuarantine(t *testing.T) {
	request := chainsRequest(60)
	want := reference(t, request)
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.Quarantine = time.Hour }
	s.start()
	defer s.stop()
	crew := workers(2, nil)
	crew[1].Fault = func() fakeworker.Fault { return fakeworker.BitFlip }
	id := s.submit(request)
	defer s.crew(crew[1])()
	for deadline := time.Now().Add(patience); s.workers()["b"].State != "quarantined"; time.Sleep(time.Millisecond) {
		if time.Now().After(deadline) {
			t.Fatalf("worker b is %q", s.workers()["b"].State)
		}
	}
	defer s.crew(crew[0])()
	sameFilm(t, s.finished(id), want)
	if b := s.workers()["b"]; b.Conflicts != 1 || b.Exclusion != "" || b.LeasedSegments != 0 {
		t.Errorf("after quarantine: %+v", b)
	}
	if a := s.workers()["a"]; a.Conflicts != 0 || a.State == "quarantined" {
		t.Errorf("the other: %+v", a)
	}
}

// Flips now and then delay a worker, and no more: alone it gets everything done.
func TestQuarantineEnds(t *testing.T) {
	request := chainsRequest(60)
	want := reference(t, request)
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.Quarantine = 20 * time.Millisecond }
	s.start()
	defer s.stop()
	crew := workers(1, nil)
	flips := 0
	crew[0].Fault = func() fakeworker.Fault {
		if flips++; flips > 2 {
			return fakeworker.None
		}
		return fakeworker.BitFlip
	}
	defer s.crew(crew...)()
	start := time.Now()
	sameFilm(t, s.finished(s.submit(request)), want)
	if took := time.Since(start); took < (20+40)*time.Millisecond {
		t.Errorf("two flips in a row took %v only", took)
	}
	if a := s.workers()["a"]; a.Conflicts != 2 {
		t.Errorf("%d conflicts", a.Conflicts)
	}
}

// Damage on the way is no fault of the tasks: however often it happens, their job does not fail.
func TestDamageNeverSpeaksAgainstTasks(t *testing.T) {
	request := chainsRequest(20)
	want := reference(t, request)
	for fault, label := range map[fakeworker.Fault]string{fakeworker.BitFlip: "bit flip", fakeworker.Truncated: "truncated"} {
		for n := 1; n <= 3; n += 2 {
			t.Run(fmt.Sprintf("%s, %d workers", label, n), func(t *testing.T) {
				t.Parallel()
				s := newSite(t)
				s.start()
				defer s.stop()
				const each = 5
				defer s.crew(workers(n, func(w *fakeworker.Worker) {
					damaged := 0
					w.MaxSegments = 1000
					w.Fault = func() fakeworker.Fault {
						if damaged++; damaged > each {
							return fakeworker.None
						}
						return fault
					}
				})...)()
				s.awaitWorkers(n)
				id := s.submit(request)
				sameFilm(t, s.finished(id), want)
				if got := s.countEvents(id, "delivered a damaged batch"); got < each {
					t.Errorf("%d damaged batches in the job's events", got)
				}
				if got := s.countEvents(id, "failed on worker"); got > 0 {
					t.Errorf("%d tasks were blamed", got)
				}
				for name, w := range s.workers() {
					if n == 1 && w.Conflicts != each {
						t.Errorf("worker %s: %d conflicts", name, w.Conflicts)
					}
				}
			})
		}
	}
}

// inQuarantine starts a site with a job and a worker b that is in quarantine for good.
func inQuarantine(t *testing.T, request job.Request) (s *site, id string) {
	t.Helper()
	s = checking(t, 1, func(o *coordinator.Options) { o.Quarantine, o.CheckPatience = time.Hour, time.Hour })
	t.Cleanup(s.stop)
	crew := workers(2, func(w *fakeworker.Worker) { w.Fault = func() fakeworker.Fault { return fakeworker.BitFlip } })
	id = s.submit(request)
	s.crew(crew[1])
	for deadline := time.Now().Add(patience); s.workers()["b"].State != "quarantined"; time.Sleep(time.Millisecond) {
		if time.Now().After(deadline) {
			t.Fatalf("worker b is %q", s.workers()["b"].State)
		}
	}
	return s, id
}

// Nobody waits for a worker in quarantine: neither to check what another one rendered, nor with tasks for
// the threads that it has.
func TestAWorkerInQuarantineIsNotCountedOn(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	s, id := inQuarantine(t, request)
	s.crew(workers(1, nil)...)
	sameFilm(t, s.finished(id), want)
	got := gather(t, s.c.Collector())
	if got["metrofarm_render_threads"] != 1 || got["metrofarm_workers{state=quarantined}"] != 1 {
		t.Errorf("%g threads, %g workers in quarantine; want 1 of each",
			got["metrofarm_render_threads"], got["metrofarm_workers{state=quarantined}"])
	}
}

// A task that fails on the only worker which could have it does not wait for the one in quarantine.
func TestTasksDoNotWaitForAWorkerInQuarantine(t *testing.T) {
	s, id := inQuarantine(t, chainsRequest(30))
	s.crew(workers(1, func(w *fakeworker.Worker) { w.Fault = failing })...)
	failed := s.await(id, "failed", func(j job.Snapshot) bool { return j.State.Ended() })
	if failed.State != job.Failed || !strings.Contains(failed.Error, "it failed 3 time(s), on a (w-") {
		t.Errorf("%s: %q", failed.State, failed.Error)
	}
}
