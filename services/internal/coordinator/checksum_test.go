package coordinator_test

import (
	"strings"
	"testing"
	"time"

	"google.golang.org/protobuf/proto"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// damages of a header that leave its film and its digests as they are.
var damages = map[string]func(*farmv1.BatchHeader){
	"number":   func(h *farmv1.BatchHeader) { h.Segments[0].Segment ^= 1 << 3 },
	"epoch":    func(h *farmv1.BatchHeader) { h.Segments[0].Lease.Epoch ^= 1 },
	"task":     func(h *farmv1.BatchHeader) { h.Segments[0].Lease.TaskId += "0" },
	"rays":     func(h *farmv1.BatchHeader) { h.Segments[1].Counts.Rays ^= 1 << 20 },
	"state":    func(h *farmv1.BatchHeader) { h.Segments[0].State[3] ^= 1 << 7 },
	"count":    func(h *farmv1.BatchHeader) { h.Segments[0].LargeStepSums[63].Count ^= 1 },
	"sum":      func(h *farmv1.BatchHeader) { h.Segments[0].LargeStepSums[0].Sum *= 2 },
	"checksum": func(h *farmv1.BatchHeader) { h.Segments[1].Checksum ^= 1 << 63 },
	"none":     func(h *farmv1.BatchHeader) { h.Segments[0].Checksum = 0 },
	// What checksums do not show.
	"round": func(h *farmv1.BatchHeader) { h.Round ^= 1 },
	"exchange": func(h *farmv1.BatchHeader) {
		first, second := h.GetSegments()[0], h.GetSegments()[1]
		first.Segment, second.Segment = second.GetSegment(), first.GetSegment()
		first.Checksum, second.Checksum = checksum.Of(first), checksum.Of(second)
	},
}

// Whatever changes in a header: nothing of the batch is merged, its worker gets into quarantine, and
// another one does its work.
func TestDamagedHeadersAreRefused(t *testing.T) {
	request := chainsRequest(60)
	want := reference(t, request)
	for name, damage := range damages {
		t.Run(name, func(t *testing.T) {
			t.Parallel()
			s := newSite(t)
			s.tune = func(o *coordinator.Options) { o.Quarantine = time.Hour }
			s.start()
			defer s.stop()
			crew := workers(2, nil)
			crew[1].Rendered = func(h *farmv1.BatchHeader, _ []*farmv1.Tile) { damage(h) }
			id := s.submit(request)
			defer s.crew(crew[1])()
			s.await(id, "refused a batch", func(j job.Snapshot) bool {
				return s.workers()["b"].State == "quarantined" || j.Mutations > 0
			})
			if done := s.job(id).Mutations; done != 0 {
				t.Fatalf("%d mutations of a damaged batch are counted", done)
			}
			defer s.crew(crew[0])()
			sameFilm(t, s.finished(id), want)
			if a, b := s.workers()["a"], s.workers()["b"]; a.Conflicts != 0 || b.Conflicts != 1 {
				t.Errorf("%d conflicts of the honest worker, %d of the other", a.Conflicts, b.Conflicts)
			}
		})
	}
}

// sendDamaged sends the result of a task with a change that its checksum does not know.
func (h *hand) sendDamaged(task *farmv1.Task, in *farmv1.ReportRequest, damage func(*farmv1.ReportRequest)) {
	h.t.Helper()
	in.WorkerId, in.Lease = h.id, leaseOf(task)
	in.Checksum = checksum.Of(in)
	in = proto.CloneOf(in)
	damage(in)
	answer, err := h.c.Report(h.t.Context(), in)
	if err != nil || answer.GetOutcome() != farmv1.Outcome_OUTCOME_CONFLICT || !strings.Contains(answer.GetMessage(), "checksum") {
		h.t.Errorf("answer %v, error %v", answer, err)
	}
}

func TestDamagedReportsAreRefused(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.LeaseTTL, o.Quarantine = time.Hour, time.Hour }
	s.start()
	defer s.stop()
	id := s.submit(chainsRequest(20))
	a, b, c, d := newHand(t, s.c, "a"), newHand(t, s.c, "b"), newHand(t, s.c, "c"), newHand(t, s.c, "d")

	scene := &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Scene{Scene: report("pssmlt")}}
	a.sendDamaged(a.await(), scene, func(in *farmv1.ReportRequest) { in.GetScene().Width ^= 1 << 4 })
	failure := &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Failure{Failure: &farmv1.TaskFailure{
		Reason: farmv1.FailureReason_FAILURE_REASON_WORKER, Message: "another should do it",
	}}}
	b.sendDamaged(b.await(), failure, func(in *farmv1.ReportRequest) { // a single bit would end the job
		in.GetFailure().Reason = farmv1.FailureReason_FAILURE_REASON_SCENE
	})
	c.report(c.await(), scene)
	first := c.await()
	samples := &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Bootstrap{Bootstrap: samplesOf(first)}}
	c.sendDamaged(first, samples, func(in *farmv1.ReportRequest) { in.GetBootstrap().Values[7] *= 2 })

	for _, name := range []string{"a", "b", "c"} {
		if w := s.workers()[name]; w.State != "quarantined" || w.Conflicts != 1 {
			t.Errorf("%s: %s, %d conflicts", w.Name, w.State, w.Conflicts)
		}
	}
	again := d.await()
	if again.GetTaskId() != first.GetTaskId() {
		t.Errorf("leased %s, want %s again", again.GetTaskId(), first.GetTaskId())
	}
	d.report(again, samples)
	if j := s.job(id); j.State != job.Bootstrapping && j.State != job.Rendering {
		t.Errorf("the job is %s: %s", j.State, j.Error)
	}
}
