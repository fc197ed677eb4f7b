package coordinator_test

import (
	"strings"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// submitAs submits a job of a user.
func (s *site) submitAs(user string, priority int, request job.Request) string {
	s.t.Helper()
	request.Scene, request.Entry, request.Priority = s.bundle(), "scene.xml", priority
	snapshot, err := s.c.Submit(auth.With(s.t.Context(), auth.Identity{User: user}), request, "")
	s.check(err)
	return snapshot.ID
}

func (s *site) change(id string, priority int) {
	s.t.Helper()
	_, err := s.c.Change(s.t.Context(), id, job.Change{Priority: &priority})
	s.check(err)
}

// leasesOf tells which job the next leases are of.
func (h *hand) leasesOf(n int) (ids []string) {
	h.t.Helper()
	for range n {
		tasks := h.lease()
		if len(tasks) == 0 {
			return append(ids, "none")
		}
		ids = append(ids, tasks[0].GetJobId())
	}
	return ids
}

// report sends the result of a task.
func (h *hand) report(task *farmv1.Task, in *farmv1.ReportRequest) {
	h.t.Helper()
	in.WorkerId, in.Lease = h.id, leaseOf(task)
	in.Checksum = checksum.Of(in)
	answer, err := h.c.Report(h.t.Context(), in)
	if err != nil || answer.GetOutcome() != farmv1.Outcome_OUTCOME_COMMITTED {
		h.t.Fatalf("answer %v, error %v", answer, err)
	}
}

func equal(t *testing.T, what string, got []string, want ...string) {
	t.Helper()
	if strings.Join(got, " ") != strings.Join(want, " ") {
		t.Errorf("%s: %v, want %v", what, got, want)
	}
}

func TestHigherPriorityGoesFirst(t *testing.T) {
	s := patientSite(t)
	h := newHand(t, s.c, "a")
	low := s.submitAs("", -1, pathRequest(1))
	first, second := s.submitAs("", 0, pathRequest(1)), s.submitAs("", 0, pathRequest(1))
	high := s.submitAs("", 5, pathRequest(1))
	for position, id := range []string{high, first, second, low} {
		if got := s.job(id).QueuePosition; got != position+1 {
			t.Errorf("job %d is at place %d", position+1, got)
		}
	}
	s.change(second, 6)
	equal(t, "leases", h.leasesOf(5), second, high, first, low, "none")
	if got := s.job(low).QueuePosition; got != 0 {
		t.Errorf("a job whose only task is leased is at place %d", got)
	}
}

func TestPriorityOutlivesTheCoordinator(t *testing.T) {
	s := newSite(t)
	s.start()
	first, second := s.submitAs("", 0, pathRequest(1)), s.submitAs("", 0, pathRequest(1))
	s.change(second, 1)
	s.kill()
	s.start()
	defer s.stop()
	s.await(first, "taken over", func(j job.Snapshot) bool { return !j.Stale })
	s.await(second, "taken over", func(j job.Snapshot) bool { return !j.Stale })
	if got := s.job(second).Request.Priority; got != 1 {
		t.Errorf("priority %d", got)
	}
	s.await(second, "first in the queue", func(j job.Snapshot) bool { return j.QueuePosition == 1 })
	equal(t, "leases", newHand(t, s.c, "a").leasesOf(2), second, first)
}

func TestPausedJobsAreNotInTheQueue(t *testing.T) {
	s := patientSite(t)
	paused, other := s.submitAs("", 5, pathRequest(1)), s.submitAs("", 0, pathRequest(1))
	if _, err := s.c.Pause(t.Context(), paused); err != nil {
		t.Fatal(err)
	}
	if got := s.job(paused).QueuePosition; got != 0 {
		t.Errorf("paused at place %d", got)
	}
	h := newHand(t, s.c, "a")
	equal(t, "leases", h.leasesOf(2), other, "none")
	if _, err := s.c.Resume(t.Context(), paused); err != nil {
		t.Fatal(err)
	}
	equal(t, "leases", h.leasesOf(1), paused)
}

// A user's many jobs do not outweigh another's one, even before any work has come back.
func TestUsersShareTheFarm(t *testing.T) {
	s := patientSite(t)
	h := newHand(t, s.c, "a")
	var many []string
	for range 4 {
		many = append(many, s.submitAs("many", 0, pathRequest(1)))
	}
	few := []string{s.submitAs("few", 0, pathRequest(1)), s.submitAs("few", 0, pathRequest(1))}
	equal(t, "leases", h.leasesOf(6), many[0], few[0], many[1], few[1], many[2], many[3])
}

// CPU time of merged work counts: who had the farm for himself goes second.
func TestWhoUsedTheFarmGoesSecond(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	dismiss := s.crew(workers(1, nil)...)
	s.finished(s.submitAs("a", 0, chainsRequest(20)))
	dismiss()
	first, second := s.submitAs("a", 0, pathRequest(1)), s.submitAs("b", 0, pathRequest(1))
	if a, b := s.job(first).QueuePosition, s.job(second).QueuePosition; a != 2 || b != 1 {
		t.Errorf("places %d and %d", a, b)
	}
	equal(t, "leases", newHand(t, s.c, "f").leasesOf(2), second, first)
}

// clock is a coordinator's that the test moves.
type clock struct{ offset atomic.Int64 }

func (c *clock) now() time.Time { return time.Unix(1e9, c.offset.Load()) }

// advance moves the clock on and lets housekeeping see that.
func (c *clock) advance(d time.Duration) {
	c.offset.Add(int64(d))
	time.Sleep(100 * time.Millisecond)
}

// renew sends a heartbeat for tasks.
func (h *hand) renew(tasks ...*farmv1.Task) {
	h.t.Helper()
	in := &farmv1.HeartbeatRequest{WorkerId: h.id}
	for _, t := range tasks {
		in.Leases = append(in.Leases, &farmv1.LeaseProgress{Lease: leaseOf(t)})
	}
	if _, err := h.c.Heartbeat(h.t.Context(), in); err != nil {
		h.t.Fatal(err)
	}
}

func leaseOf(t *farmv1.Task) *farmv1.LeaseRef {
	return &farmv1.LeaseRef{TaskId: t.GetTaskId(), Epoch: t.GetEpoch()}
}

// What waits in a job of low priority goes before a copy of what straggles in one of high priority.
func TestCopiesComeLast(t *testing.T) {
	var clock clock
	s := newSite(t)
	s.tune = func(o *coordinator.Options) {
		o.Now, o.LeaseTTL, o.OwnershipTTL = clock.now, time.Minute, 24*time.Hour
	}
	s.start()
	defer s.stop()
	slow, quick := newHand(t, s.c, "a"), newHand(t, s.c, "b")
	high := s.submitAs("", 9, chainsRequest(20))
	slow.report(slow.lease()[0], &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Scene{Scene: report("pssmlt")}})
	first := slow.lease()[0]
	slow.report(first, &farmv1.ReportRequest{Result: &farmv1.ReportRequest_Bootstrap{Bootstrap: samplesOf(first)}})
	var held []*farmv1.Task
	for {
		tasks := slow.lease()
		if held = append(held, tasks...); len(tasks) == 0 {
			break
		}
	}
	if len(held) == 0 {
		t.Fatal("the job has one bootstrap task only")
	}
	low := s.submitAs("", 0, pathRequest(1))
	for range 3 {
		clock.advance(40 * time.Second)
		slow.renew(held...)
	}
	equal(t, "leases", quick.leasesOf(2), low, high)
	if slow.renew(held...); s.job(high).State.Ended() {
		t.Error("the job has ended")
	}
}

// samplesOf a bootstrap task, all alike.
func samplesOf(t *farmv1.Task) *farmv1.BootstrapResult {
	part := t.GetBootstrap()
	result := &farmv1.BootstrapResult{FirstIndex: part.GetFirstIndex(), CpuSeconds: 1}
	for range part.GetCount() {
		result.Values = append(result.Values, 1)
	}
	return result
}

// await waits for a task.
func (h *hand) await() *farmv1.Task {
	h.t.Helper()
	for deadline := time.Now().Add(patience); time.Now().Before(deadline); {
		answer, err := h.c.Lease(h.t.Context(), &farmv1.LeaseRequest{WorkerId: h.id, MaxSegments: 1, WaitSeconds: 1})
		if err != nil {
			h.t.Fatal(err)
		}
		if len(answer.GetTasks()) > 0 {
			return answer.GetTasks()[0]
		}
	}
	h.t.Fatal("no task")
	return nil
}

func TestATaskThatKillsThreeWorkersFailsItsJob(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	id := s.submit(pathRequest(1))
	for _, letter := range []string{"a", "b", "c"} {
		newHand(t, s.c, letter).await()
	}
	failed := s.await(id, "ended", func(j job.Snapshot) bool { return j.State.Ended() })
	for _, evidence := range []string{id + "/inspect", "lost with", "a (w-aaaa", "b (w-bbbb", "c (w-cccc"} {
		if failed.State != job.Failed || !strings.Contains(failed.Error, evidence) {
			t.Errorf("%s: %q lacks %q", failed.State, failed.Error, evidence)
		}
	}
}

// Workers that are cut off for longer than a lease lives, and come back, were not killed by what they
// held. Neither were workers that left.
func TestInfrastructureDoesNotPoison(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	id := s.submit(pathRequest(1))
	var cutOff *hand
	for _, letter := range []string{"a", "b", "c", "d"} {
		h := newHand(t, s.c, letter)
		h.await()
		if cutOff != nil {
			cutOff.renew()
		}
		cutOff = h
	}
	for _, letter := range []string{"e", "f", "1", "2"} {
		h := newHand(t, s.c, letter)
		h.release(true, h.await())
	}
	if j := s.job(id); j.State.Ended() {
		t.Errorf("%s: %s", j.State, j.Error)
	}
}

// A worker that registers again after it was lost was not killed by what it held either.
func TestWhoRegistersAgainIsForgiven(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	id := s.submit(pathRequest(1))
	lost := ""
	for _, letter := range []string{"a", "b", "c", "d"} {
		newHand(t, s.c, letter).await()
		if lost != "" {
			newHand(t, s.c, lost)
		}
		lost = letter
	}
	if j := s.job(id); j.State.Ended() {
		t.Errorf("%s: %s", j.State, j.Error)
	}
}
