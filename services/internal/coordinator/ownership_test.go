package coordinator_test

import (
	"context"
	"errors"
	"io"
	"path/filepath"
	"slices"
	"strings"
	"testing"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/bolt"
	"metrofarm/services/internal/sweep"
)

// pair is two coordinators that share store and blobs.
type pair struct {
	t     *testing.T
	store store.Store
	sites [2]*site
	lines [2]*line
}

func newPair(t *testing.T, ttl time.Duration) *pair {
	t.Helper()
	dir := t.TempDir()
	db, err := bolt.Open(filepath.Join(dir, "metrofarm.db"), nil)
	if err != nil {
		t.Fatal(err)
	}
	t.Cleanup(func() { db.Close() })
	p := &pair{t: t, store: db}
	for i, name := range []string{"first", "second"} {
		p.lines[i] = &line{Store: db}
		p.sites[i] = &site{t: t, dir: dir, address: "127.0.0.1:0", shared: p.lines[i], tune: func(o *coordinator.Options) {
			o.Member = store.Member{ID: name, REST: "http://" + name}
			o.OwnershipTTL = ttl
		}}
	}
	return p
}

// record of a job in the store.
func (p *pair) record(id string) store.Owned {
	p.t.Helper()
	j, err := p.store.Job(context.Background(), id)
	if err != nil {
		p.t.Fatal(err)
	}
	return j
}

func (p *pair) eventually(what string, holds func() bool) {
	p.t.Helper()
	for deadline := time.Now().Add(patience); !holds(); time.Sleep(2 * time.Millisecond) {
		if time.Now().After(deadline) {
			p.t.Fatalf("not %s after %v", what, patience)
		}
	}
}

// checkpointed waits until a job has complete rounds in a checkpoint.
func (p *pair) checkpointed(id string) {
	p.t.Helper()
	p.sites[0].await(id, "in its second round", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	p.eventually("checkpointed", func() bool { return p.record(id).Checkpoint != "" })
}

// sweep deletes, as if hours had passed, what no record names.
func (p *pair) sweep() {
	p.t.Helper()
	later := time.Now().Add(2 * time.Hour)
	sweeper := sweep.New(sweep.Options{
		Blobs: p.sites[0].blobs, Jobs: sweep.StoredJobs{Store: p.store}, Now: func() time.Time { return later },
	})
	for range 2 {
		if _, err := sweeper.Sweep(p.t.Context()); err != nil {
			p.t.Fatal(err)
		}
	}
}

// blobs lists the names of all checkpoints.
func (p *pair) blobs() (names []string) {
	p.t.Helper()
	for info, err := range p.sites[0].blobs.List(p.t.Context(), blob.Named) {
		if err != nil {
			p.t.Fatal(err)
		}
		names = append(names, info.Name)
	}
	return names
}

// slowly makes jobs last long enough to be interrupted.
func slowly(w *fakeworker.Worker) { w.Delay = 10 * time.Millisecond }

// takeover is the longest that a job may stand still when its owner dies.
const takeover = 15 * time.Second

func TestAnotherTakesOverWhenTheOwnerIsKilled(t *testing.T) {
	t.Parallel()
	request := chainsRequest(100)
	want := reference(t, request)
	p := newPair(t, 0) // as in production
	first, second := p.sites[0], p.sites[1]
	first.start()
	dismiss := first.crew(workers(2, slowly)...)
	id := first.submit(request)
	p.checkpointed(id)
	second.start()
	defer second.stop()
	if owner, err := second.c.Owner(t.Context(), id); err != nil || owner.REST != "http://first" {
		t.Errorf("owner %+v, error %v", owner, err)
	}
	p.lines[0].cut.Store(true) // nothing can be said any more
	killed := time.Now()
	first.cancel()
	dismiss()
	first.server.Stop()
	<-first.done
	defer second.crew(workers(2, nil)...)()
	p.eventually("taken over", func() bool { return len(second.c.Own()) == 1 })
	if took := time.Since(killed); took > takeover {
		t.Errorf("taken over after %v", took)
	}
	sameFilm(t, second.finished(id), want)
}

func TestAStaleOwnerWritesNothing(t *testing.T) {
	t.Parallel()
	request := chainsRequest(100)
	want := reference(t, request)
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.start()
	defer first.stop()
	// Longer than the lease: what ends before that is not taken over.
	defer first.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 100 * time.Millisecond })...)()
	id := first.submit(request)
	p.checkpointed(id)
	p.lines[0].frozen.Store(true)
	second.start()
	defer second.stop()
	p.eventually("taken over", func() bool { return len(second.c.Own()) == 1 })
	before := p.lines[0].writes.Load()
	p.eventually("dropped", func() bool { return len(first.c.Own()) == 0 })
	if after := p.lines[0].writes.Load(); after != before {
		t.Errorf("the former owner wrote %d times", after-before)
	}
	if j := p.record(id); j.Owner.ID != "second" || j.State.Ended() {
		t.Errorf("owner %+v, job %s", j.Owner, j.State)
	}
	defer second.crew(workers(2, nil)...)()
	sameFilm(t, second.finished(id), want)
	if name := p.record(id).Checkpoint; !strings.HasPrefix(name, "checkpoint-"+id+"-2-") {
		t.Errorf("the last checkpoint is %s", name)
	}
	p.sweep()
	if got, want := p.blobs(), []string{p.record(id).Checkpoint}; !slices.Equal(got, want) {
		t.Errorf("blobs %v, want %v", got, want)
	}
}

func TestADamagedCheckpointBeginsTheJobAgain(t *testing.T) {
	t.Parallel()
	request := chainsRequest(60)
	want := reference(t, request)
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.start()
	dismiss := first.crew(workers(2, slowly)...)
	id := first.submit(request)
	p.checkpointed(id)
	p.lines[0].cut.Store(true)
	first.cancel()
	dismiss()
	first.server.Stop()
	<-first.done
	err := first.blobs.WriteBlob(t.Context(), p.record(id).Checkpoint, func(w io.Writer) error {
		_, err := io.WriteString(w, "neither a checkpoint nor the beginning of one")
		return err
	})
	if err != nil {
		t.Fatal(err)
	}
	second.start()
	defer second.stop()
	p.eventually("taken over", func() bool { return len(second.c.Own()) == 1 })
	defer second.crew(workers(2, nil)...)()
	sameFilm(t, second.finished(id), want)
	if n := second.countEvents(id, "the checkpoint cannot be used"); n != 1 {
		t.Errorf("told %d times", n)
	}
}

// A worker has one identity, and tells coordinators apart by theirs.
func TestCoordinatorsTellTheirIdentity(t *testing.T) {
	p := newPair(t, time.Second)
	var answers [2]*farmv1.RegisterResponse
	for i, s := range p.sites {
		s.start()
		defer s.stop()
		var err error
		answers[i], err = s.c.Register(t.Context(), &farmv1.RegisterRequest{
			Name: "worker", Version: testVersion, Threads: 1, Instance: strings.Repeat("a", 32),
		})
		if err != nil {
			t.Fatal(err)
		}
	}
	if answers[0].GetWorkerId() != answers[1].GetWorkerId() {
		t.Errorf("worker ids %q and %q", answers[0].GetWorkerId(), answers[1].GetWorkerId())
	}
	if answers[0].GetCoordinatorId() != "first" || answers[1].GetCoordinatorId() != "second" {
		t.Errorf("coordinator ids %q and %q", answers[0].GetCoordinatorId(), answers[1].GetCoordinatorId())
	}
}

func TestJobsAreReleasedOnShutdown(t *testing.T) {
	t.Parallel()
	request := chainsRequest(100)
	want := reference(t, request)
	p := newPair(t, time.Hour)
	first, second := p.sites[0], p.sites[1]
	first.start()
	dismiss := first.crew(workers(2, slowly)...)
	id := first.submit(request)
	p.checkpointed(id)
	dismiss()
	first.stop()
	second.start() // looks at once; the lease would last an hour
	defer second.stop()
	defer second.crew(workers(2, nil)...)()
	sameFilm(t, second.finished(id), want)
}

func TestAnOutageOfTheStore(t *testing.T) {
	t.Parallel()
	request := chainsRequest(100)
	want := reference(t, request)
	p := newPair(t, 600*time.Millisecond)
	s := p.sites[0]
	s.start()
	defer s.stop()
	defer s.crew(workers(2, slowly)...)()
	id := s.submit(request)
	p.checkpointed(id)
	p.lines[0].cut.Store(true)
	p.eventually("suspended", func() bool { return s.c.Ready(t.Context()) != nil })
	before := p.record(id)
	time.Sleep(2 * time.Second)
	if _, err := s.c.Pause(t.Context(), id); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("paused without a store: %v", err)
	}
	if _, err := s.c.Submit(t.Context(), s.job(id).Request, ""); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("submitted without a store: %v", err)
	}
	if after := p.record(id); after.Revision != before.Revision || s.job(id).State != job.Rendering {
		t.Errorf("revision %d after %d, job %s", after.Revision, before.Revision, s.job(id).State)
	}
	p.lines[0].cut.Store(false)
	p.eventually("resumed", func() bool { _, err := s.c.Resume(t.Context(), id); return err == nil })
	sameFilm(t, s.finished(id), want)
	events, err := p.store.Events(t.Context(), id, 0)
	if err != nil || slices.ContainsFunc(events, func(e job.Event) bool { return strings.Contains(e.Message, "goes on with the job") }) {
		t.Errorf("the job began again from its checkpoint, or error %v", err)
	}
}

func TestCheckpointsOfOthersStay(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Hour)
	first, second := p.sites[0], p.sites[1]
	first.start()
	defer first.stop()
	dismiss := first.crew(workers(2, slowly)...)
	id := first.submit(chainsRequest(100))
	p.checkpointed(id)
	if _, err := first.c.Pause(t.Context(), id); err != nil {
		t.Fatal(err)
	}
	dismiss()
	at, since := "", time.Now()
	p.eventually("at rest", func() bool {
		if now := p.record(id).Checkpoint; now != at {
			at, since = now, time.Now()
		}
		return time.Since(since) > 300*time.Millisecond
	})
	orphan := "checkpoint-job-gone-7-1"
	first.check(first.blobs.WriteBlob(t.Context(), orphan, func(w io.Writer) error { _, err := w.Write([]byte("x")); return err }))
	second.start()
	defer second.stop()
	p.sweep()
	if got, want := p.blobs(), []string{p.record(id).Checkpoint}; !slices.Equal(got, want) {
		t.Errorf("blobs %v, want %v", got, want)
	}
}

func TestEndedJobsBelongToEveryone(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Hour)
	first, second := p.sites[0], p.sites[1]
	first.start()
	defer first.stop()
	second.start()
	defer second.stop()
	defer first.crew(workers(1, nil)...)()
	id := first.submit(chainsRequest(20))
	if jobs, _, err := second.c.Jobs(t.Context(), "", 10); err != nil || len(jobs) != 1 || !jobs[0].Stale || jobs[0].Owner != "http://first" {
		t.Errorf("jobs %+v, error %v", jobs, err)
	}
	if _, err := second.c.Cancel(t.Context(), id); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("another's job was canceled: %v", err)
	}
	done := first.finished(id)
	p.eventually("released", func() bool { return len(first.c.Own()) == 0 })
	if seen := second.job(id); seen.State != job.Done || seen.FilmSHA256 != done.FilmSHA256 || seen.Stale {
		t.Errorf("the other sees %+v", seen)
	}
	if image, err := second.c.Image(t.Context(), id); err != nil || image.FilmSHA256 != done.FilmSHA256 {
		t.Errorf("image %s, error %v", image.FilmSHA256, err)
	}
	past, live, err := second.c.Events(t.Context(), id, 0)
	if err != nil || len(past) == 0 || past[len(past)-1].Kind != "state" {
		t.Errorf("%d events, error %v", len(past), err)
	}
	select {
	case <-live:
		t.Error("readers of an ended job connect again and again")
	default:
	}
	if err := second.c.Delete(t.Context(), id); err != nil {
		t.Error(err)
	}
	if _, err := first.c.Job(t.Context(), id); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("a deleted job is there: %v", err)
	}
	if names := p.blobs(); len(names) != 0 {
		t.Errorf("blobs %v", names)
	}
}

// Coordinators tell each other what users used: nobody gets more for having jobs at several.
func TestUsageAtOneCoordinatorCountsAtAnother(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.start()
	defer first.stop()
	second.start()
	defer second.stop()
	dismiss := first.crew(workers(1, nil)...)
	first.finished(first.submitAs("ada", 0, chainsRequest(20)))
	dismiss()
	older := second.submitAs("ada", 0, chainsRequest(20))
	newer := second.submitAs("ben", 0, chainsRequest(20))
	p.eventually("behind the other user's job", func() bool {
		at := make(map[string]int)
		for _, j := range second.c.Own() {
			at[j.ID] = j.QueuePosition
		}
		return at[newer] == 1 && at[older] == 2
	})
}
