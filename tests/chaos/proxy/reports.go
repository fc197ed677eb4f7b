package main

import (
	"context"
	"math/rand/v2"
	"time"

	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

func (d *disturber) report(ctx context.Context, to *passage, in *farmv1.ReportRequest) (*farmv1.ReportResponse, error) {
	task := in.GetLease().GetTaskId()
	number, f, random := d.schedule.report(func(f fault) bool { return d.reportTakes(in, f) })
	v := &report{d: d, to: to, in: in, entry: entry{
		Number: number, Call: "report", Fault: string(f), Upstream: to.name, Worker: in.GetWorkerId(), Task: task,
	}}
	switch f {
	case stale:
		return v.sendStale(ctx)
	case flipReport:
		return v.damage(ctx, random)
	}
	answer, err := v.send(ctx, in, stepIntact, "")
	switch {
	case err != nil:
	case f == repeat:
		_, _ = v.send(ctx, in, stepCopy, "")
	case f == repeatLater:
		go v.later(time.Duration(2000+random.IntN(10000)) * time.Millisecond)
	}
	return answer, err
}

// reportTakes is takes for reports.
func (d *disturber) reportTakes(in *farmv1.ReportRequest, f fault) bool {
	switch {
	case in.GetFailure() != nil:
		return false
	case f == stale:
		return d.mayAge()
	case f == flipReport:
		return d.maySpoil(in.GetLease().GetTaskId())
	}
	return true
}

// report is one that passes.
type report struct {
	d     *disturber
	to    *passage
	in    *farmv1.ReportRequest
	entry entry
}

// send a report and note the answer.
func (v *report) send(ctx context.Context, in *farmv1.ReportRequest, step, detail string) (*farmv1.ReportResponse, error) {
	e := v.entry
	e.Step, e.Detail, e.Sent = step, detail, seconds(time.Now())
	answer, err := v.to.upstream.Report(ctx, in)
	v.d.journal.write(e.answered(answer.GetOutcome(), answer.GetMessage(), err))
	return answer, err
}

func (v *report) sendStale(ctx context.Context) (*farmv1.ReportResponse, error) {
	defer v.d.aged()
	v.d.hidden.add(v.in.GetLease())
	defer v.d.hidden.remove(v.in.GetLease())
	wait(ctx, leaseTime)
	return v.send(ctx, v.in, stepStale, "")
}

func (v *report) damage(ctx context.Context, random *rand.Rand) (*farmv1.ReportResponse, error) {
	in, detail, err := damagedReport(v.in, random)
	if err != nil {
		return nil, status.Error(codes.Internal, err.Error())
	}
	return v.send(ctx, in, stepDamaged, detail)
}

func (v *report) later(after time.Duration) {
	wait(v.d.life, after)
	ctx, cancel := context.WithTimeout(v.d.life, answerTime)
	defer cancel()
	_, _ = v.send(ctx, v.in, stepCopy, "")
}

// maySpoil tells whether no report of a task was damaged before.
func (d *disturber) maySpoil(task string) bool {
	d.mu.Lock()
	defer d.mu.Unlock()
	if d.spoilt[task] {
		return false
	}
	d.spoilt[task] = true
	return true
}
