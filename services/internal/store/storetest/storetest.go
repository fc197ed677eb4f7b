// Package storetest is the conformance suite of store.Store.
package storetest

import (
	"context"
	"errors"
	"fmt"
	"math"
	"reflect"
	"testing"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Site is a place where one store is kept.
type Site struct {
	// Open opens the store; opening it again after Close sees what was stored.
	Open func(t *testing.T) store.Store
	// Pass lets time pass for the store's clock.
	Pass func(d time.Duration)
}

// TTL of the suite's leases: longer than a loaded machine takes for a few calls.
const TTL = time.Minute

// Run runs the suite; each test has a new site.
func Run(t *testing.T, newSite func(t *testing.T) Site) {
	for name, test := range map[string]func(*testing.T, Site){
		"former owners are fenced off":       testFencing,
		"an older update changes nothing":    testRevisions,
		"what is not JSON is refused":        testNotJSON,
		"calls can be repeated":              testRepetition,
		"jobs survive reopening":             testDurability,
		"idempotency keys":                   testKeys,
		"events are kept in bounds":          testEvents,
		"delete leaves nothing":              testDelete,
		"missing jobs are not found":         testMissing,
		"jobs come newest first, by page":    testOrder,
		"the id of the farm":                 testFarm,
		"one of many begins a farm":          testFarmRace,
		"leases run out":                     testExpiry,
		"beats renew leases":                 testRenewal,
		"a lease that nobody took goes on":   testLateRenewal,
		"changes of jobs at rest are told":   testChanges,
		"release and leave":                  testRelease,
		"ended jobs wait for nobody":         testSettled,
		"members come and go":                testMembers,
		"one of many acquires":               testRace,
		"one of many creates under each key": testKeyRace,
		"sequences come with their jobs":     testSequence,
		"sequences can be created again":     testSequenceRepetition,
		"sequences end with their last job":  testSequenceEnd,
		"sequences come newest first":        testSequenceOrder,
		"one of many creates a sequence":     testSequenceRace,
	} {
		t.Run(name, func(t *testing.T) { test(t, newSite(t)) })
	}
}

func record(id string) store.Record {
	return store.Record{
		ID: id, State: job.Queued, Request: job.Request{Scene: "s", Entry: "e"},
		CreatedAt: time.Unix(1000, 0).UTC(),
	}
}

func claim(owner string) store.Claim { return store.Claim{Owner: owner, TTL: TTL} }

// member says where the member of a name is.
func member(id string) store.Member {
	return store.Member{ID: id, REST: "http://" + id, Farm: id + ":7070", Usage: map[string]float64{"ada": 1.5, "": 2}, Jobs: map[string]int{"ada": 3}}
}

func same(a, b store.Member) bool { return reflect.DeepEqual(a, b) }

func create(t *testing.T, s store.Store, owner, id, key, fingerprint string) (store.Record, bool) {
	t.Helper()
	r, created, err := s.CreateJob(context.Background(), claim(owner), record(id), key, fingerprint)
	if err != nil {
		t.Fatal(err)
	}
	return r, created
}

func acquire(t *testing.T, s store.Store, owner, id string) (store.Record, uint64) {
	t.Helper()
	r, epoch, err := s.Acquire(context.Background(), claim(owner), id)
	if err != nil {
		t.Fatal(err)
	}
	return r, epoch
}

func beat(t *testing.T, s store.Store, id string, held map[string]uint64) []string {
	t.Helper()
	lost, err := s.Beat(context.Background(), member(id), TTL, held)
	if err != nil {
		t.Fatal(err)
	}
	return lost
}

func get(t *testing.T, s store.Store, id string) store.Owned {
	t.Helper()
	j, err := s.Job(context.Background(), id)
	if err != nil {
		t.Fatal(err)
	}
	return j
}

func update(t *testing.T, s store.Store, epoch uint64, r store.Record, events ...job.Event) {
	t.Helper()
	if err := s.UpdateJob(context.Background(), epoch, r, events); err != nil {
		t.Fatal(err)
	}
}

func waiting(t *testing.T, s store.Store) []string {
	t.Helper()
	ids, err := s.Waiting(context.Background())
	if err != nil {
		t.Fatal(err)
	}
	return ids
}

func check(t *testing.T, err error) {
	t.Helper()
	if err != nil {
		t.Fatal(err)
	}
}

func testFencing(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "old", "a", "", "")
	site.Pass(2 * TTL)
	if _, epoch := acquire(t, s, "new", "a"); epoch <= 1 {
		t.Fatalf("epoch %d after 1", epoch)
	}
	r.State, r.Revision = job.Failed, 1
	if err := s.UpdateJob(ctx, 1, r, []job.Event{{Sequence: 1}}); !errors.Is(err, store.ErrFenced) {
		t.Errorf("UpdateJob: %v", err)
	}
	if err := s.Release(ctx, 1, "a"); !errors.Is(err, store.ErrFenced) {
		t.Errorf("Release: %v", err)
	}
	if err := s.DeleteJob(ctx, 1, "a"); !errors.Is(err, store.ErrFenced) {
		t.Errorf("DeleteJob: %v", err)
	}
	check(t, s.Leave(ctx, "old", map[string]uint64{"a": 1}))
	beat(t, s, "new", nil)
	if j := get(t, s, "a"); j.State != job.Queued || j.Owner.ID != "new" {
		t.Errorf("job after fenced calls: %+v", j)
	}
	if events, _ := s.Events(ctx, "a", 0); len(events) != 0 {
		t.Errorf("events of a fenced call: %+v", events)
	}
	if lost := beat(t, s, "old", map[string]uint64{"a": 1}); len(lost) != 1 || lost[0] != "a" {
		t.Errorf("lost %v", lost)
	}
}

func testRevisions(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "m", "a", "", "")
	r.Revision, r.State = 2, job.Rendering
	update(t, s, 1, r, job.Event{Sequence: 1})
	late := r
	late.Revision, late.State = 1, job.Inspecting
	if err := s.UpdateJob(ctx, 1, late, []job.Event{{Sequence: 2}}); !errors.Is(err, store.ErrFenced) {
		t.Errorf("an older update: %v", err)
	}
	if j := get(t, s, "a"); j.State != job.Rendering {
		t.Errorf("state %s", j.State)
	}
	if events, _ := s.Events(ctx, "a", 0); len(events) != 1 {
		t.Errorf("events %+v", events)
	}
}

func testRepetition(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	first, _ := create(t, s, "m", "a", "key", "one")
	for _, key := range []string{"key", ""} {
		again, created, err := s.CreateJob(ctx, claim("m"), record("a"), key, "one")
		if err != nil || !created || again.Number != first.Number {
			t.Errorf("created again with key %q: %+v %v %v", key, again, created, err)
		}
	}
	if second, _ := create(t, s, "m", "b", "", ""); second.Number != first.Number+1 {
		t.Errorf("number %d after %d", second.Number, first.Number)
	}
	r := first
	r.Revision = 1
	for range 2 {
		update(t, s, 1, r, job.Event{Sequence: 1}, job.Event{Sequence: 2})
	}
	r.Revision = 2 // as after an update whose success was not told
	update(t, s, 1, r, job.Event{Sequence: 1}, job.Event{Sequence: 2}, job.Event{Sequence: 3})
	if events, _ := s.Events(ctx, "a", 0); len(events) != 3 {
		t.Errorf("events of repeated updates: %+v", events)
	}
	_, epoch := acquire(t, s, "m", "a")
	if _, again := acquire(t, s, "m", "a"); again <= epoch {
		t.Errorf("epoch %d after %d", again, epoch)
	}
}

func testDurability(t *testing.T, site Site) {
	ctx := context.Background()
	s := site.Open(t)
	r, _ := create(t, s, "m", "a", "", "")
	r.State, r.Checkpoint, r.Sequence, r.Revision = job.Rendering, "checkpoint-a-1", 7, 1
	update(t, s, 1, r, job.Event{Sequence: 7, Kind: "state"})
	check(t, s.Close())
	site.Pass(2 * TTL)
	s = site.Open(t)
	defer s.Close()
	again, epoch := acquire(t, s, "n", "a")
	if epoch != 2 || again.State != job.Rendering || again.Checkpoint != r.Checkpoint {
		t.Fatalf("epoch %d, job %+v", epoch, again)
	}
	if events, _ := s.Events(ctx, "a", 0); len(events) != 1 || events[0].Sequence != 7 || events[0].Kind != "state" {
		t.Fatalf("events %+v", events)
	}
}

func testKeys(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	first, created := create(t, s, "m", "a", "key", "one")
	if !created || first.ID != "a" {
		t.Fatalf("first: %+v %v", first, created)
	}
	again, created := create(t, s, "n", "b", "key", "one")
	if created || again.ID != "a" || again.Number != first.Number {
		t.Fatalf("repeated: %+v %v", again, created)
	}
	if _, _, err := s.CreateJob(ctx, claim("m"), record("c"), "key", "two"); !errors.Is(err, store.ErrKeyReused) {
		t.Fatalf("reused: %v", err)
	}
	if _, created := create(t, s, "m", "d", "", "one"); !created {
		t.Fatal("an empty key matched")
	}
	if _, err := s.Job(ctx, "c"); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("a refused job is there: %v", err)
	}
}

func testEvents(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "m", "a", "", "")
	const total = store.MaxEvents + 10
	const batch = 58 // a divisor
	for i := uint64(1); i <= total; i += batch {
		var events []job.Event
		for sequence := i; sequence < i+batch; sequence++ {
			events = append(events, job.Event{Sequence: sequence, Kind: "round"})
		}
		r.Revision++
		update(t, s, 1, r, events...)
	}
	events, err := s.Events(ctx, "a", 0)
	if err != nil || len(events) != store.MaxEvents || events[len(events)-1].Sequence != total {
		t.Fatalf("%d events, error %v", len(events), err)
	}
	if tail, _ := s.Events(ctx, "a", total-3); len(tail) != 3 || tail[0].Sequence != total-2 {
		t.Fatalf("tail %+v", tail)
	}
	if none, err := s.Events(ctx, "a", ^uint64(0)); err != nil || len(none) != 0 {
		t.Fatalf("after the last possible event: %+v, error %v", none, err)
	}
}

func testDelete(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "m", "a", "key", "one")
	r.Revision = 1
	update(t, s, 1, r, job.Event{Sequence: 1})
	check(t, s.DeleteJob(ctx, 1, "a"))
	if events, _ := s.Events(ctx, "a", 0); len(events) != 0 {
		t.Errorf("events left: %d", len(events))
	}
	if jobs, _ := s.Jobs(ctx, 0, 10); len(jobs) != 0 {
		t.Errorf("jobs left: %+v", jobs)
	}
	site.Pass(2 * TTL)
	if ids := waiting(t, s); len(ids) != 0 {
		t.Errorf("waiting: %v", ids)
	}
	if _, created := create(t, s, "m", "b", "key", "two"); !created {
		t.Error("the key was left")
	}
}

func testMissing(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	_, jobErr := s.Job(ctx, "a")
	_, _, acquireErr := s.Acquire(ctx, claim("m"), "a")
	for name, err := range map[string]error{
		"UpdateJob": s.UpdateJob(ctx, 1, record("a"), nil),
		"DeleteJob": s.DeleteJob(ctx, 1, "a"),
		"Release":   s.Release(ctx, 1, "a"),
		"Job":       jobErr, "Acquire": acquireErr,
	} {
		if !errors.Is(err, job.ErrNotFound) {
			t.Errorf("%s: %v", name, err)
		}
	}
	if lost := beat(t, s, "m", map[string]uint64{"a": 1}); len(lost) != 1 {
		t.Errorf("lost %v", lost)
	}
}

func testOrder(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	const total = 12
	for i := range total {
		create(t, s, "m", fmt.Sprintf("job-%d", 100-i), "", "")
	}
	var listed []store.Owned
	for before := uint64(0); ; {
		page, err := s.Jobs(ctx, before, 5)
		check(t, err)
		listed = append(listed, page...)
		if len(page) < 5 {
			break
		}
		before = page[len(page)-1].Number
	}
	if len(listed) != total {
		t.Fatalf("%d jobs", len(listed))
	}
	for i, j := range listed {
		if want := fmt.Sprintf("job-%d", 100-total+1+i); j.ID != want {
			t.Errorf("job %d is %s, not %s", i, j.ID, want)
		}
	}
}

func changes(t *testing.T, s store.Store, mark string) ([]store.Change, string) {
	t.Helper()
	found, next, err := s.Changes(context.Background(), mark)
	check(t, err)
	return found, next
}

func testChanges(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	none, begin := changes(t, s, "")
	rest := func(id string) store.Record {
		r, _ := create(t, s, "m", id, "", "")
		r.State, r.Revision = job.Done, 1
		update(t, s, 1, r)
		check(t, s.Release(ctx, 1, id))
		return r
	}
	refined := rest("a")
	rest("b")
	quiet, mark := changes(t, s, begin)
	if len(none)+len(quiet) != 0 {
		t.Errorf("%v and %v before anything happened to a job at rest", none, quiet)
	}
	_, epoch := acquire(t, s, "m", "a")
	refined.State, refined.Revision = job.Rendering, 2
	update(t, s, epoch, refined)
	refined.Revision++
	update(t, s, epoch, refined)
	_, epoch = acquire(t, s, "n", "b")
	check(t, s.DeleteJob(ctx, epoch, "b"))
	want := []store.Change{{ID: "a"}, {ID: "b", Deleted: true}}
	told, last := changes(t, s, mark)
	if !reflect.DeepEqual(told, want) {
		t.Errorf("changes %v, want %v", told, want)
	}
	if again, _ := changes(t, s, begin); !reflect.DeepEqual(again, want) {
		t.Errorf("changes %v to who asks from the beginning", again)
	}
	if after, same := changes(t, s, last); len(after) != 0 || same != last {
		t.Errorf("%v after the last, and mark %q after %q", after, same, last)
	}
	if now, same := changes(t, s, ""); len(now) != 0 || same != last {
		t.Errorf("%v to who begins now at %q, the last being %q", now, same, last)
	}
}

func testNotJSON(t *testing.T, site Site) {
	s := site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "a", "job-1", "", "")
	nan, events := r, []job.Event{{Sequence: 1, Kind: "round", Convergence: &job.ConvergencePoint{B: math.Inf(1)}}}
	nan.Revision, nan.Convergence = 1, []job.ConvergencePoint{{BStandardError: math.NaN()}}
	if err := s.UpdateJob(t.Context(), 1, nan, nil); !errors.Is(err, store.ErrNotJSON) {
		t.Errorf("a record with a NaN: %v", err)
	}
	r.Revision, r.Paused = 1, true
	if err := s.UpdateJob(t.Context(), 1, r, events); !errors.Is(err, store.ErrNotJSON) {
		t.Errorf("an event with an infinite number: %v", err)
	}
	stored, err := s.Job(t.Context(), "job-1")
	if err != nil || stored.Revision != 0 || stored.Paused {
		t.Errorf("%+v, error %v", stored, err)
	}
	events[0].Convergence = nil
	if err := s.UpdateJob(t.Context(), 1, r, events); err != nil {
		t.Errorf("the job as it should be: %v", err)
	}
}
