package coordinator

import "testing"

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
