// Package storetest is the conformance suite of store.Store.
package storetest

import (
	"context"
	"errors"
	"fmt"
	"testing"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Open opens a store at a place of the suite's choice; opening the same place again sees what was
// stored there.
type Open func(t *testing.T, place string) store.Store

// Run runs the suite.
func Run(t *testing.T, open Open) {
	for name, test := range map[string]func(*testing.T, Open){
		"epochs grow and fence":       testFencing,
		"jobs survive reopening":      testDurability,
		"idempotency keys":            testKeys,
		"events are kept in bounds":   testEvents,
		"delete leaves nothing":       testDelete,
		"missing jobs are not found":  testMissing,
		"jobs come in creation order": testOrder,
	} {
		t.Run(name, func(t *testing.T) { test(t, open) })
	}
}

func record(id string) store.Record {
	return store.Record{
		ID: id, State: job.Queued, Request: job.Request{Scene: "s", Entry: "e"},
		CreatedAt: time.Unix(1000, 0).UTC(),
	}
}

func claim(t *testing.T, s store.Store) uint64 {
	t.Helper()
	epoch, err := s.Claim(context.Background())
	if err != nil {
		t.Fatal(err)
	}
	return epoch
}

func create(t *testing.T, s store.Store, epoch uint64, id, key, fingerprint string) (store.Record, bool) {
	t.Helper()
	r, created, err := s.CreateJob(context.Background(), epoch, record(id), key, fingerprint)
	if err != nil {
		t.Fatal(err)
	}
	return r, created
}

func testFencing(t *testing.T, open Open) {
	ctx, s := context.Background(), open(t, t.TempDir())
	defer s.Close()
	old := claim(t, s)
	r, _ := create(t, s, old, "a", "", "")
	if now := claim(t, s); now <= old {
		t.Fatalf("epoch %d after %d", now, old)
	}
	if _, _, err := s.CreateJob(ctx, old, record("b"), "", ""); !errors.Is(err, store.ErrFenced) {
		t.Errorf("CreateJob: %v", err)
	}
	r.State = job.Failed
	if err := s.UpdateJob(ctx, old, r, nil); !errors.Is(err, store.ErrFenced) {
		t.Errorf("UpdateJob: %v", err)
	}
	if err := s.DeleteJob(ctx, old, "a"); !errors.Is(err, store.ErrFenced) {
		t.Errorf("DeleteJob: %v", err)
	}
	if jobs, _ := s.Jobs(ctx); len(jobs) != 1 || jobs[0].State != job.Queued {
		t.Errorf("jobs after fenced calls: %+v", jobs)
	}
}

func testDurability(t *testing.T, open Open) {
	ctx, place := context.Background(), t.TempDir()
	s := open(t, place)
	epoch := claim(t, s)
	r, _ := create(t, s, epoch, "a", "", "")
	r.State, r.Checkpoint, r.Sequence = job.Rendering, "checkpoint-a-1", 7
	if err := s.UpdateJob(ctx, epoch, r, []job.Event{{Sequence: 7, Kind: "state"}}); err != nil {
		t.Fatal(err)
	}
	s.Close()
	s = open(t, place)
	defer s.Close()
	if again := claim(t, s); again <= epoch {
		t.Errorf("epoch %d after %d", again, epoch)
	}
	jobs, err := s.Jobs(ctx)
	if err != nil || len(jobs) != 1 || jobs[0].State != job.Rendering || jobs[0].Checkpoint != r.Checkpoint {
		t.Fatalf("jobs %+v, error %v", jobs, err)
	}
	if events, _ := s.Events(ctx, "a", 0); len(events) != 1 || events[0].Sequence != 7 {
		t.Fatalf("events %+v", events)
	}
}

func testKeys(t *testing.T, open Open) {
	s := open(t, t.TempDir())
	defer s.Close()
	epoch := claim(t, s)
	first, created := create(t, s, epoch, "a", "key", "one")
	if !created || first.ID != "a" {
		t.Fatalf("first: %+v %v", first, created)
	}
	again, created := create(t, s, epoch, "b", "key", "one")
	if created || again.ID != "a" || again.Number != first.Number {
		t.Fatalf("again: %+v %v", again, created)
	}
	if _, _, err := s.CreateJob(context.Background(), epoch, record("c"), "key", "two"); !errors.Is(err, store.ErrKeyReused) {
		t.Fatalf("reused: %v", err)
	}
	if _, created := create(t, s, epoch, "d", "", "one"); !created {
		t.Fatal("an empty key matched")
	}
}

func testEvents(t *testing.T, open Open) {
	ctx, s := context.Background(), open(t, t.TempDir())
	defer s.Close()
	epoch := claim(t, s)
	r, _ := create(t, s, epoch, "a", "", "")
	const total = store.MaxEvents + 10
	for i := uint64(1); i <= total; i += 2 {
		events := []job.Event{{Sequence: i, Kind: "round"}, {Sequence: i + 1, Kind: "round"}}
		if err := s.UpdateJob(ctx, epoch, r, events); err != nil {
			t.Fatal(err)
		}
	}
	events, err := s.Events(ctx, "a", 0)
	if err != nil || len(events) != store.MaxEvents || events[len(events)-1].Sequence != total {
		t.Fatalf("%d events, error %v", len(events), err)
	}
	if tail, _ := s.Events(ctx, "a", total-3); len(tail) != 3 || tail[0].Sequence != total-2 {
		t.Fatalf("tail %+v", tail)
	}
}

func testDelete(t *testing.T, open Open) {
	ctx, s := context.Background(), open(t, t.TempDir())
	defer s.Close()
	epoch := claim(t, s)
	r, _ := create(t, s, epoch, "a", "key", "one")
	if err := s.UpdateJob(ctx, epoch, r, []job.Event{{Sequence: 1}}); err != nil {
		t.Fatal(err)
	}
	if err := s.DeleteJob(ctx, epoch, "a"); err != nil {
		t.Fatal(err)
	}
	if events, _ := s.Events(ctx, "a", 0); len(events) != 0 {
		t.Errorf("events left: %d", len(events))
	}
	if _, created := create(t, s, epoch, "b", "key", "two"); !created {
		t.Error("the key was left")
	}
}

func testMissing(t *testing.T, open Open) {
	ctx, s := context.Background(), open(t, t.TempDir())
	defer s.Close()
	epoch := claim(t, s)
	if err := s.UpdateJob(ctx, epoch, record("a"), nil); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("UpdateJob: %v", err)
	}
	if err := s.DeleteJob(ctx, epoch, "a"); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("DeleteJob: %v", err)
	}
}

func testOrder(t *testing.T, open Open) {
	s := open(t, t.TempDir())
	defer s.Close()
	epoch := claim(t, s)
	for i := range 12 {
		create(t, s, epoch, fmt.Sprintf("job-%d", 100-i), "", "")
	}
	jobs, err := s.Jobs(context.Background())
	if err != nil || len(jobs) != 12 {
		t.Fatalf("%d jobs, error %v", len(jobs), err)
	}
	for i, r := range jobs {
		if want := fmt.Sprintf("job-%d", 100-i); r.ID != want {
			t.Errorf("job %d is %s, not %s", i, r.ID, want)
		}
	}
}
