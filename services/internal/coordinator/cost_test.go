package coordinator_test

import (
	"math"
	"testing"
	"time"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// Shares of users are a courtesy: a store that cannot tell them stops nothing.
func TestUsageThatCannotBeReadStopsNothing(t *testing.T) {
	t.Parallel()
	request := chainsRequest(40)
	want := reference(t, request)
	p := newPair(t, 300*time.Millisecond)
	s := p.sites[0]
	s.start()
	defer s.stop()
	p.lines[0].silent.Store(true)
	defer s.crew(workers(2, slowly)...)()
	id := s.submit(request)
	time.Sleep(900 * time.Millisecond) // several beats
	select {
	case <-s.done:
		t.Fatal("the coordinator has ended")
	default:
	}
	p.eventually("ready", func() bool { return s.c.Ready(t.Context()) == nil })
	sameFilm(t, s.finished(id), want)
}

// What workers say of their CPU time is believed as far as it can be true.
func TestCPUTimeIsBounded(t *testing.T) {
	t.Parallel()
	request := chainsRequest(40)
	want := reference(t, request)
	p := newPair(t, 300*time.Millisecond)
	s := p.sites[0]
	s.start()
	defer s.stop()
	const n = 2
	start := time.Now()
	defer s.crew(workers(n, func(w *fakeworker.Worker) { w.CPUSeconds, w.Delay = math.MaxFloat64, 5*time.Millisecond })...)()
	done := s.finished(s.submit(request))
	sameFilm(t, done, want)
	if possible := n * time.Since(start).Seconds(); !(done.CPUSeconds > 0) || done.CPUSeconds > possible {
		t.Errorf("%v CPU seconds, at most %v can be", done.CPUSeconds, possible)
	}
}

func TestCPUTimeThatCannotBeIsRefused(t *testing.T) {
	var clock clock
	s := newSite(t)
	s.tune = func(o *coordinator.Options) {
		o.Now, o.LeaseTTL, o.OwnershipTTL = clock.now, time.Hour, 24*time.Hour
	}
	s.start()
	defer s.stop()
	a := newHand(t, s.c, "a")
	id := s.submit(chainsRequest(20))
	a.report(a.lease()[0], &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Scene{Scene: report("pssmlt")}})
	for _, wrong := range []float64{math.NaN(), -1} {
		task := a.lease()[0]
		result := samplesOf(task)
		result.CpuSeconds = wrong
		in := &farmv1.ReportRequest{
			WorkerId: a.id, Lease: leaseOf(task), Result: &farmv1.ReportRequest_Bootstrap{Bootstrap: result},
		}
		in.Checksum = checksum.Of(in)
		answer, err := s.c.Report(t.Context(), in)
		if err != nil || answer.GetOutcome() != farmv1.Outcome_OUTCOME_REJECTED {
			t.Errorf("%v: %v, error %v", wrong, answer, err)
		}
	}
	// Held for 3 s by a worker of one thread.
	task := a.lease()[0]
	clock.advance(3 * time.Second)
	result := samplesOf(task)
	result.CpuSeconds = math.MaxFloat64
	a.report(task, &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Bootstrap{Bootstrap: result}})
	if got := s.job(id); got.CPUSeconds != 3 || got.State == job.Failed {
		t.Errorf("%v CPU seconds, not 3; job %s: %s", got.CPUSeconds, got.State, got.Error)
	}
}

func TestWorkersWithTooManyThreadsAreRefused(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	in := &farmv1.RegisterRequest{Name: "x", Version: testVersion, Threads: 1 << 20, Instance: "0123456789abcdef0123456789abcdef"}
	if _, err := s.c.Register(t.Context(), in); err == nil {
		t.Error("taken")
	}
}
