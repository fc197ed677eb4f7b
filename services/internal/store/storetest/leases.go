package storetest

import (
	"context"
	"errors"
	"fmt"
	"slices"
	"sync"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

func testExpiry(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	beat(t, s, "m", nil)
	create(t, s, "m", "a", "", "")
	if owner := get(t, s, "a").Owner; !same(owner, member("m")) {
		t.Errorf("owner %+v", owner)
	}
	if ids := waiting(t, s); len(ids) != 0 {
		t.Errorf("waiting: %v", ids)
	}
	if _, _, err := s.Acquire(ctx, claim("n"), "a"); !errors.Is(err, store.ErrOwned) {
		t.Errorf("acquired an owned job: %v", err)
	}
	site.Pass(2 * TTL)
	if owner := get(t, s, "a").Owner; !same(owner, store.Member{}) {
		t.Errorf("owner %+v after the lease", owner)
	}
	if jobs, err := s.Jobs(ctx, 0, 1); err != nil || len(jobs) != 1 || !same(jobs[0].Owner, store.Member{}) {
		t.Errorf("listed %+v, error %v", jobs, err)
	}
	if ids := waiting(t, s); len(ids) != 1 || ids[0] != "a" {
		t.Errorf("waiting: %v", ids)
	}
	beat(t, s, "n", nil)
	if r, epoch := acquire(t, s, "n", "a"); epoch != 2 || r.ID != "a" {
		t.Errorf("epoch %d of %+v", epoch, r)
	}
	if jobs, err := s.Jobs(ctx, 0, 1); err != nil || len(jobs) != 1 || !same(jobs[0].Owner, member("n")) {
		t.Errorf("listed %+v, error %v", jobs, err)
	}
	if ids := waiting(t, s); len(ids) != 0 {
		t.Errorf("waiting: %v", ids)
	}
}

func testRenewal(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	create(t, s, "m", "a", "", "")
	create(t, s, "m", "b", "", "")
	for range 4 {
		site.Pass(TTL / 2)
		if lost := beat(t, s, "m", map[string]uint64{"a": 1}); len(lost) != 0 {
			t.Fatalf("lost %v", lost)
		}
	}
	if ids := waiting(t, s); len(ids) != 1 || ids[0] != "b" {
		t.Errorf("waiting: %v", ids)
	}
	if _, _, err := s.Acquire(ctx, claim("n"), "a"); !errors.Is(err, store.ErrOwned) {
		t.Errorf("acquired a renewed job: %v", err)
	}
	if lost := beat(t, s, "m", map[string]uint64{"a": 2}); !slices.Equal(lost, []string{"a"}) {
		t.Errorf("lost %v under another epoch", lost)
	}
}

func testLateRenewal(t *testing.T, site Site) {
	s := site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "m", "a", "", "")
	site.Pass(2 * TTL)
	r.Revision = 1
	update(t, s, 1, r)
	if lost := beat(t, s, "m", map[string]uint64{"a": 1}); len(lost) != 0 {
		t.Errorf("lost %v", lost)
	}
	if ids := waiting(t, s); len(ids) != 0 {
		t.Errorf("waiting: %v", ids)
	}
}

func testRelease(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	beat(t, s, "m", nil)
	for _, id := range []string{"a", "b", "c"} {
		create(t, s, "m", id, "", "")
	}
	check(t, s.Release(ctx, 1, "a"))
	if ids := waiting(t, s); !slices.Equal(ids, []string{"a"}) {
		t.Errorf("waiting: %v", ids)
	}
	r := record("a")
	r.Revision = 1
	if err := s.UpdateJob(ctx, 1, r, nil); !errors.Is(err, store.ErrFenced) {
		t.Errorf("update of a released job: %v", err)
	}
	if lost := beat(t, s, "m", map[string]uint64{"a": 1}); !slices.Equal(lost, []string{"a"}) {
		t.Errorf("lost %v", lost)
	}
	check(t, s.Leave(ctx, "m", map[string]uint64{"a": 1, "b": 1}))
	ids := waiting(t, s)
	if slices.Sort(ids); !slices.Equal(ids, []string{"a", "b"}) {
		t.Errorf("waiting: %v", ids)
	}
	if members, _ := s.Members(ctx); len(members) != 0 {
		t.Errorf("members %+v", members)
	}
	if _, epoch := acquire(t, s, "n", "b"); epoch != 2 {
		t.Errorf("epoch %d", epoch)
	}
}

func testSettled(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	r, _ := create(t, s, "m", "a", "", "")
	r.State, r.Revision = job.Done, 1
	update(t, s, 1, r)
	site.Pass(2 * TTL)
	if ids := waiting(t, s); len(ids) != 1 { // its owner may not have been through with it
		t.Errorf("waiting: %v", ids)
	}
	_, epoch := acquire(t, s, "m", "a")
	check(t, s.Release(ctx, epoch, "a"))
	if ids := waiting(t, s); len(ids) != 0 {
		t.Errorf("waiting: %v", ids)
	}
	if _, epoch = acquire(t, s, "n", "a"); epoch != 3 {
		t.Errorf("epoch %d", epoch)
	}
	site.Pass(2 * TTL)
	if ids := waiting(t, s); len(ids) != 1 {
		t.Errorf("waiting: %v", ids)
	}
}

func testMembers(t *testing.T, site Site) {
	ctx, s := context.Background(), site.Open(t)
	defer s.Close()
	beat(t, s, "m", nil)
	beat(t, s, "n", nil)
	members, err := s.Members(ctx)
	if err != nil || !slices.EqualFunc(members, []store.Member{member("m"), member("n")}, same) {
		t.Errorf("members %+v, error %v", members, err)
	}
	site.Pass(TTL * 3 / 4)
	beat(t, s, "n", nil)
	site.Pass(TTL / 2)
	members, err = s.Members(ctx)
	if err != nil || !slices.EqualFunc(members, []store.Member{member("n")}, same) {
		t.Errorf("members %+v, error %v", members, err)
	}
}

// together runs fn so many times at once.
func together(n int, fn func(i int)) {
	var group sync.WaitGroup
	for i := range n {
		group.Go(func() { fn(i) })
	}
	group.Wait()
}

func testRace(t *testing.T, site Site) {
	s := site.Open(t)
	defer s.Close()
	create(t, s, "m", "a", "", "")
	site.Pass(2 * TTL)
	var owners atomic.Int32
	together(8, func(i int) {
		_, _, err := s.Acquire(context.Background(), store.Claim{Owner: fmt.Sprint(i), TTL: time.Hour}, "a")
		switch {
		case err == nil:
			owners.Add(1)
		case !errors.Is(err, store.ErrOwned):
			t.Error(err)
		}
	})
	if n := owners.Load(); n != 1 {
		t.Errorf("%d owners", n)
	}
}

func testKeyRace(t *testing.T, site Site) {
	s := site.Open(t)
	defer s.Close()
	var created atomic.Int32
	together(8, func(i int) {
		_, fresh, err := s.CreateJob(context.Background(), claim("m"), record(fmt.Sprintf("job-%d", i)), "key", "one")
		if err != nil {
			t.Error(err)
		}
		if fresh {
			created.Add(1)
		}
	})
	if n := created.Load(); n != 1 {
		t.Errorf("%d jobs under one key", n)
	}
	if jobs, err := s.Jobs(context.Background(), 0, 10); err != nil || len(jobs) != 1 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
}
