package coordinator_test

import (
	"context"
	"errors"
	"strings"
	"testing"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// hand is a worker that is moved by hand.
type hand struct {
	t  *testing.T
	c  *coordinator.Coordinator
	id string
}

func newHand(t *testing.T, c *coordinator.Coordinator, letter string) *hand {
	t.Helper()
	registered, err := c.Register(t.Context(), &farmv1.RegisterRequest{
		Name: letter, Version: testVersion, Threads: 1, Instance: strings.Repeat(letter, 32),
	})
	if err != nil {
		t.Fatal(err)
	}
	return &hand{t: t, c: c, id: registered.GetWorkerId()}
}

func (h *hand) lease() []*farmv1.Task {
	h.t.Helper()
	answer, err := h.c.Lease(h.t.Context(), &farmv1.LeaseRequest{WorkerId: h.id, MaxSegments: 1})
	if err != nil {
		h.t.Fatal(err)
	}
	return answer.GetTasks()
}

func (h *hand) release(leaving bool, tasks ...*farmv1.Task) {
	h.t.Helper()
	in := &farmv1.ReleaseRequest{WorkerId: h.id, Leaving: leaving}
	for _, t := range tasks {
		in.Leases = append(in.Leases, &farmv1.LeaseRef{TaskId: t.GetTaskId(), Epoch: t.GetEpoch()})
	}
	if _, err := h.c.Release(h.t.Context(), in); err != nil {
		h.t.Fatal(err)
	}
}

// fail reports that the task cannot be done.
func (h *hand) fail(task *farmv1.Task) {
	h.t.Helper()
	h.report(task, &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Failure{Failure: &farmv1.TaskFailure{
		Reason: farmv1.FailureReason_FAILURE_REASON_REPLAY, Message: "by hand",
	}}})
}

// patientSite grants leases that outlast the test.
func patientSite(t *testing.T) *site {
	t.Helper()
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.LeaseTTL = time.Hour }
	s.start()
	t.Cleanup(s.stop)
	return s
}

func TestReleasedLeasesAreGrantedAgain(t *testing.T) {
	s := patientSite(t)
	a, b := newHand(t, s.c, "a"), newHand(t, s.c, "b")
	s.submit(pathRequest(1))
	tasks := a.lease()
	if len(tasks) != 1 || len(b.lease()) != 0 {
		t.Fatalf("a got %d tasks; there is one, for a alone", len(tasks))
	}
	stale := &farmv1.Task{TaskId: tasks[0].GetTaskId(), Epoch: tasks[0].GetEpoch() + 1}
	a.release(false, stale)
	b.release(false, tasks[0])
	if len(b.lease()) != 0 {
		t.Error("a lease was given back by who did not hold it")
	}
	a.release(false, tasks[0])
	again := b.lease()
	if len(again) != 1 || again[0].GetTaskId() != tasks[0].GetTaskId() || again[0].GetEpoch() == tasks[0].GetEpoch() {
		t.Errorf("b got %v after the release of %v", again, tasks)
	}
}

func TestAWorkerThatLeavesIsForgotten(t *testing.T) {
	s := patientSite(t)
	a, b := newHand(t, s.c, "a"), newHand(t, s.c, "b")
	s.submit(pathRequest(1))
	if len(a.lease()) != 1 {
		t.Fatal("a got no task")
	}
	a.release(true)
	if len(b.lease()) != 1 {
		t.Error("b did not get what a held")
	}
	views, err := s.c.Workers(t.Context())
	if err != nil || len(views) != 1 || views[0].Name != "b" {
		t.Errorf("workers %+v, error %v", views, err)
	}
	_, err = s.c.Heartbeat(t.Context(), &farmv1.HeartbeatRequest{WorkerId: a.id})
	if !errors.Is(err, job.ErrNotFound) {
		t.Errorf("error %v: a must register again", err)
	}
}

func TestLeasesThatNobodyHearsOfAreGivenBack(t *testing.T) {
	s := patientSite(t)
	a, b := newHand(t, s.c, "a"), newHand(t, s.c, "b")
	s.submit(pathRequest(1))
	ctx, cancel := context.WithCancel(t.Context())
	cancel()
	if _, err := s.c.Lease(ctx, &farmv1.LeaseRequest{WorkerId: a.id, MaxSegments: 1}); !errors.Is(err, context.Canceled) {
		t.Fatalf("error %v", err)
	}
	if len(b.lease()) != 1 {
		t.Error("the lease is held by a worker that does not know of it")
	}
}

// A segment under way is stopped only where it is certain that nothing of it will be counted.
func TestLostLeasesAreToldApart(t *testing.T) {
	t.Parallel()
	p := newPair(t, 0)
	first, second := p.sites[0], p.sites[1]
	first.start()
	defer first.stop()
	second.start()
	defer second.stop()
	a, elsewhere := newHand(t, first.c, "a"), newHand(t, second.c, "a")
	id := first.submit(pathRequest(1))
	tasks := a.lease()
	if len(tasks) != 1 {
		t.Fatal("no task")
	}
	told := func(h *hand, task string, epoch uint64) farmv1.Directive {
		t.Helper()
		answer, err := h.c.Heartbeat(t.Context(), &farmv1.HeartbeatRequest{
			WorkerId: h.id, Leases: []*farmv1.LeaseProgress{{Lease: &farmv1.LeaseRef{TaskId: task, Epoch: epoch}}},
		})
		first.check(err)
		return answer.GetDirectives()[0].GetDirective()
	}
	task, epoch := tasks[0].GetTaskId(), tasks[0].GetEpoch()
	for _, c := range []struct {
		what      string
		got, want farmv1.Directive
	}{
		{"a lease", told(a, task, epoch), farmv1.Directive_DIRECTIVE_CONTINUE},
		{"an older lease", told(a, task, epoch+1), farmv1.Directive_DIRECTIVE_ABANDON},
		{"a job of another coordinator", told(elsewhere, task, epoch), farmv1.Directive_DIRECTIVE_ABANDON},
		{"a job that was deleted", told(a, "job-none/1", 1), farmv1.Directive_DIRECTIVE_INTERRUPT},
	} {
		if c.got != c.want {
			t.Errorf("%s: %v, want %v", c.what, c.got, c.want)
		}
	}
	if _, err := first.c.Cancel(t.Context(), id); err != nil {
		t.Fatal(err)
	}
	for _, h := range []*hand{a, elsewhere} {
		p.eventually("interrupted", func() bool { return told(h, task, epoch) == farmv1.Directive_DIRECTIVE_INTERRUPT })
	}
}
