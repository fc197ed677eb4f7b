package coordinator

import (
	"context"
	"path/filepath"
	"slices"
	"strings"
	"testing"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/bolt"
	"metrofarm/services/internal/tally"
)

// What is counted is taken back here step by step, in the one order that a test is about: nothing runs
// beside it.

// Workers of the coordinators of openRun.
const (
	workerA = "w-aaaaaaaaaaaa"
	workerB = "w-bbbbbbbbbbbb"
	workerC = "w-cccccccccccc"
	workerD = "w-dddddddddddd"
	workerE = "w-eeeeeeeeeeee"
)

// openRun is job-a, queued and without tasks, of a coordinator that does no housekeeping and has five
// workers of version v.
func openRun(t *testing.T, change func(*Options)) *run {
	t.Helper()
	db, err := bolt.Open(filepath.Join(t.TempDir(), "metrofarm.db"), nil)
	check := func(err error) {
		t.Helper()
		if err != nil {
			t.Fatal(err)
		}
	}
	check(err)
	t.Cleanup(func() { check(db.Close()) })
	backend, err := dir.Open(t.TempDir())
	check(err)
	options := Options{
		Store: db, Blobs: blob.New(backend), CheckOneIn: -1,
		LeaseTTL: time.Hour, OwnershipTTL: time.Hour, CheckPatience: time.Hour,
	}
	if change != nil {
		change(&options)
	}
	c, err := New(t.Context(), options)
	check(err)
	for _, letter := range []string{"a", "b", "c", "d", "e"} {
		_, err := c.Register(t.Context(), &farmv1.RegisterRequest{
			Name: letter, Version: "v", Threads: 1, Instance: strings.Repeat(letter, 32),
		})
		check(err)
	}
	stored, _, err := db.CreateJob(t.Context(), c.claim(), store.Record{ID: "job-a", State: job.Queued, CreatedAt: time.Now()}, "", "")
	check(err)
	r := c.newRun(stored, 1)
	c.insert(r)
	return r
}

// rendering is a job of two segments a round whose rounds 0 and 1 can be rendered. It is locked.
func rendering(t *testing.T) *run {
	t.Helper()
	r := openRun(t, nil)
	r.mu.Lock()
	t.Cleanup(r.mu.Unlock)
	r.spec = &jobv1.ResolvedSpec{
		Integrator: jobv1.Integrator_INTEGRATOR_PATH, Width: 16, Height: 8, GroupSize: 64,
		BlocksPerSegment: 1, Unit: 2, RoundSizes: []uint64{2, 3, 4}, WorkerVersion: "v",
	}
	r.rec.State = job.Rendering
	r.state = render.New(r.spec, 16*8, [2]tally.Sums{}, nil)
	r.openTasks()
	return r
}

// batchOf is one segment, without light.
func batchOf(r *run, number, segment int, digest uint64) *merge.Batch {
	return &merge.Batch{Job: r.id, Round: number, Segments: []merge.Segment{{
		Entry:  round.Entry{Segment: segment, Mark: round.Mark{Digest: digest}},
		Counts: tally.Counts{Mutations: 64 * r.spec.GetRoundSizes()[number]},
	}}}
}

// closeFirst closes the first open round, which is complete.
func closeFirst(t *testing.T, r *run) {
	t.Helper()
	folded := r.state.Snapshot()
	if err := folded.Fold(); err != nil {
		t.Fatal(err)
	}
	point, err := folded.Evaluate()
	if err != nil {
		t.Fatal(err)
	}
	folded.Points = append(folded.Points, point)
	r.state.Adopt(folded)
}

// expectCounted checks which of a round's segments are counted.
func expectCounted(t *testing.T, r *run, number int, want ...int) {
	t.Helper()
	var counted []int
	for segment := range r.state.Expected() {
		if _, known := r.state.Counted(number, segment); known {
			counted = append(counted, segment)
		}
	}
	if !slices.Equal(counted, want) {
		t.Errorf("segments %v of round %d are counted, want %v", counted, number, want)
	}
}

func expectOpen(t *testing.T, r *run, task string) {
	t.Helper()
	if _, open := r.tasks[task]; !open {
		t.Errorf("task %s is not open, but %v", task, r.tasks)
	}
}

// expectExcluded checks who is, of all workers.
func expectExcluded(t *testing.T, r *run, want ...string) {
	t.Helper()
	for _, worker := range []string{workerA, workerB, workerC, workerD, workerE} {
		if got := r.c.isExcluded(worker); got != slices.Contains(want, worker) {
			t.Errorf("worker %s excluded: %v", worker, got)
		}
	}
}

func expectUnwound(t *testing.T, r *run, want uint64) {
	t.Helper()
	if r.rec.Unwound != want {
		t.Errorf("rounds were thrown away %d times, want %d", r.rec.Unwound, want)
	}
}

// expectContested checks the round that the record tells of; -1: none.
func expectContested(t *testing.T, r *run, want int) {
	t.Helper()
	got := -1
	if r.rec.Contested != nil {
		got = *r.rec.Contested
	}
	if got != want {
		t.Errorf("the record says that round %d is contested, want %d", got, want)
	}
}

// The worker that a held batch proves wrong has a contested segment in the film: its round goes, and the
// batch that was right with it.
func TestAHeldBatchGoesWithItsRound(t *testing.T) {
	r := rendering(t)
	r.count(batchOf(r, 0, 0, 1), workerB)
	r.compare(segmentKey{0, 0}, workerC, round.Mark{Digest: 2})
	key := segmentKey{1, 0}
	if !r.hold(worker{id: workerA}, batchOf(r, 1, 0, 7), []segmentKey{key}) {
		t.Fatal("there is no room for a batch")
	}
	held := r.checks.of[key]
	if complaint := r.testify(held, key, workerB, round.Mark{Digest: 8}); complaint == "" {
		t.Error("nothing is wrong with who contradicts another")
	}
	r.testify(held, key, workerD, round.Mark{Digest: 7})
	expectCounted(t, r, 0)
	expectCounted(t, r, 1)
	if len(r.checks.held)+len(r.checks.of) > 0 {
		t.Errorf("held: %v", r.checks.held)
	}
	expectExcluded(t, r, workerB)
	expectUnwound(t, r, 1)
	expectOpen(t, r, "job-a/u1/r0/s0")
	expectOpen(t, r, "job-a/u1/r1/s0")
}

func TestAllContestedRoundsAreThrownAwayTogether(t *testing.T) {
	r := rendering(t)
	r.count(batchOf(r, 0, 0, 1), workerA)
	r.count(batchOf(r, 1, 0, 1), workerB)
	r.compare(segmentKey{0, 0}, workerC, round.Mark{Digest: 2})
	later := segmentKey{1, 0}
	r.compare(later, workerD, round.Mark{Digest: 2})
	r.testify(r.checks.of[later], later, workerE, round.Mark{Digest: 2})
	expectCounted(t, r, 0)
	expectCounted(t, r, 1)
	if len(r.checks.held) > 0 {
		t.Errorf("held: %v", r.checks.held)
	}
	expectContested(t, r, 0)
	expectUnwound(t, r, 1)
	expectOpen(t, r, "job-a/u1/r0/s0")
	expectExcluded(t, r, workerB)
}

// disputeAhead has two workers disagree about a counted segment of round 1.
func disputeAhead(r *run) {
	r.count(batchOf(r, 1, 0, 1), workerA)
	r.compare(segmentKey{1, 0}, workerB, round.Mark{Digest: 2})
}

func TestADisputeBeyondTheLastRoundIsDropped(t *testing.T) {
	r := rendering(t)
	disputeAhead(r)
	r.dirty = false
	r.decideLast(round.StopFinished)
	expectCounted(t, r, 1)
	expectUnwound(t, r, 0)
	expectContested(t, r, 1)
	if r.contested() || !r.dirty || r.checks.unchecked[workerA] != 0 || len(r.checks.by) > 0 {
		t.Errorf("contested %v, to be kept %v, unchecked %v, counted by %v", r.contested(), r.dirty, r.checks.unchecked, r.checks.by)
	}
	expectOpen(t, r, "job-a/r0/s0")
	for id := range r.tasks {
		if strings.HasPrefix(id, "job-a/r1/") {
			t.Errorf("task %s is open", id)
		}
	}
}

// Nobody decides about them any more, so their parties' work is checked.
func TestPartiesToADroppedDisputeAreDoubted(t *testing.T) {
	r := rendering(t)
	disputeAhead(r)
	key := segmentKey{1, 1}
	r.hold(worker{id: workerC}, batchOf(r, 1, 1, 1), []segmentKey{key})
	r.testify(r.checks.of[key], key, workerD, round.Mark{Digest: 2})
	r.decideLast(round.StopFinished)
	for _, id := range []string{workerA, workerB, workerC, workerD, workerE} {
		if got := r.checks.doubted[id]; got != (id != workerE) {
			t.Errorf("worker %s doubted: %v", id, got)
		}
	}
}

func TestARecordOlderThanTheOpenRoundsTakesNothingOfTheClosed(t *testing.T) {
	zero := 0
	closed := func(t *testing.T) *run {
		r := rendering(t)
		r.count(batchOf(r, 0, 0, 1), workerA)
		r.count(batchOf(r, 0, 1, 1), workerA)
		closeFirst(t, r)
		r.rec.Contested = &zero
		return r
	}
	expect := func(t *testing.T, r *run) {
		t.Helper()
		expectCounted(t, r, 1)
		expectUnwound(t, r, 1)
		if r.state.Closed != 1 || len(r.state.Points) != 1 || r.state.Points[0].Round != 0 {
			t.Errorf("%d rounds are closed, points %+v", r.state.Closed, r.state.Points)
		}
	}
	t.Run("canceled", func(t *testing.T) {
		r := closed(t)
		disputeAhead(r)
		r.end(job.Canceled, "")
		expect(t, r)
	})
	t.Run("taken over", func(t *testing.T) {
		r := closed(t)
		r.count(batchOf(r, 1, 0, 1), workerA)
		saved := checkpoint.Checkpoint{State: r.state.Snapshot()}
		r.state = nil
		if err := r.load(saved); err != nil {
			t.Fatal(err)
		}
		expect(t, r)
	})
}

// A checkpoint that was begun before a dispute has what was taken back since.
func TestACheckpointOfBeforeADisputeDoesNotEndIt(t *testing.T) {
	r := rendering(t)
	unlocked := func(f func()) {
		r.mu.Unlock()
		defer r.mu.Lock()
		f()
	}
	var before draft
	r.count(batchOf(r, 1, 0, 1), workerA)
	unlocked(func() { before = r.draft() })
	r.compare(segmentKey{1, 0}, workerB, round.Mark{Digest: 2})
	r.decideLast(round.StopFinished)
	unlocked(func() { r.swing(before, 0, 0) })
	expectContested(t, r, 1)
	if !r.dirty {
		t.Error("no other checkpoint follows")
	}
	unlocked(func() { r.swing(r.draft(), 0, 0) })
	expectContested(t, r, -1)
}

// Who delivered what is counted is not known after a takeover: it must not confirm itself.
func TestWhatWasCountedBeforeATakeoverIsRenderedAgain(t *testing.T) {
	r := rendering(t)
	r.state.Commit(batchOf(r, 0, 0, 1))
	r.state.Commit(batchOf(r, 0, 1, 1))
	if complaint := r.compare(segmentKey{0, 0}, workerA, round.Mark{Digest: 2}); complaint == "" {
		t.Error("nothing is wrong with who contradicts another")
	}
	expectCounted(t, r, 0)
	expectContested(t, r, 0)
	expectUnwound(t, r, 1)
	expectExcluded(t, r)
	expectOpen(t, r, "job-a/u1/r0/s0")
	for id := range r.tasks {
		if strings.HasSuffix(id, "/check") {
			t.Errorf("task %s is open", id)
		}
	}
	for _, test := range []struct {
		worker  string
		segment int
		checked bool
	}{{workerA, 0, true}, {workerA, 1, true}, {workerB, 0, true}, {workerB, 1, false}} {
		selected := r.toCheck(worker{id: test.worker}, batchOf(r, 0, test.segment, 1))
		if (len(selected) > 0) != test.checked {
			t.Errorf("worker %s, segment %d: %v is checked", test.worker, test.segment, selected)
		}
	}
	again := segmentKey{0, 0}
	r.hold(worker{id: workerB}, batchOf(r, 0, 0, 1), []segmentKey{again})
	r.testify(r.checks.of[again], again, workerA, round.Mark{Digest: 2})
	r.testify(r.checks.of[again], again, workerC, round.Mark{Digest: 2})
	expectExcluded(t, r, workerB)
}

// A job that is lost while a change of it is stored is not available here; the store is.
func TestAChangeOfALostJobIsNoOutage(t *testing.T) {
	r := openRun(t, nil)
	r.epoch = 0 // another one owns it by now
	_, err := r.c.Pause(context.Background(), r.id)
	expectOnlyTheJobUnavailable(t, err)
}
