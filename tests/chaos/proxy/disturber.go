package main

import (
	"context"
	"math/rand/v2"
	"sync"
	"time"

	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

const (
	// leaseTime is longer than a lease lives without heartbeat.
	leaseTime = 14 * time.Second
	// patience bounds the wait for another worker to deliver what a stale delivery has.
	patience = 30 * time.Second
	// reorderPatience bounds the wait for a later delivery.
	reorderPatience = 5 * time.Second
	// answerTime bounds a message that no worker waits for.
	answerTime = 30 * time.Second
)

// disturber disturbs what passes, on all ways.
type disturber struct {
	life     context.Context // of what goes on after the worker has its answer
	schedule *schedule
	journal  *journal
	hidden   leaseSet
	passed   *waiters

	mu      sync.Mutex
	damaged map[string]map[place]bool // by job: no segment twice
	spoilt  map[string]bool           // tasks whose report was damaged: none twice
	forgery *place                    // still to be done
	aging   bool                      // a message becomes stale: one at a time, as its job waits for it
}

func newDisturber(life context.Context, s *schedule, forgery *place, j *journal) *disturber {
	return &disturber{
		life: life, schedule: s, journal: j, forgery: forgery, passed: newWaiters(),
		damaged: make(map[string]map[place]bool), spoilt: make(map[string]bool),
	}
}

// delivery is one that passes.
type delivery struct {
	d      *disturber
	to     *passage
	parcel parcel
	entry  entry
	random *rand.Rand
}

func (d *disturber) deliver(ctx context.Context, to *passage, x parcel) (*farmv1.DeliverResponse, error) {
	segment, forge := d.mayForge(x)
	number, f, random := d.schedule.delivery(func(f fault) bool { return !forge && d.takes(x, f) })
	batch := x.header.GetBatch()
	e := entry{
		Number: number, Call: "deliver", Fault: string(f), Upstream: to.name,
		Job: batch.GetJobId(), Worker: x.header.GetWorkerId(), Round: batch.GetRound(),
	}
	for _, s := range batch.GetSegments() {
		e.Segments = append(e.Segments, s.GetSegment())
	}
	v := &delivery{d: d, to: to, parcel: x, entry: e, random: random}
	if forge {
		v.entry.Fault = "forge"
		return v.forge(ctx, segment)
	}
	return v.pass(ctx, f)
}

// takes tells whether a delivery can have a fault. If so, it has.
func (d *disturber) takes(x parcel, f fault) bool {
	switch {
	case f == stale:
		return d.mayAge()
	case f == flipState && !x.hasStates():
		return false
	case f.damages():
		return d.mayDamage(x)
	}
	return true
}

// mayAge tells whether no other message becomes stale now; the caller calls aged when this one did.
func (d *disturber) mayAge() bool {
	d.mu.Lock()
	defer d.mu.Unlock()
	if d.aging {
		return false
	}
	d.aging = true
	return true
}

func (d *disturber) aged() {
	d.mu.Lock()
	defer d.mu.Unlock()
	d.aging = false
}

// mayDamage tells whether nothing of a parcel was damaged before: a segment that fails on several
// workers is taken to be at fault itself.
func (d *disturber) mayDamage(x parcel) bool {
	d.mu.Lock()
	defer d.mu.Unlock()
	done := d.damaged[x.header.GetBatch().GetJobId()]
	if done == nil {
		done = make(map[place]bool)
		d.damaged[x.header.GetBatch().GetJobId()] = done
	}
	for _, p := range x.places() {
		if done[p] {
			return false
		}
	}
	for _, p := range x.places() {
		done[p] = true
	}
	return true
}

// mayForge tells, once, that this is the parcel to be forged, and of which segment.
func (d *disturber) mayForge(x parcel) (segment uint32, forge bool) {
	d.mu.Lock()
	defer d.mu.Unlock()
	for _, p := range x.places() {
		if d.forgery != nil && p == *d.forgery {
			d.forgery = nil
			return p.segment, true
		}
	}
	return 0, false
}

// pass sends a delivery on, with a fault.
func (v *delivery) pass(ctx context.Context, f fault) (*farmv1.DeliverResponse, error) {
	switch {
	case f.damages():
		return v.damage(ctx, f)
	case f == repeat:
		answer, err := v.send(ctx, v.parcel, stepIntact, "")
		if err == nil {
			_, _ = v.send(ctx, v.parcel, stepCopy, "") // the journal has the answer
		}
		return answer, err
	case f == repeatLater:
		answer, err := v.send(ctx, v.parcel, stepIntact, "")
		if err == nil {
			v.later(time.Duration(2000+v.random.IntN(10000)) * time.Millisecond)
		}
		return answer, err
	case f == delay:
		wait(ctx, time.Duration(500+v.random.IntN(4000))*time.Millisecond)
	case f == reorder:
		v.d.passed.await(ctx, reorderPatience)
	case f == stale:
		return v.sendStale(ctx)
	case f == breakOff:
		return v.breakOff(ctx)
	}
	return v.send(ctx, v.parcel, stepIntact, "")
}

// send delivers a parcel and notes the answer.
func (v *delivery) send(ctx context.Context, x parcel, step, detail string) (*farmv1.DeliverResponse, error) {
	e := v.entry
	e.Step, e.Detail, e.Sent = step, detail, seconds(time.Now())
	answer, err := v.to.send(ctx, x)
	v.d.journal.write(e.answered(answer.GetOutcome(), answer.GetMessage(), err))
	if err == nil && step == stepIntact {
		v.d.passed.note(e.Worker, e.Job, x.places())
	}
	return answer, err
}

// later repeats the delivery when the worker has its answer long since.
func (v *delivery) later(after time.Duration) {
	go func() {
		wait(v.d.life, after)
		ctx, cancel := context.WithTimeout(v.d.life, answerTime)
		defer cancel()
		_, _ = v.send(ctx, v.parcel, stepCopy, after.String()+" later")
	}()
}

// damage tells the worker what was said of the damaged delivery: it forgets the work.
func (v *delivery) damage(ctx context.Context, f fault) (*farmv1.DeliverResponse, error) {
	x, detail, err := damaged(v.parcel, f, v.random)
	if err != nil {
		return nil, status.Error(codes.Internal, err.Error())
	}
	return v.send(ctx, x, stepDamaged, detail)
}

func (v *delivery) forge(ctx context.Context, segment uint32) (*farmv1.DeliverResponse, error) {
	x, err := forged(v.parcel, segment)
	if err != nil {
		return nil, status.Error(codes.Internal, err.Error())
	}
	return v.send(ctx, x, stepForged, "")
}

// sendStale lets the leases of a delivery run out, and sends it when another worker has rendered a
// part of it.
func (v *delivery) sendStale(ctx context.Context) (*farmv1.DeliverResponse, error) {
	defer v.d.aged()
	for _, s := range v.parcel.header.GetBatch().GetSegments() {
		v.d.hidden.add(s.GetLease())
		defer v.d.hidden.remove(s.GetLease())
	}
	wait(ctx, leaseTime)
	v.d.passed.awaitOther(ctx, v.entry.Worker, v.entry.Job, v.parcel.places(), patience-leaseTime)
	return v.send(ctx, v.parcel, stepStale, "")
}

// breakOff ends the stream early; the worker does not know, and repeats the call.
func (v *delivery) breakOff(ctx context.Context) (*farmv1.DeliverResponse, error) {
	e := v.entry
	e.Step, e.Sent = stepBrokenOff, seconds(time.Now())
	if err := v.to.sendPart(ctx, v.parcel, v.random.IntN(2)); err != nil {
		e.Message = err.Error()
	}
	v.d.journal.write(e)
	return nil, status.Error(codes.Unavailable, "the stream broke off")
}

func wait(ctx context.Context, duration time.Duration) {
	select {
	case <-ctx.Done():
	case <-time.After(duration):
	}
}
