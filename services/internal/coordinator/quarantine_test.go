package coordinator_test

import (
	"fmt"
	"testing"
	"time"

	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
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
