package storetest

import (
	"context"
	"errors"
	"fmt"
	"slices"
	"sync/atomic"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// sequence of so many frames, with its jobs, by an id.
func sequence(id string, frames int) (store.Sequence, []store.Record) {
	q := store.Sequence{
		ID: id, User: "ada", CreatedAt: record("").CreatedAt,
		Request: job.SequenceRequest{Frames: job.Frames{Start: 1, End: frames}},
	}
	jobs := make([]store.Record, frames)
	for i := range jobs {
		jobs[i] = record(fmt.Sprintf("%s-%d", id, i+1))
		jobs[i].FrameOf = &job.FrameOf{ID: id, Frame: i + 1}
		q.Jobs = append(q.Jobs, jobs[i].ID)
	}
	return q, jobs
}

func createSequence(t *testing.T, s store.Store, owner, id string, frames int, key, fingerprint string) (store.Sequence, bool) {
	t.Helper()
	q, jobs := sequence(id, frames)
	stored, created, err := s.CreateSequence(context.Background(), claim(owner), q, jobs, key, fingerprint)
	if err != nil {
		t.Fatal(err)
	}
	return stored, created
}

func testSequence(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	first, _ := create(t, s, "m", "a", "", "")
	stored, created := createSequence(t, s, "m", "q", 3, "", "")
	if !created || stored.Number != first.Number+1 || !slices.Equal(stored.Jobs, []string{"q-1", "q-2", "q-3"}) {
		t.Fatalf("stored %+v, created %v", stored, created)
	}
	if last, _ := create(t, s, "m", "b", "", ""); last.Number != first.Number+4 {
		t.Errorf("number %d after a sequence of 3 from %d", last.Number, stored.Number)
	}
	for i, id := range stored.Jobs {
		j := get(t, s, id)
		if j.Number != stored.Number+uint64(i) || j.State != job.Queued || j.FrameOf == nil || *j.FrameOf != (job.FrameOf{ID: "q", Frame: i + 1}) {
			t.Errorf("job %+v", j)
		}
	}
	r := get(t, s, "q-2").Record
	r.Revision, r.State = 1, job.Rendering
	update(t, s, 1, r, job.Event{Sequence: 1})
	check(t, s.Close())
	site.Pass(2 * TTL)
	s = site.Open(t)
	if ids := waiting(t, s); len(ids) != 5 {
		t.Errorf("waiting: %v", ids)
	}
	q, err := s.Sequence(ctx, "q")
	check(t, err)
	if want := []job.State{job.Queued, job.Rendering, job.Queued}; !slices.Equal(q.States, want) || q.Number != stored.Number || q.User != "ada" || q.Request.Frames.End != 3 {
		t.Errorf("sequence %+v", q)
	}
	jobs, err := s.JobsByID(ctx, []string{"q-3", "none", "q-1"})
	if err != nil || len(jobs) != 2 || jobs[0].ID != "q-3" || jobs[1].Number != stored.Number {
		t.Errorf("jobs %+v, error %v", jobs, err)
	}
	if none, err := s.JobsByID(ctx, nil); err != nil || len(none) != 0 {
		t.Errorf("jobs %+v, error %v", none, err)
	}
	if _, err := s.Sequence(ctx, "none"); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("no such sequence: %v", err)
	}
}

func testSequenceRepetition(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	first, _ := createSequence(t, s, "m", "q", 2, "key", "one")
	for _, key := range []string{"key", ""} { // as after an answer that was lost
		if again, created := createSequence(t, s, "m", "q", 2, key, "one"); !created || again.Number != first.Number {
			t.Errorf("created again with key %q: %+v, %v", key, again, created)
		}
	}
	if again, created := createSequence(t, s, "n", "p", 2, "key", "one"); created || again.ID != "q" || len(again.States) != 2 {
		t.Errorf("the key found %+v, created %v", again, created)
	}
	q, jobs := sequence("p", 2)
	if _, _, err := s.CreateSequence(ctx, claim("m"), q, jobs, "key", "two"); !errors.Is(err, store.ErrKeyReused) {
		t.Errorf("another request: %v", err)
	}
	if _, _, err := s.CreateJob(ctx, claim("m"), record("a"), "key", "job"); !errors.Is(err, store.ErrKeyReused) {
		t.Errorf("a job under the key: %v", err)
	}
	create(t, s, "m", "b", "other", "job")
	if _, _, err := s.CreateSequence(ctx, claim("m"), q, jobs, "other", "one"); !errors.Is(err, store.ErrKeyReused) {
		t.Errorf("the key of a job: %v", err)
	}
	if all, err := s.Jobs(ctx, 0, 10); err != nil || len(all) != 3 {
		t.Errorf("%d jobs, error %v", len(all), err)
	}
	if all, err := s.Sequences(ctx, 0, 10); err != nil || len(all) != 1 {
		t.Errorf("%d sequences, error %v", len(all), err)
	}
}

func testSequenceEnd(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	createSequence(t, s, "m", "q", 2, "key", "one")
	createSequence(t, s, "m", "p", 1, "", "")
	check(t, s.DeleteJob(ctx, 1, "q-1"))
	q, err := s.Sequence(ctx, "q")
	if want := []job.State{job.Deleted, job.Queued}; err != nil || !slices.Equal(q.States, want) {
		t.Fatalf("states %v, error %v", q.States, err)
	}
	if again, created := createSequence(t, s, "m", "r", 2, "key", "one"); created || again.ID != "q" {
		t.Errorf("the key found %+v, created %v", again, created)
	}
	check(t, s.DeleteJob(ctx, 1, "q-2"))
	if _, err := s.Sequence(ctx, "q"); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("a sequence without jobs: %v", err)
	}
	all, err := s.Sequences(ctx, 0, 10)
	if err != nil || len(all) != 1 || all[0].ID != "p" {
		t.Errorf("sequences %+v, error %v", all, err)
	}
	if _, created := createSequence(t, s, "m", "r", 2, "key", "two"); !created {
		t.Error("the key was left")
	}
}

func testSequenceOrder(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	const total = 7
	for i := range total {
		createSequence(t, s, "m", fmt.Sprintf("q%d", total-i), 1+i%3, "", "")
	}
	var listed []string
	for before := uint64(0); ; {
		page, err := s.Sequences(ctx, before, 3)
		check(t, err)
		for _, q := range page {
			if listed = append(listed, q.ID); len(q.States) != len(q.Jobs) || q.States[0] != job.Queued {
				t.Errorf("%s: states %v", q.ID, q.States)
			}
		}
		if len(page) < 3 {
			break
		}
		before = page[len(page)-1].Number
	}
	if want := []string{"q1", "q2", "q3", "q4", "q5", "q6", "q7"}; !slices.Equal(listed, want) {
		t.Errorf("listed %v, want %v", listed, want)
	}
}

func testSequenceRace(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	var created atomic.Int32
	together(8, func(i int) {
		q, jobs := sequence(fmt.Sprintf("q%d", i), 3)
		_, fresh, err := s.CreateSequence(ctx, claim("m"), q, jobs, "key", "one")
		if err != nil {
			t.Error(err)
		}
		if fresh {
			created.Add(1)
		}
	})
	if n := created.Load(); n != 1 {
		t.Errorf("%d sequences under one key", n)
	}
	if jobs, err := s.Jobs(ctx, 0, 10); err != nil || len(jobs) != 3 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
}
