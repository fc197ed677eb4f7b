package coordinator_test

import (
	"context"
	"errors"
	"io"
	"slices"
	"strings"
	"sync"
	"testing"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// gate is before a backend, and holds up what concerns some jobs until it is opened, as a store of blobs
// does that does not answer.
type gate struct {
	blob.Backend
	mu     sync.Mutex
	shut   map[string]chan struct{} // by job; closed when it opens
	held   int                      // calls that it holds up
	broken int                      // calls that ended before it opened
	full   func(blob.Key) bool      // whether there is no space for a blob; nil: there is for all
}

// fill makes writes fail from now on, as a disk does that is full; nil: they succeed again.
func (g *gate) fill(full func(blob.Key) bool) {
	g.mu.Lock()
	defer g.mu.Unlock()
	g.full = full
}

func (g *gate) fits(key blob.Key) bool {
	g.mu.Lock()
	full := g.full
	g.mu.Unlock()
	return full == nil || !full(key)
}

var errFull = errors.New("no space left on device")

// fullFile takes nothing.
type fullFile struct{}

func (fullFile) Write([]byte) (int, error) { return 0, errFull }

func (g *gate) close(job string) {
	g.mu.Lock()
	defer g.mu.Unlock()
	if g.shut == nil {
		g.shut = make(map[string]chan struct{})
	}
	g.shut[job] = make(chan struct{})
}

func (g *gate) open(job string) {
	g.mu.Lock()
	defer g.mu.Unlock()
	if g.shut[job] != nil {
		close(g.shut[job])
		delete(g.shut, job)
	}
}

// waits until a blob's job may pass.
func (g *gate) waits(ctx context.Context, key blob.Key) error {
	g.mu.Lock()
	defer g.mu.Unlock()
	for id, opened := range g.shut {
		if !strings.Contains(key.Name, id) {
			continue
		}
		g.held++
		g.mu.Unlock()
		select {
		case <-opened:
		case <-ctx.Done():
		}
		g.mu.Lock()
		g.held--
		if ctx.Err() != nil {
			g.broken++
			return ctx.Err()
		}
	}
	return nil
}

func (g *gate) count() (held, broken int) {
	g.mu.Lock()
	defer g.mu.Unlock()
	return g.held, g.broken
}

func (g *gate) Write(ctx context.Context, key blob.Key, fill func(io.Writer) error) error {
	if err := g.waits(ctx, key); err != nil {
		return err
	}
	if !g.fits(key) {
		return g.Backend.Write(ctx, key, func(io.Writer) error { return fill(fullFile{}) })
	}
	return g.Backend.Write(ctx, key, fill)
}

func (g *gate) Open(ctx context.Context, key blob.Key) (io.ReadCloser, error) {
	if err := g.waits(ctx, key); err != nil {
		return nil, err
	}
	return g.Backend.Open(ctx, key)
}

// longRequest lasts until somebody finishes it.
func longRequest() job.Request {
	request := chainsRequest(0)
	request.Stop = job.StopRules{TimeSeconds: 3600}
	return request
}

func (p *pair) held(g *gate) {
	p.t.Helper()
	p.eventually("held up", func() bool { n, _ := g.count(); return n > 0 })
}

// A checkpoint that takes for ever holds up neither those of other jobs nor the leases.
func TestASlowCheckpointHoldsUpNoOtherJob(t *testing.T) {
	t.Parallel()
	request := chainsRequest(60)
	want := reference(t, request)
	const ttl = 2 * time.Second
	p := newPair(t, ttl)
	s := p.sites[0]
	s.gate = &gate{}
	s.start()
	defer s.stop()
	defer s.crew(workers(2, nil)...)()
	slow := s.submit(request)
	s.gate.close(slow)
	defer s.gate.open(slow)
	p.held(s.gate)
	quick := s.submit(request)
	sameFilm(t, s.finished(quick), want)
	p.eventually("without owner", func() bool { return p.record(quick).Owner.ID == "" })
	for start := time.Now(); time.Since(start) < 2*ttl; time.Sleep(ttl / 20) {
		p.eventually("ready", func() bool { return s.c.Ready(t.Context()) == nil })
		if owner := p.record(slow).Owner.ID; owner != "first" {
			t.Fatalf("owner %q", owner)
		}
	}
	if name := p.record(slow).Checkpoint; name != "" {
		t.Errorf("checkpoint %s", name)
	}
	s.gate.open(slow)
	sameFilm(t, s.finished(slow), want)
}

// A checkpoint that cannot be read holds up no other job that is taken over, nor the leases.
func TestATakeoverHoldsUpNoOther(t *testing.T) {
	t.Parallel()
	p := newPair(t, 0) // as in production
	first, second := p.sites[0], p.sites[1]
	first.start()
	dismiss := first.crew(workers(2, slowly)...)
	var ids []string
	for _, user := range []string{"ada", "ben", "cleo", "dan"} { // who get equal shares
		ids = append(ids, first.submitAs(user, 0, longRequest()))
	}
	for _, id := range ids {
		p.checkpointed(id)
	}
	second.gate = &gate{}
	second.gate.close(ids[0])
	second.start()
	defer second.stop()
	defer second.gate.open(ids[0])
	p.lines[0].cut.Store(true)
	killed := time.Now()
	first.cancel()
	dismiss()
	first.server.Stop()
	<-first.done
	goesOn := func(id string) bool { return second.countEvents(id, "goes on with the job") > 0 }
	p.eventually("going on", func() bool { return !slices.ContainsFunc(ids[1:], func(id string) bool { return !goesOn(id) }) })
	if took := time.Since(killed); took > takeover {
		t.Errorf("taken over after %v", took)
	}
	p.held(second.gate)
	time.Sleep(7 * time.Second) // longer than a lease
	for i, id := range ids {
		if owner := p.record(id).Owner.ID; owner != "second" || goesOn(id) != (i > 0) {
			t.Errorf("job %d: owner %q, goes on: %v", i, owner, goesOn(id))
		}
	}
	second.gate.open(ids[0])
	p.eventually("going on", func() bool { return goesOn(ids[0]) })
}

// Several coordinators share what they take over, however quickly the first one looks.
func TestTakeoversAreShared(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.start()
	second.start()
	defer second.stop()
	for range 6 {
		first.submit(longRequest())
	}
	third := &site{t: t, dir: first.dir, address: "127.0.0.1:0", shared: p.store, tune: second.tune}
	third.tune = func(o *coordinator.Options) { second.tune(o); o.Member.ID, o.Member.REST = "third", "http://third" }
	third.start()
	defer third.stop()
	first.stop()
	p.eventually("taken over", func() bool { return len(second.c.Own())+len(third.c.Own()) == 6 })
	if a, b := len(second.c.Own()), len(third.c.Own()); a == 0 || b == 0 {
		t.Errorf("%d and %d jobs", a, b)
	}
}

// Who leaves hands over what it can, and writes nothing for what it has released.
func TestASlowCheckpointHoldsUpNoHandover(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.gate = &gate{}
	first.start()
	dismiss := first.crew(workers(2, slowly)...)
	slow, quick := first.submitAs("ada", 0, longRequest()), first.submitAs("ben", 0, longRequest())
	p.checkpointed(slow)
	p.checkpointed(quick)
	first.gate.close(slow)
	p.held(first.gate)
	dismiss()
	first.server.Stop()
	first.cancel()
	second.start()
	defer second.stop()
	p.eventually("handed over", func() bool { return p.record(quick).Owner.ID == "second" })
	select {
	case <-first.done:
		t.Error("left before the last checkpoint was written")
	default:
	}
	if owner := p.record(slow).Owner.ID; owner != "first" {
		t.Errorf("released to %q before its checkpoint was written", owner)
	}
	first.gate.open(slow)
	<-first.done
	p.eventually("handed over", func() bool { return p.record(slow).Owner.ID == "second" })
}

// A job that another coordinator has taken over, or that is deleted, is not written any more.
func TestNothingIsWrittenForAJobThatIsGone(t *testing.T) {
	t.Parallel()
	p := newPair(t, time.Second)
	first, second := p.sites[0], p.sites[1]
	first.gate = &gate{}
	first.start()
	defer first.stop()
	dismiss := first.crew(workers(2, func(w *fakeworker.Worker) { w.Delay = 100 * time.Millisecond })...)
	defer dismiss()
	deleted, lost := first.submitAs("ada", 0, longRequest()), first.submitAs("ben", 0, longRequest())
	for _, id := range []string{deleted, lost} {
		first.gate.close(id)
		defer first.gate.open(id)
	}
	p.eventually("held up both", func() bool { n, _ := first.gate.count(); return n == 2 })
	if _, err := first.c.Cancel(t.Context(), deleted); err != nil {
		t.Fatal(err)
	}
	if err := first.c.Delete(t.Context(), deleted); err != nil {
		t.Fatal(err)
	}
	if _, broken := first.gate.count(); broken != 1 {
		t.Errorf("%d transfers were ended, not that of the job that is deleted", broken)
	}
	p.lines[0].frozen.Store(true)
	second.start()
	defer second.stop()
	p.eventually("taken over", func() bool { return p.record(lost).Owner.ID == "second" })
	p.lines[0].frozen.Store(false)
	p.eventually("dropped", func() bool { return len(first.c.Own()) == 0 })
	p.eventually("ended", func() bool { held, broken := first.gate.count(); return held == 0 && broken == 2 })
	for _, name := range p.blobs() {
		if strings.Contains(name, deleted) || strings.Contains(name, lost+"-1-") {
			t.Errorf("blob %s was written", name)
		}
	}
	if _, err := first.c.Job(t.Context(), deleted); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("a deleted job is there: %v", err)
	}
}

// A job goes on while its checkpoints cannot be written, but does not end before its last one is.
func TestACheckpointThatCannotBeWritten(t *testing.T) {
	t.Parallel()
	request := chainsRequest(60)
	want := reference(t, request)
	for name, meanwhile := range map[string]func(*site){
		"until there is space":       func(s *site) { s.gate.fill(nil) },
		"and its coordinator dies":   func(s *site) { s.kill(); s.gate.fill(nil); s.start() },
		"and its coordinator leaves": func(s *site) { s.stop(); s.gate.fill(nil); s.start() },
	} {
		t.Run(name, func(t *testing.T) {
			t.Parallel()
			s := newSite(t)
			s.gate = &gate{}
			s.start()
			defer func() { s.stop() }()
			id := s.submit(request)
			c := s.c
			s.gate.fill(func(key blob.Key) bool {
				j, err := c.Job(context.Background(), id)
				return strings.Contains(key.Name, id) && (err != nil || j.RoundsDone >= 2)
			})
			defer s.crew(workers(2, nil)...)()
			s.await(id, "rendered to the end", func(j job.Snapshot) bool { return j.RoundsDone == want.RoundsDone })
			s.awaitFailures(id, 2)
			if state := s.job(id).State; state != job.Rendering {
				t.Fatalf("the job is %s without its last checkpoint", state)
			}
			meanwhile(s)
			sameFilm(t, s.finished(id), want)
			image, err := s.c.Image(t.Context(), id)
			s.check(err)
			if image.FilmSHA256 != want.FilmSHA256 {
				t.Errorf("the image is of film %s, want %s", image.FilmSHA256, want.FilmSHA256)
			}
		})
	}
}

// awaitFailures waits until so many checkpoints could not be written, of which the job's log tells once.
func (s *site) awaitFailures(id string, failures float64) {
	s.t.Helper()
	for deadline := time.Now().Add(patience); gather(s.t, s.c.Collector())["metrofarm_checkpoint_failures_total"] < failures; {
		if time.Now().After(deadline) {
			s.t.Fatalf("fewer than %g checkpoints failed", failures)
		}
		time.Sleep(2 * time.Millisecond)
	}
	events, _, err := s.c.Events(s.t.Context(), id, 0)
	s.check(err)
	told := slices.DeleteFunc(events, func(e job.Event) bool {
		return e.Kind != "fault" || !strings.Contains(e.Message, "the checkpoint cannot be written")
	})
	if len(told) != 1 {
		s.t.Errorf("the job's log tells of it %d times: %v", len(told), told)
	}
}
