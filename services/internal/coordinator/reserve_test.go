package coordinator

import (
	"errors"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

func anybody(*run) bool { return true }

func TestAJobThatIsBeingTakenOverHasItsRoom(t *testing.T) {
	m := newRoom(10)
	younger, older := &run{id: "b", number: 2}, &run{id: "a", number: 1}
	m.wait(younger, 0, 8)
	if !m.receive(older.id, &guest{number: older.number, bytes: 8}, anybody) {
		t.Fatal("the older job is not taken over")
	}
	if m.next(anybody) != nil {
		t.Error("the younger job has the room of the one that is being taken over")
	}
	m.force(older, 9) // as its checkpoint says
	if used, _ := m.state(); used != 9 {
		t.Errorf("%d bytes are taken, want 9", used)
	}
	m.remove(older)
	if m.next(anybody) != younger {
		t.Error("the younger job waits for nothing")
	}
}

func TestAJobThatAnotherCoordinatorTookLeavesTheLine(t *testing.T) {
	m := newRoom(10)
	running, younger := &run{id: "b", number: 2}, &run{id: "c", number: 3}
	m.force(running, 4)
	if m.receive("a", &guest{number: 1, bytes: 8}, anybody) {
		t.Fatal("a job that does not fit is taken over")
	}
	if m.enter(younger, 0, 4, anybody) {
		t.Error("a younger job has passed it")
	}
	m.wait(younger, 0, 4)
	m.keep([]string{"a"})
	if m.next(anybody) != nil {
		t.Error("a younger job has passed it")
	}
	m.keep(nil)
	if m.next(anybody) != younger {
		t.Error("the younger job still waits")
	}
	if used, _ := m.state(); used != 8 {
		t.Errorf("%d bytes are taken, want 8", used)
	}
}

func TestWhoCannotGoOnStandsAside(t *testing.T) {
	m := newRoom(10)
	paused, younger := &run{id: "a", number: 1}, &run{id: "c", number: 3}
	m.wait(paused, 0, 8)
	if m.receive("b", &guest{number: 2, bytes: 4}, anybody) || m.enter(younger, 0, 4, anybody) {
		t.Fatal("a younger job has passed one that can go on")
	}
	m.keep(nil)
	ready := func(r *run) bool { return r != paused }
	if !m.receive("b", &guest{number: 2, bytes: 4}, ready) {
		t.Error("a paused job keeps one without owner waiting")
	}
	if !m.enter(younger, 0, 4, ready) {
		t.Error("a paused job keeps another one waiting")
	}
	if used, _ := m.state(); used != 8 {
		t.Errorf("%d bytes are taken, want 8", used)
	}
}

func TestAPausedJobWithoutOwnerStandsAside(t *testing.T) {
	m := newRoom(10)
	running, young, younger := &run{id: "r", number: 1}, &run{id: "y", number: 3}, &run{id: "z", number: 4}
	m.force(running, 4)
	orphan := func() bool { return m.receive("p", &guest{number: 2, bytes: 8, paused: true}, anybody) }
	if orphan() {
		t.Fatal("a job that does not fit is taken over")
	}
	if !m.enter(young, 0, 2, anybody) {
		t.Error("a paused job without owner keeps another one waiting")
	}
	m.wait(younger, 0, 2)
	if m.next(anybody) != younger {
		t.Error("a paused job without owner keeps one in line waiting")
	}
	m.remove(younger)
	m.recall("p")
	m.wait(younger, 0, 2)
	for range 2 { // however often it is looked for
		if orphan() || m.enter(younger, 0, 2, anybody) {
			t.Error("a younger job has passed one that somebody waits for")
		}
		m.wait(younger, 0, 2)
		if m.next(anybody) != nil {
			t.Error("a younger job in line has passed one that somebody waits for")
		}
	}
	m.remove(running)
	if !orphan() {
		t.Error("a job that fits is not taken over")
	}
}

func TestToResumeAJobWithoutOwnerItIsTakenOver(t *testing.T) {
	r := openRun(t, func(o *Options) { o.FilmsMemory = 10 })
	c := r.c
	c.drop(r)
	c.room.force(&run{id: "other"}, 8)
	orphan := &guest{number: 1, bytes: 4, paused: true}
	if c.room.receive(r.id, orphan, anybody) {
		t.Fatal("a job that does not fit is taken over")
	}
	_, err := c.Resume(t.Context(), r.id)
	expectOnlyTheJobUnavailable(t, err)
	if c.room.enter(&run{id: "younger", number: 2}, 0, 2, anybody) {
		t.Error("a younger job has passed it")
	}
}

func expectOnlyTheJobUnavailable(t *testing.T, err error) {
	t.Helper()
	if !errors.Is(err, job.ErrUnavailable) || errors.Is(err, store.ErrUnavailable) {
		t.Errorf("error %v, want that the job is not available", err)
	}
}

// expectRoom checks how much of the room is taken, and who has it next.
func expectRoom(t *testing.T, c *Coordinator, used int64, next *run) {
	t.Helper()
	if got, _ := c.room.state(); got != used {
		t.Errorf("%d bytes are taken, want %d", got, used)
	}
	if got := c.room.next(anybody); got != next {
		t.Errorf("somebody is next: %v, want %v", got != nil, next != nil)
	}
}

// called is a job that waited for memory and has just got it, all there is but for 6 bytes.
func called(t *testing.T, now func() time.Time) (r *run, went *bool) {
	t.Helper()
	r = openRun(t, func(o *Options) { o.FilmsMemory, o.Now = 10, now })
	other := &run{id: "other"}
	r.c.room.force(other, 8)
	went = new(bool)
	r.rec.FilmBytes, r.parked = 4, func() { *went = true }
	r.c.room.wait(r, 0, 4)
	r.c.room.remove(other)
	if r.c.room.next(anybody) != r {
		t.Fatal("it does not get its room")
	}
	return r, went
}

func TestAJobGoesOnWhenItHasItsRoom(t *testing.T) {
	r, went := called(t, nil)
	if !r.unpark() || !*went || r.parked != nil {
		t.Errorf("went on: %v", *went)
	}
	expectRoom(t, r.c, 4, nil)
}

// Its priority changes after it got its room, and another job takes that.
func TestAJobThatWasPutBackInLineWaitsOn(t *testing.T) {
	r, went := called(t, nil)
	other := &run{id: "other"}
	lower := -1
	if _, err := r.c.Change(t.Context(), r.id, job.Change{Priority: &lower}); err != nil {
		t.Fatal(err)
	}
	r.c.room.force(other, 8)
	if !r.unpark() || *went || r.parked == nil {
		t.Errorf("went on: %v", *went)
	}
	expectRoom(t, r.c, 8, nil)
	r.c.room.remove(other)
	expectRoom(t, r.c, 0, r)
	if !r.unpark() || !*went {
		t.Error("it waits for nothing")
	}
}

func TestAJobThatCannotGoOnGivesItsRoomBack(t *testing.T) {
	for name, test := range map[string]struct {
		change      func(r *run)
		goOn, waits bool
	}{
		"paused":   {func(r *run) { r.rec.Paused = true }, false, true},
		"behind":   {func(r *run) { r.behind = true }, false, true},
		"canceled": {func(r *run) { r.rec.State = job.Canceled }, true, false},
		"lost":     {func(r *run) { r.gone.Store(true) }, true, false},
	} {
		t.Run(name, func(t *testing.T) {
			r, went := called(t, nil)
			test.change(r)
			if got := r.unpark(); got != test.goOn || *went {
				t.Errorf("others are looked at: %v, it went on: %v", got, *went)
			}
			next := r
			if !test.waits {
				next = nil
			}
			expectRoom(t, r.c, 0, next)
		})
	}
}

// A job is lost without its lock, whatever goes on with it: here when the clock is looked at.
func TestAJobThatIsLostMeanwhileLeavesTheLine(t *testing.T) {
	for name, act := range map[string]func(r *run){
		"let in": func(r *run) { r.unpark() },
		"changed": func(r *run) {
			higher := 1
			_, _ = r.c.Change(t.Context(), r.id, job.Change{Priority: &higher})
		},
	} {
		t.Run(name, func(t *testing.T) {
			var losing atomic.Pointer[run]
			r, _ := called(t, func() time.Time {
				if r := losing.Load(); r != nil {
					r.gone.Store(true)
					r.c.room.remove(r)
					return time.Now().Add(2 * time.Hour) // its lease has run out
				}
				return time.Now()
			})
			losing.Store(r)
			act(r)
			losing.Store(nil)
			expectRoom(t, r.c, 0, nil)
		})
	}
}

// A paused job that waited for memory holds none after a takeover: its scene must be inspected anew.
func TestAPausedJobWithoutCheckpointTakesNoRoom(t *testing.T) {
	taken := func(t *testing.T, paused bool) *run {
		r := openRun(t, func(o *Options) { o.FilmsMemory = 10 })
		r.rec.FilmBytes, r.rec.Paused = 4, paused
		r.c.take(t.Context(), r)
		r.c.reading.Wait()
		return r
	}
	t.Run("before", func(t *testing.T) { expectRoom(t, taken(t, true).c, 0, nil) })
	t.Run("later", func(t *testing.T) {
		r := taken(t, false)
		expectRoom(t, r.c, 4, nil)
		if _, err := r.c.Pause(t.Context(), r.id); err != nil {
			t.Fatal(err)
		}
		expectRoom(t, r.c, 0, nil)
	})
}
