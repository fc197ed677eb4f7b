// Package lease decides who works on what: tasks are leased under growing epochs, renewed by
// heartbeats, leased again when a lease runs out, and blamed when they take workers down. It is
// pure: the caller passes the time and serializes calls.
package lease

import (
	"cmp"
	"maps"
	"slices"
	"time"
)

// Limits on what one task may cost before its job is given up.
const (
	// poisonWorkers is the number of distinct workers that a task may fail on or take down.
	poisonWorkers = 3
	// poisonFailures is the number of failures and losses of a task that failed on every worker there is.
	poisonFailures = 3
	// maxHolders bounds copies of a straggling task.
	maxHolders = 2
)

// Ref names a lease: a task under an epoch.
type Ref struct {
	Task  string
	Epoch uint64
}

// holding is one live lease of a task.
type holding struct {
	epoch    uint64
	worker   string
	granted  time.Time
	deadline time.Time
	fraction float64
}

type task struct {
	id       string
	order    uint64
	holders  []holding
	failures map[string]int  // by worker
	lost     map[string]bool // workers lost while holding it
	barred   map[string]bool // workers that must not have it
	evidence string          // latest failure message
	apart    bool            // see PutApart
	silent   time.Time       // when its holder was last heard of, if its lease ran out; zero once leased again
}

// Table holds the open tasks of one job.
type Table struct {
	ttl       time.Duration
	nextEpoch func() uint64
	tasks     map[string]*task
	ordered   []*task // by order, the open ones
	finished  int
	spent     time.Duration // from grant to Done, over finished tasks
	checked   time.Time     // of the last Expire
	deadline  time.Time     // no lease runs out before; zero without leases
	load      load
	linger    time.Duration // see Linger
	again     Again
}

// Again tells of tasks that were leased again after their lease had run out.
type Again struct {
	Tasks   int
	Longest time.Duration // from when the holder was last heard of until the task was leased again
}

// LeasedAgain returns what was leased again since it was called last.
func (t *Table) LeasedAgain() Again {
	again := t.again
	t.again = Again{}
	return again
}

// NewTable returns an empty table. nextEpoch must grow with every call, over all tables and
// restarts.
func NewTable(ttl time.Duration, nextEpoch func() uint64) *Table {
	return &Table{ttl: ttl, nextEpoch: nextEpoch, tasks: make(map[string]*task)}
}

// Put opens a task; lower orders are granted first. A task that is open stays as it is.
func (t *Table) Put(id string, order uint64) { t.put(id, order, false) }

// PutApart opens a task that goes before all others, is never leased together with them, and whose
// failures do not speak against the job: it can be given up.
func (t *Table) PutApart(id string, order uint64) { t.put(id, order, true) }

func (t *Table) put(id string, order uint64, apart bool) {
	if t.tasks[id] != nil {
		return
	}
	added := &task{
		id: id, order: order, apart: apart,
		failures: map[string]int{}, lost: map[string]bool{}, barred: map[string]bool{},
	}
	t.tasks[id] = added
	at, _ := slices.BinarySearchFunc(t.ordered, order, func(k *task, o uint64) int { return cmp.Compare(k.order, o) })
	t.ordered = slices.Insert(t.ordered, at, added)
	t.load.waiting.Add(1)
}

// Bar keeps a worker from getting an open task.
func (t *Table) Bar(id, worker string) {
	if k := t.tasks[id]; k != nil {
		k.barred[worker] = true
	}
}

// Suits tells whether an open task could still be leased to a worker: it is neither barred nor has
// it failed the task.
func (t *Table) Suits(id, worker string) bool {
	k := t.tasks[id]
	return k != nil && !k.barred[worker] && k.failures[worker] == 0
}

// Linger says how long finished work may stay with its worker before it is delivered: nothing
// straggles before that.
func (t *Table) Linger(d time.Duration) { t.linger = d }

// Open is the number of tasks that are not done.
func (t *Table) Open() int { return len(t.tasks) }

// Renew extends a lease. False: the lease is gone, its holder should drop the task.
func (t *Table) Renew(ref Ref, worker string, fraction float64, now time.Time) bool {
	h := t.holding(ref, worker)
	if h == nil {
		return false
	}
	h.deadline = now.Add(t.ttl)
	h.fraction = fraction
	return true
}

// Held tells whether the worker holds this very lease.
func (t *Table) Held(ref Ref, worker string) bool { return t.holding(ref, worker) != nil }

// Granted tells when the worker was granted this lease; false: it does not hold it.
func (t *Table) Granted(ref Ref, worker string) (at time.Time, held bool) {
	if h := t.holding(ref, worker); h != nil {
		return h.granted, true
	}
	return time.Time{}, false
}

func (t *Table) holding(ref Ref, worker string) *holding {
	k := t.tasks[ref.Task]
	if k == nil {
		return nil
	}
	for i := range k.holders {
		if h := &k.holders[i]; h.epoch == ref.Epoch && h.worker == worker {
			return h
		}
	}
	return nil
}

// Done closes a task with all its leases. A task that is not open is no error.
func (t *Table) Done(id string, now time.Time) {
	k := t.tasks[id]
	if k == nil {
		return
	}
	if len(k.holders) > 0 {
		t.finished++
		t.spent += now.Sub(k.holders[0].granted)
	}
	t.remove(k)
}

// Drop closes a task whose result is not wanted any more.
func (t *Table) Drop(id string) {
	if k := t.tasks[id]; k != nil {
		t.remove(k)
	}
}

func (t *Table) remove(k *task) {
	t.setHolders(k, nil)
	t.load.waiting.Add(-1)
	delete(t.tasks, k.id)
	t.ordered = slices.DeleteFunc(t.ordered, func(o *task) bool { return o == k })
}

// Clear drops all tasks and forgets how long such tasks took.
func (t *Table) Clear() {
	clear(t.tasks)
	t.ordered, t.finished, t.spent, t.deadline = nil, 0, 0, time.Time{}
	t.load.clear()
}

// without ends those leases of a task that a function picks, and tells how many.
func (t *Table) without(k *task, picks func(holding) bool) (ended int) {
	before := len(k.holders)
	t.setHolders(k, slices.DeleteFunc(k.holders, picks))
	return before - len(k.holders)
}

func (t *Table) setHolders(k *task, holders []holding) {
	t.load.change(len(k.holders), len(holders))
	k.holders = holders
}

// Release gives a lease back without blame; the task waits again unless another holds it. False: the
// worker did not hold this lease.
func (t *Table) Release(ref Ref, worker string) (held bool) {
	if !t.Held(ref, worker) {
		return false
	}
	t.without(t.tasks[ref.Task], func(h holding) bool { return h.epoch == ref.Epoch && h.worker == worker })
	return true
}

// ReleaseWorker gives all leases of a worker back without blame, and tells how many those were.
func (t *Table) ReleaseWorker(worker string) (released int) {
	for _, k := range t.ordered {
		released += t.without(k, func(h holding) bool { return h.worker == worker })
	}
	return released
}

// Fail gives a lease back because the worker could not do the task. False: the worker did not hold
// this lease, nothing changed.
func (t *Table) Fail(ref Ref, worker, evidence string) bool {
	if !t.Release(ref, worker) {
		return false
	}
	k := t.tasks[ref.Task]
	k.failures[worker]++
	k.evidence = evidence
	return true
}

// Expired is a lease that ran out.
type Expired struct {
	Ref
	Worker string
}

// Expire ends the leases whose time is over. When it was not called for a whole time to live, the
// coordinator itself stood still (a suspended machine) and heard no heartbeat: then all leases get
// one more time to live instead.
func (t *Table) Expire(now time.Time) []Expired {
	slept := !t.checked.IsZero() && now.Sub(t.checked) >= t.ttl
	t.checked = now
	if slept {
		t.extend(now)
		return nil
	}
	if t.deadline.IsZero() || now.Before(t.deadline) {
		return nil
	}
	var expired []Expired
	t.deadline = time.Time{}
	for _, k := range t.ordered {
		t.without(k, func(h holding) bool {
			if now.Before(h.deadline) {
				t.expectDeadline(h.deadline)
				return false
			}
			expired = append(expired, Expired{Ref{k.id, h.epoch}, h.worker})
			k.silent = h.deadline.Add(-t.ttl)
			return true
		})
		if len(k.holders) > 0 {
			k.silent = time.Time{}
		}
	}
	return expired
}

// expectDeadline keeps the time at which Expire has to look at the leases again: renewals only move
// theirs on.
func (t *Table) expectDeadline(deadline time.Time) {
	if t.deadline.IsZero() || deadline.Before(t.deadline) {
		t.deadline = deadline
	}
}

// NoteLost notes that a worker was lost while it held a task. A lease that ran out although its
// worker is alive was dropped, which says nothing about the task.
func (t *Table) NoteLost(id, worker string) {
	if k := t.tasks[id]; k != nil {
		k.lost[worker] = true
	}
}

// Forgive takes back all that NoteLost noted of a worker: it was heard of again, so no task took it
// down.
func (t *Table) Forgive(worker string) {
	for _, k := range t.ordered {
		delete(k.lost, worker)
	}
}

func (t *Table) extend(now time.Time) {
	for _, k := range t.ordered {
		for i := range k.holders {
			k.holders[i].deadline = now.Add(t.ttl)
		}
	}
}

// Poison is a task that must not be tried again.
type Poison struct {
	Task         string
	Failed, Lost []string // distinct workers that failed on it, and others that were lost with it
	Failures     int      // how often it failed
	Evidence     string   // what the last that failed said
}

// Poisoned returns a task, not put apart, that must not be tried again: it failed on, or was lost with,
// three distinct workers; or it failed on every worker of the crew, the workers that could have it at the
// moment, and failures and losses are three in all. So two workers that both fail it are asked once more,
// and a single one twice more, before its job is given up.
func (t *Table) Poisoned(crew []string) (Poison, bool) {
	for _, k := range t.ordered {
		if k.apart {
			continue
		}
		p := k.poison()
		distinct := len(p.Failed) + len(p.Lost)
		all := p.Failures + len(p.Lost)
		if distinct >= poisonWorkers || all >= poisonFailures && k.failedOnAll(crew) {
			return p, true
		}
	}
	return Poison{}, false
}

// poison says what speaks against a task.
func (k *task) poison() Poison {
	p := Poison{Task: k.id, Failed: slices.Sorted(maps.Keys(k.failures)), Evidence: k.evidence}
	for _, n := range k.failures {
		p.Failures += n
	}
	for _, worker := range slices.Sorted(maps.Keys(k.lost)) {
		if k.failures[worker] == 0 {
			p.Lost = append(p.Lost, worker)
		}
	}
	return p
}

// failedOnAll tells whether a task failed on each of some workers, of which there must be one.
func (k *task) failedOnAll(crew []string) bool {
	return len(crew) > 0 && !slices.ContainsFunc(crew, func(worker string) bool { return k.failures[worker] == 0 })
}

// CountHeld adds the number of leases that each worker holds.
func (t *Table) CountHeld(held map[string]int) {
	for _, k := range t.ordered {
		for _, h := range k.holders {
			held[h.worker]++
		}
	}
}

// Fraction is the progress of open tasks, in tasks: for each the furthest holder.
func (t *Table) Fraction() float64 {
	sum := 0.0
	for _, k := range t.ordered {
		best := 0.0
		for _, h := range k.holders {
			best = max(best, h.fraction)
		}
		sum += best
	}
	return sum
}
