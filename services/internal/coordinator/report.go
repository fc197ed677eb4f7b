package coordinator

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"strings"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/job"
)

// Report takes the result of an inspection or of bootstrap samples, or a failure.
func (c *Coordinator) Report(_ context.Context, in *farmv1.ReportRequest) (*farmv1.ReportResponse, error) {
	w, err := c.findWorker(in.GetWorkerId())
	if err != nil {
		return nil, err
	}
	if damage := checksum.Check(in); damage != nil {
		return c.refuse(w, in, damage), nil
	}
	r := c.runOfTask(in.GetLease().GetTaskId())
	if r == nil {
		return superseded("no such job"), nil
	}
	defer c.announce()
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.gone.Load() {
		return superseded("the job has moved to another coordinator"), nil
	}
	if !r.table.Held(ref(in.GetLease()), w.id) {
		return superseded("the lease is gone"), nil
	}
	err = r.takeReport(w, in)
	var bad *malformedError
	if errors.As(err, &bad) {
		r.blame(in.GetLease(), w, bad.Error())
		return &farmv1.ReportResponse{Outcome: farmv1.Outcome_OUTCOME_REJECTED, Message: bad.Error()}, nil
	}
	return &farmv1.ReportResponse{Outcome: farmv1.Outcome_OUTCOME_COMMITTED}, err
}

func superseded(message string) *farmv1.ReportResponse {
	return &farmv1.ReportResponse{Outcome: farmv1.Outcome_OUTCOME_SUPERSEDED, Message: message}
}

// malformedError is a result that no correct worker sends.
type malformedError struct{ message string }

func (e *malformedError) Error() string { return e.message }

// takeReport requires: mu; the worker holds the lease.
func (r *run) takeReport(w worker, in *farmv1.ReportRequest) error {
	key := r.tasks[in.GetLease().GetTaskId()]
	switch result := in.GetResult().(type) {
	case *farmv1.ReportRequest_Failure:
		r.takeFailure(w, in.GetLease(), result.Failure)
		return nil
	case *farmv1.ReportRequest_Scene:
		if key.phase == job.Inspecting {
			return r.inspected(in.GetLease().GetTaskId(), result.Scene)
		}
	case *farmv1.ReportRequest_Bootstrap:
		if key.phase == job.Bootstrapping && r.stage != stageTrials {
			return r.sampled(w, in.GetLease(), key.first, result.Bootstrap)
		}
	case *farmv1.ReportRequest_KernelTrials:
		if key.phase == job.Bootstrapping && r.stage == stageTrials {
			return r.tried(w, in.GetLease(), result.KernelTrials)
		}
	}
	return &malformedError{"the result does not fit the task"}
}

// takeFailure requires: mu.
func (r *run) takeFailure(w worker, l *farmv1.LeaseRef, f *farmv1.TaskFailure) {
	message := strings.ToValidUTF8(f.GetMessage(), "?")
	if f.GetReason() == farmv1.FailureReason_FAILURE_REASON_SCENE {
		r.fail(message)
		return
	}
	r.blame(l, w, fmt.Sprintf("%s: %s", f.GetReason(), message))
}

// blame gives a lease back as failed and ends the job if its task is poison. Requires: mu.
func (r *run) blame(l *farmv1.LeaseRef, w worker, evidence string) {
	if !r.table.Fail(ref(l), w.id, evidence) {
		return
	}
	r.publish("fault", fmt.Sprintf("task %s failed on worker %s: %s", l.GetTaskId(), w.name, evidence), nil,
		append(identity(w), slog.String("task", l.GetTaskId()))...)
	r.endIfPoisoned()
	r.save()
}

// endIfPoisoned requires: mu.
func (r *run) endIfPoisoned() {
	p, poisoned := r.table.Poisoned(r.eligible())
	if !poisoned {
		return
	}
	text := fmt.Sprintf("task %s cannot be rendered:", p.Task)
	if len(p.Failed) > 0 {
		text += fmt.Sprintf(" it failed %d time(s), on %s, and the last said: %s", p.Failures, r.c.describeAll(p.Failed), p.Evidence)
	}
	if len(p.Lost) > 0 {
		text += fmt.Sprintf(" it was lost with %s, not heard of since", r.c.describeAll(p.Lost))
	}
	r.fail(text)
}

// expire ends leases whose time is over. Requires: mu.
func (r *run) expire() {
	expired := r.table.Expire(r.c.options.Now())
	if len(expired) == 0 {
		return
	}
	defer r.c.announce()
	r.c.metrics.expired.Add(float64(len(expired)))
	byWorker := make(map[string]int)
	for _, e := range expired {
		byWorker[e.Worker]++
	}
	lost := r.c.lostWorkers(byWorker)
	for _, e := range expired {
		if lost[e.Worker] {
			r.table.NoteLost(e.Task, e.Worker)
		}
	}
	for id, n := range byWorker {
		how := "did not renew"
		if lost[id] {
			how = "is lost with"
		}
		if lost[id] {
			delete(r.crew, id)
		}
		r.publish("fault", fmt.Sprintf("worker %s %s %d task(s); they are leased again", id, how, n), nil, slog.String("worker", id))
	}
	r.endIfPoisoned()
	r.save()
}
