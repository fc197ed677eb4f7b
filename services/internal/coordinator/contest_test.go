package coordinator_test

import (
	"slices"
	"strings"
	"sync"
	"testing"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// lateCopy is a job with a segment that two workers have rendered: first counted it, late is about to
// deliver it too. third holds other segments of the round, so that it stays open, until it is let go.
type lateCopy struct {
	*site
	id                 string
	deliver, letThird  func()
	first, late, third *fakeworker.Worker
}

// newLateCopy starts one whose workers are changed before; with open false the round is closed.
func newLateCopy(t *testing.T, request job.Request, open bool, patience time.Duration, change func(*lateCopy)) *lateCopy {
	t.Helper()
	s := checking(t, -1, func(o *coordinator.Options) {
		o.LeaseTTL = time.Hour // nothing straggles by itself
		if o.CheckPatience = patience; patience == 0 {
			o.CheckPatience = time.Hour
		}
	})
	t.Cleanup(func() { s.stop() })
	crew := workers(3, nil)
	l := &lateCopy{site: s, third: crew[0], late: crew[1], first: crew[2]}
	change(l)
	holding, released := make(chan struct{}), make(chan struct{})
	thirdGoes, lateGoes := make(chan struct{}), make(chan struct{})
	l.letThird = sync.OnceFunc(func() { close(thirdGoes) })
	l.deliver = sync.OnceFunc(func() { close(lateGoes) })
	t.Cleanup(l.letThird)
	t.Cleanup(l.deliver)
	l.third.Rendered = once(func(*farmv1.BatchHeader) { close(holding); <-thirdGoes })
	l.late.Rendered = once(func(h *farmv1.BatchHeader) {
		in := &farmv1.ReleaseRequest{WorkerId: s.workers()["b"].ID}
		for _, segment := range h.GetSegments() {
			in.Leases = append(in.Leases, segment.GetLease())
		}
		if _, err := s.c.Release(t.Context(), in); err != nil {
			t.Error(err)
		}
		close(released)
		<-lateGoes
	})
	if !open {
		l.first.Rendered = func(h *farmv1.BatchHeader, _ []*farmv1.Tile) {
			if h.GetRound() > 0 {
				<-lateGoes
			}
		}
	}
	l.id = s.submit(request)
	s.crew(l.third)
	<-holding
	s.crew(l.late)
	<-released
	s.crew(l.first)
	s.await(l.id, "rendered but for what the third holds", func(j job.Snapshot) bool { return j.RoundSegmentsDone == 12 })
	if open {
		return l
	}
	l.letThird()
	s.await(l.id, "in its second round", func(j job.Snapshot) bool { return j.RoundsDone == 1 })
	return l
}

// once calls f with the first batch.
func once(f func(*farmv1.BatchHeader)) func(*farmv1.BatchHeader, []*farmv1.Tile) {
	var first sync.Once
	return func(h *farmv1.BatchHeader, _ []*farmv1.Tile) { first.Do(func() { f(h) }) }
}

// awaitFlags waits until both workers are flagged.
func (l *lateCopy) awaitFlags() {
	l.t.Helper()
	for deadline := time.Now().Add(patience); ; time.Sleep(time.Millisecond) {
		seen := l.workers()
		if seen["b"].Conflicts > 0 && seen["c"].Conflicts > 0 {
			return
		}
		if time.Now().After(deadline) {
			l.t.Fatalf("not both flagged: %+v", seen)
		}
	}
}

func (l *lateCopy) expectExcluded(liar string) {
	l.t.Helper()
	for name, w := range l.workers() {
		if (w.Exclusion != "") != (name == liar) || (w.Conflicts > 0) != (name == liar) {
			l.t.Errorf("worker %s: %d conflicts, excluded %q", name, w.Conflicts, w.Exclusion)
		}
	}
}

// Whoever of the two is wrong, a third decides, and the film is right.
func TestALateCopyThatDisagreesIsDecidedByAThird(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	for liar, change := range map[string]func(*lateCopy){
		"b": func(l *lateCopy) { l.late.Lie = 12345 },
		"c": func(l *lateCopy) { l.first.Lie = 12345 },
	} {
		t.Run(liar, func(t *testing.T) {
			t.Parallel()
			l := newLateCopy(t, request, true, 0, change)
			l.deliver()
			l.awaitFlags()
			l.letThird()
			done := l.finished(l.id)
			sameFilm(t, done, want)
			l.expectExcluded(liar)
			again := map[string]int{"b": 0, "c": 1}[liar]
			if n := l.countEvents(l.id, "is rendered again"); n != again {
				t.Errorf("rounds were rendered again %d times, want %d", n, again)
			}
			if len(done.Warnings) > 0 {
				t.Errorf("warnings %q: nothing wrong is in the image", done.Warnings)
			}
		})
	}
}

// Nobody decides: the job pauses, what was counted is rendered again and the segment is checked.
func TestALateCopyThatNobodyDecidesAboutPausesTheJob(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	l := newLateCopy(t, request, true, 200*time.Millisecond, func(l *lateCopy) { l.first.Lie = 12345 })
	l.deliver()
	paused := l.await(l.id, "paused", func(j job.Snapshot) bool { return j.Paused })
	if paused.Mutations != 0 {
		t.Errorf("%d mutations are still counted", paused.Mutations)
	}
	l.letThird()
	if _, err := l.c.Resume(t.Context(), l.id); err != nil {
		t.Fatal(err)
	}
	l.await(l.id, "done or paused", func(j job.Snapshot) bool {
		if j.Paused { // the third came too late once more
			_, _ = l.c.Resume(t.Context(), l.id)
		}
		return j.State.Ended()
	})
	// Before it was found out it may have rendered what nobody checked.
	if done := l.finished(l.id); done.FilmSHA256 != want.FilmSHA256 &&
		!slices.ContainsFunc(done.Warnings, func(w string) bool { return strings.Contains(w, "in the image unchecked") }) {
		t.Errorf("a wrong film, and warnings %q", done.Warnings)
	}
	if seen := l.workers(); seen["c"].Exclusion == "" || seen["a"].Exclusion+seen["b"].Exclusion != "" {
		t.Errorf("excluded: %+v", seen)
	}
}

// A coordinator that leaves before it is decided, with a checkpoint that has the wrong segment, leaves
// nothing of it in the film of the next one.
func TestADisputedSegmentDoesNotOutliveItsCoordinator(t *testing.T) {
	request := chainsRequest(30)
	want := reference(t, request)
	l := newLateCopy(t, request, true, 0, func(l *lateCopy) {
		l.first.Lie = 12345
		rendered := 0
		l.first.Rendered = func(h *farmv1.BatchHeader, _ []*farmv1.Tile) {
			if h.GetRound() == 0 {
				rendered += len(h.GetSegments())
			}
			if rendered == 12 { // all that the third has not: it is honest from now on
				l.first.Lie = 0
			}
		}
	})
	l.deliver()
	l.awaitFlags()
	l.stop()
	l.start()
	l.letThird()
	done := l.finished(l.id)
	if n := l.countEvents(l.id, "goes on with the job"); n != 1 {
		t.Errorf("the job went on %d times", n)
	}
	sameFilm(t, done, want)
}

// The round is closed: nobody can decide any more, but nobody keeps quiet about it.
func TestALateCopyOfAClosedRoundIsToldOf(t *testing.T) {
	l := newLateCopy(t, chainsRequest(30), false, 0, func(l *lateCopy) { l.late.Lie = 12345 })
	l.deliver()
	done := l.finished(l.id)
	l.awaitFlags()
	if len(done.Warnings) != 1 || l.countEvents(l.id, "of a round that is closed") == 0 {
		t.Errorf("warnings %q", done.Warnings)
	}
}
