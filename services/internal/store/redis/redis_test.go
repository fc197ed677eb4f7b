package redis

import (
	"context"
	"errors"
	"fmt"
	"io"
	"strings"
	"sync"
	"sync/atomic"
	"testing"
	"time"

	"github.com/alicebob/miniredis/v2"
	goredis "github.com/redis/go-redis/v9"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/redis/redistest"
	"metrofarm/services/internal/store/storetest"
)

func open(t *testing.T, address string, o Options) *Store {
	t.Helper()
	s, err := Open(t.Context(), address, o)
	if err != nil {
		t.Fatal(err)
	}
	return s
}

func TestConformanceInMemory(t *testing.T) {
	storetest.Run(t, func(t *testing.T) storetest.Site {
		t.Helper()
		server := miniredis.RunT(t)
		now := time.Unix(1000, 0)
		server.SetTime(now)
		return storetest.Site{
			Open: func(t *testing.T) store.Store {
				t.Helper()
				return open(t, "redis://"+server.Addr(), Options{})
			},
			Pass: func(d time.Duration) { // its clock does not advance by itself
				now = now.Add(d)
				server.SetTime(now)
			},
		}
	})
}

func TestConformance(t *testing.T) {
	server := redistest.Start(t)
	sites := 0
	storetest.Run(t, func(t *testing.T) storetest.Site {
		t.Helper()
		sites++
		address := fmt.Sprintf("%s&prefix=site-%d", server.URL, sites)
		return storetest.Site{
			Open: func(t *testing.T) store.Store {
				t.Helper()
				return open(t, address, Options{})
			},
			Pass: func(d time.Duration) { pass(t, address, d) },
		}
	})
}

// pass moves all ends of leases and memberships back, as if time had passed.
func pass(t *testing.T, address string, d time.Duration) {
	t.Helper()
	s := open(t, address, Options{})
	defer s.Close()
	for _, name := range []string{"leases", "members"} {
		entries, err := s.client.ZRangeWithScores(t.Context(), s.key(name), 0, -1).Result()
		if err != nil {
			t.Fatal(err)
		}
		for _, z := range entries {
			if err := s.client.ZIncrBy(t.Context(), s.key(name), -float64(d.Milliseconds()), fmt.Sprint(z.Member)).Err(); err != nil {
				t.Fatal(err)
			}
		}
	}
}

func TestTheServersClockEndsLeases(t *testing.T) {
	s := open(t, redistest.Start(t).URL, Options{})
	defer s.Close()
	if _, _, err := s.CreateJob(t.Context(), store.Claim{Owner: "m", TTL: 50 * time.Millisecond}, record("a"), "", ""); err != nil {
		t.Fatal(err)
	}
	for deadline := time.Now().Add(20 * time.Second); ; time.Sleep(10 * time.Millisecond) {
		if ids, err := s.Waiting(t.Context()); err == nil && len(ids) == 1 {
			return
		} else if time.Now().After(deadline) {
			t.Fatalf("waiting %v, error %v", ids, err)
		}
	}
}

func record(id string) store.Record {
	return store.Record{ID: id, State: job.Queued, CreatedAt: time.Unix(1000, 0).UTC()}
}

func claim(owner string) store.Claim { return store.Claim{Owner: owner, TTL: time.Minute} }

// TestWhatReturnedIsThere kills the server while many write, and compares what is left with what the
// writers were told.
func TestWhatReturnedIsThere(t *testing.T) {
	server := redistest.Start(t)
	s := open(t, server.URL, Options{})
	defer s.Close()
	s.patience = 200 * time.Millisecond
	for death := range 3 {
		var dead atomic.Bool
		var confirmed [4]atomic.Uint64 // revision by job
		var writers sync.WaitGroup
		for i := range confirmed {
			id := fmt.Sprintf("job-%d-%d", death, i)
			retry(t, func() error {
				_, _, err := s.CreateJob(t.Context(), claim("m"), record(id), id, "f")
				return err
			})
			writers.Go(func() { writeUntil(t, s, id, &dead, &confirmed[i]) })
		}
		for i := range confirmed {
			for deadline := time.Now().Add(20 * time.Second); confirmed[i].Load() < 5 && time.Now().Before(deadline); {
				time.Sleep(time.Millisecond)
			}
		}
		server.Kill()
		dead.Store(true)
		writers.Wait()
		server.Restart()
		for i := range confirmed {
			checkLeft(t, s, fmt.Sprintf("job-%d-%d", death, i), confirmed[i].Load())
		}
	}
}

// writeUntil counts the revisions that are confirmed until the server is dead.
func writeUntil(t *testing.T, s *Store, id string, dead *atomic.Bool, confirmed *atomic.Uint64) {
	r := record(id)
	for r.Revision = 1; ; {
		event := job.Event{Sequence: r.Revision, Kind: "state", Message: strings.Repeat("x", 500)}
		err := s.UpdateJob(context.Background(), 1, r, []job.Event{event})
		switch {
		case err == nil:
			confirmed.Store(r.Revision)
			r.Revision++
		case !errors.Is(err, store.ErrUnavailable) || errors.Is(err, store.ErrFenced):
			t.Errorf("the server died, the error is %v", err)
			return
		case dead.Load():
			return
		}
	}
}

func checkLeft(t *testing.T, s *Store, id string, revision uint64) {
	t.Helper()
	var j store.Owned
	retry(t, func() (err error) { j, err = s.Job(t.Context(), id); return err })
	if j.Revision != revision && j.Revision != revision+1 { // the last may have been made
		t.Errorf("%s has revision %d of %d", id, j.Revision, revision)
	}
	var events []job.Event
	retry(t, func() (err error) { events, err = s.Events(t.Context(), id, 0); return err })
	if len(events) == 0 || events[len(events)-1].Sequence != j.Revision {
		t.Errorf("%s: %d events at revision %d", id, len(events), j.Revision)
	}
	retry(t, func() error {
		_, created, err := s.CreateJob(t.Context(), claim("m"), record("other"), id, "f")
		if err == nil && created {
			t.Errorf("the key of %s is forgotten", id)
		}
		return err
	})
}

// retry makes a call until the store is available: a loaded machine may be slow to answer.
func retry(t *testing.T, call func() error) {
	t.Helper()
	for range 50 {
		err := call()
		if err == nil {
			return
		}
		if !errors.Is(err, store.ErrUnavailable) {
			t.Fatal(err)
		}
	}
	t.Fatal("the store stays unavailable")
}

func TestCallsOutlastARestart(t *testing.T) {
	server := redistest.Start(t)
	s := open(t, server.URL, Options{Patience: 20 * time.Second})
	defer s.Close()
	server.Kill()
	restarted := make(chan struct{})
	go func() {
		defer close(restarted)
		time.Sleep(300 * time.Millisecond)
		server.Restart()
	}()
	if _, created, err := s.CreateJob(t.Context(), claim("m"), record("a"), "key", "f"); err != nil || !created {
		t.Errorf("created %v, error %v", created, err)
	}
	<-restarted
}

// TestRepeatedByTheClient lets every call run twice in the server, as after lost answers.
func TestRepeatedByTheClient(t *testing.T) {
	server := miniredis.RunT(t)
	s := open(t, "redis://"+server.Addr(), Options{})
	defer s.Close()
	s.client = &forgetful{UniversalClient: s.client}
	ctx := t.Context()
	r, created, err := s.CreateJob(ctx, claim("m"), record("a"), "key", "f")
	if err != nil || !created || r.Number != 1 {
		t.Fatalf("create: %+v %v %v", r, created, err)
	}
	r.Revision = 1
	if err := s.UpdateJob(ctx, 1, r, []job.Event{{Sequence: 1}, {Sequence: 2}}); err != nil {
		t.Errorf("update: %v", err)
	}
	r.Revision = 2 // the caller was not told, and sends its events again
	if err := s.UpdateJob(ctx, 1, r, []job.Event{{Sequence: 1}, {Sequence: 2}, {Sequence: 3}}); err != nil {
		t.Errorf("update: %v", err)
	}
	if events, err := s.Events(ctx, "a", 0); err != nil || len(events) != 3 {
		t.Errorf("%d events, error %v", len(events), err)
	}
	if lost, err := s.Beat(ctx, store.Member{ID: "m"}, time.Minute, map[string]uint64{"a": 1}); err != nil || len(lost) != 0 {
		t.Errorf("beat: lost %v, error %v", lost, err)
	}
	if err := s.Leave(ctx, "m", map[string]uint64{"a": 1}); err != nil {
		t.Errorf("leave: %v", err)
	}
	_, epoch, err := s.Acquire(ctx, claim("o"), "a")
	if err != nil {
		t.Fatalf("acquire: %v", err)
	}
	if err := s.Release(ctx, epoch, "a"); err != nil {
		t.Errorf("release: %v", err)
	}
	_, epoch, err = s.Acquire(ctx, claim("n"), "a")
	if err != nil || epoch < 2 {
		t.Fatalf("acquire: epoch %d, error %v", epoch, err)
	}
	if err := s.DeleteJob(ctx, epoch, "a"); err != nil {
		t.Errorf("delete: %v", err)
	}
	if jobs, err := s.Jobs(ctx, 0, 10); err != nil || len(jobs) != 0 {
		t.Errorf("%d jobs left, error %v", len(jobs), err)
	}
}

func TestAFrozenServer(t *testing.T) {
	server := redistest.Start(t)
	s := open(t, server.URL, Options{Patience: time.Second})
	defer s.Close()
	server.Freeze()
	_, err := s.Members(t.Context()) // does not wait for ever
	if !errors.Is(err, store.ErrUnavailable) || !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("error %v", err)
	}
	server.Thaw()
	for deadline := time.Now().Add(time.Minute); err != nil; _, err = s.Members(t.Context()) {
		if time.Now().After(deadline) {
			t.Fatal(err)
		}
	}
}

func TestAddresses(t *testing.T) {
	for _, address := range []string{
		"redis://localhost", "redis://:secret@localhost:6379/2", "rediss://user:secret@host:6380/0?prefix=x", "unix:///run/redis.sock?db=1",
	} {
		if err := Check(address); err != nil {
			t.Errorf("%s: %v", address, err)
		}
	}
	for _, address := range []string{"http://localhost", "redis://localhost/database", "redis://host?unknown=1", "redis://a:secret@%zz"} {
		if err := Check(address); err == nil || strings.Contains(err.Error(), "secret") {
			t.Errorf("%s: %v", address, err)
		}
	}
}

func TestPrefixesKeepFarmsApart(t *testing.T) {
	server := miniredis.RunT(t)
	one, two := open(t, "redis://"+server.Addr(), Options{}), open(t, "redis://"+server.Addr()+"?prefix=two", Options{})
	defer one.Close()
	defer two.Close()
	if _, _, err := one.CreateJob(t.Context(), claim("m"), record("a"), "", ""); err != nil {
		t.Fatal(err)
	}
	if jobs, err := two.Jobs(t.Context(), 0, 1); err != nil || len(jobs) != 0 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
	for _, key := range server.Keys() {
		if !strings.HasPrefix(key, "{metrofarm}:") {
			t.Errorf("key %s has not the hash tag", key)
		}
	}
}

// forgetful loses the answer of every other script that has run.
type forgetful struct {
	goredis.UniversalClient
	answers int
}

func (f *forgetful) EvalSha(ctx context.Context, sha string, keys []string, args ...any) *goredis.Cmd {
	return f.lose(ctx, f.UniversalClient.EvalSha(ctx, sha, keys, args...))
}

func (f *forgetful) Eval(ctx context.Context, script string, keys []string, args ...any) *goredis.Cmd {
	return f.lose(ctx, f.UniversalClient.Eval(ctx, script, keys, args...))
}

func (f *forgetful) lose(ctx context.Context, answer *goredis.Cmd) *goredis.Cmd {
	if answer.Err() != nil {
		return answer
	}
	if f.answers++; f.answers%2 == 0 {
		return answer
	}
	lost := goredis.NewCmd(ctx)
	lost.SetErr(io.EOF)
	return lost
}

// Long answers would not come in time: many jobs are read in several.
func TestManyJobsAreReadInSeveralAnswers(t *testing.T) {
	s := open(t, "redis://"+miniredis.RunT(t).Addr(), Options{})
	defer s.Close()
	var ids []string
	for i := range 200 {
		ids = append(ids, fmt.Sprintf("job-%d", i))
		if _, _, err := s.CreateJob(t.Context(), claim("m"), record(ids[i]), "", ""); err != nil {
			t.Fatal(err)
		}
	}
	counting := &counting{UniversalClient: s.client}
	s.client = counting
	byID, errByID := s.JobsByID(t.Context(), ids)
	listed, errListed := s.Jobs(t.Context(), 0, len(ids))
	if err := errors.Join(errByID, errListed); err != nil || len(byID) != len(ids) || len(listed) != len(ids) {
		t.Fatalf("%d and %d of %d jobs, error %v", len(byID), len(listed), len(ids), err)
	}
	for i, id := range ids {
		if byID[i].ID != id || listed[len(ids)-1-i].ID != id {
			t.Errorf("jobs %s and %s at %d, want %s", byID[i].ID, listed[len(ids)-1-i].ID, i, id)
		}
	}
	if counting.most > 100 {
		t.Errorf("an answer has up to %d jobs", counting.most)
	}
}

// counting notes with how many keys scripts run at most.
type counting struct {
	goredis.UniversalClient
	most int
}

func (c *counting) EvalSha(ctx context.Context, sha string, keys []string, args ...any) *goredis.Cmd {
	c.most = max(c.most, len(keys))
	return c.UniversalClient.EvalSha(ctx, sha, keys, args...)
}
