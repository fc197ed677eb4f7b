package coordinator_test

import (
	"context"
	"fmt"
	"strings"
	"testing"
	"time"

	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/flow"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/merge"
)

// testFilm is the film of the scenes that fake workers find.
var testFilm = film.Shape{Width: 70, Height: 41, Layers: 2}

// TestMemoryIsBoundedWhateverTheLoad: many workers deliver as fast as they can, in batches of which
// one fits into the budget at a time.
func TestMemoryIsBoundedWhateverTheLoad(t *testing.T) {
	request := chainsRequest(60)
	want := reference(t, request)
	budget := merge.UnpackedBytes(testFilm.TileCount()) / 2
	s := newSite(t)
	s.tune = func(o *coordinator.Options) {
		o.MergeBudget, o.Deliveries, o.CheckOneIn = budget, 8, 50
	}
	s.start()
	defer s.stop()
	defer s.crew(workers(24, nil)...)()
	sameFilm(t, s.finished(s.submit(request)), want)
	// The answer to the last batch, and its leave, may come after the end of the job.
	got := gather(t, s.c.Collector())
	for deadline := time.Now().Add(time.Minute); got["metrofarm_merge_queue_batches"] > 0 && time.Now().Before(deadline); {
		time.Sleep(10 * time.Millisecond)
		got = gather(t, s.c.Collector())
	}
	peak := got["metrofarm_merge_queue_peak_bytes"]
	// A batch may be larger than half of the budget and be read beside what is held; packed tiles come
	// on top. Eight at once would take four times the budget.
	if bound := float64(2 * budget); peak > bound || peak < float64(budget)/2 {
		t.Errorf("batches took %g bytes of memory; want %g to %g", peak, float64(budget)/2, bound)
	}
	if got["metrofarm_merge_queue_bytes"] != 0 || got["metrofarm_merge_queue_batches"] != 0 || got["metrofarm_held_bytes"] != 0 {
		t.Errorf("something is left: %v", got)
	}
	t.Logf("peak %g bytes, budget %d, %g lease calls withheld", peak, budget, got["metrofarm_leases_withheld_total"])
}

// TestBatchesLargerThanTheBudget are taken one at a time.
func TestBatchesLargerThanTheBudget(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.MergeBudget, o.CheckOneIn = 1000, 50 }
	s.start()
	defer s.stop()
	defer s.crew(workers(4, nil)...)()
	sameFilm(t, s.finished(s.submit(request)), want)
	got := gather(t, s.c.Collector())
	if got["metrofarm_leases_withheld_total"] == 0 {
		t.Error("no lease was withheld")
	}
}

func TestFilmDoesNotDependOnTheBudgets(t *testing.T) {
	for name, request := range map[string]job.Request{"pssmlt": chainsRequest(30), "path": pathRequest(20)} {
		want := reference(t, request)
		for _, inbound := range []int64{1, 1000, 1 << 40} {
			s := newSite(t)
			s.tune = func(o *coordinator.Options) { o.InboundBytes = inbound }
			s.start()
			dismiss := s.crew(workers(3, func(w *fakeworker.Worker) { w.Seal = true })...)
			sameFilm(t, s.finished(s.submit(request)), want)
			dismiss()
			s.stop()
			t.Logf("%s with %d bytes per second", name, inbound)
		}
	}
}

// enrolled registers a worker that does nothing by itself.
func (s *site) enrolled(name string, threads uint32) string {
	s.t.Helper()
	answer, err := s.c.Register(context.Background(), &farmv1.RegisterRequest{
		Name: name, Version: testVersion, Threads: threads, Instance: (fmt.Sprintf("%x", name) + strings.Repeat("0", 32))[:32],
	})
	s.check(err)
	return answer.GetWorkerId()
}

// rendering submits a job that is about to be rendered by workers that are enrolled by hand.
func (s *site) rendering(request job.Request) string {
	s.t.Helper()
	id := s.submit(request)
	dismiss := s.crew(workers(1, func(w *fakeworker.Worker) { w.Fault = func() fakeworker.Fault { return fakeworker.Vanish } })...)
	s.await(id, "rendering", func(j job.Snapshot) bool { return j.State == job.Rendering })
	dismiss()
	return id
}

func TestEverybodyHasAShareOfWhatWaits(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.LeaseTTL = 2 * time.Second }
	s.start()
	defer s.stop()
	id := s.rendering(chainsRequest(60))
	defer func() { _, _ = s.c.Cancel(context.Background(), id) }()
	time.Sleep(2500 * time.Millisecond) // the worker that began is lost
	large, small := s.enrolled("large", 3), s.enrolled("small", 1)
	granted := func(worker string, most uint32) int {
		answer, err := s.c.Lease(context.Background(), &farmv1.LeaseRequest{WorkerId: worker, MaxSegments: most, WaitSeconds: 5})
		s.check(err)
		return len(answer.GetTasks())
	}
	const segments = 16 // 1024 chains in groups of 64
	if got := granted(large, 2); got != 2 {
		t.Errorf("%d segments for a worker that asks for 2", got)
	}
	if got := granted(large, 4096); got != 11 {
		t.Errorf("%d segments for 3 of 4 threads; want 11 of the %d that wait", got, segments-2)
	}
	if got := granted(small, 4096); got != 1 {
		t.Errorf("%d segments for 1 of 4 threads; want 1 of the 3 that wait", got)
	}
	for range 2 {
		if got := granted(small, 4096); got != 1 {
			t.Errorf("%d segments; want 1: nobody gets none while some wait", got)
		}
	}
}

func TestWorkersAreToldHowLongToCollect(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.LeaseTTL, o.InboundBytes = time.Minute, 1000 }
	s.start()
	defer s.stop()
	w := s.enrolled("a", 1)
	id := s.submit(longRequest())
	defer func() { _, _ = s.c.Cancel(context.Background(), id) }()
	inspect, err := s.c.Lease(context.Background(), &farmv1.LeaseRequest{WorkerId: w, MaxSegments: 4})
	s.check(err)
	if got := inspect.GetSealSeconds(); got != flow.MinSeal.Seconds() {
		t.Errorf("%g seconds before there is a film", got)
	}
	(&hand{t: t, c: s.c, id: w}).report(inspect.GetTasks()[0], &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Failure{
		Failure: &farmv1.TaskFailure{Reason: farmv1.FailureReason_FAILURE_REASON_WORKER, Message: "another should do it"},
	}})
	defer s.crew(workers(1, func(w *fakeworker.Worker) { w.Delay = 20 * time.Millisecond })...)()
	s.await(id, "merged in part", func(j job.Snapshot) bool { return j.Mutations > 0 })
	var two *farmv1.LeaseResponse
	for two == nil || len(two.GetTasks()) == 0 {
		two, err = s.c.Lease(context.Background(), &farmv1.LeaseRequest{WorkerId: w, MaxSegments: 1, WaitSeconds: 1})
		s.check(err)
	}
	if got := two.GetSealSeconds(); got <= flow.MinSeal.Seconds() || got > 600 {
		t.Errorf("two workers should collect for %g seconds", got)
	}
}

func TestAThirdBatchOfOneWorkerIsRefused(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.LeaseTTL = time.Minute }
	s.start()
	defer s.stop()
	w := s.enrolled("a", 1)
	header := func(worker string) *farmv1.DeliverHeader {
		return &farmv1.DeliverHeader{WorkerId: worker, Batch: &farmv1.BatchHeader{JobId: "nobody's"}}
	}
	open := func(worker string) (*coordinator.Delivery, error) {
		d, err := s.c.Admit(t.Context())
		s.check(err)
		return d, d.Open(t.Context(), header(worker))
	}
	first, err := open(w)
	s.check(err)
	second, err := open(w)
	s.check(err)
	other, err := open(s.enrolled("b", 1))
	s.check(err)
	defer other.Finish(false)
	defer second.Finish(false)
	sender := &fakeworker.Worker{Name: "a", Version: testVersion, Report: report("pssmlt")}
	dismiss := s.crew(sender)
	defer dismiss()
	stream, err := sender.Client.Deliver(t.Context())
	s.check(err)
	s.check(stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Header{Header: header(w)}}))
	if _, err := stream.CloseAndRecv(); status.Code(err) != codes.ResourceExhausted || !strings.Contains(err.Error(), "2 batches") {
		t.Errorf("the third was answered %v", err)
	}
	first.Finish(true)
	third, err := open(w)
	if err != nil {
		t.Errorf("refused after one was answered: %v", err)
	}
	third.Finish(false)
}
