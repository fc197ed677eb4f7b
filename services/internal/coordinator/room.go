package coordinator

import (
	"cmp"
	"maps"
	"slices"
	"sync"
)

// The films of all jobs of a coordinator share a budget. A job needs room for what plan.Memory
// estimates from the moment its size is known: when its scene was inspected, when auto has chosen an
// integrator, or when it is taken over or refined with a checkpoint. Where there is none it waits,
// queued, and holds nothing; the first of those that wait by priority and age goes on when its film
// fits, and nobody passes it, or a large film would wait for ever; only who is paused stands aside. Jobs
// without owner that do not fit stay where they are, so that another coordinator may take them, but keep
// their place here: smaller jobs behind them wait too. One that is paused stands aside until somebody asks
// for it. A film always fits where there is no other.

// room is the memory of films: what is granted, and who waits. Methods may be called from several
// goroutines.
type room struct {
	budget int64 // 0: no bound

	mu       sync.Mutex
	used     int64
	granted  map[*run]int64
	expected map[string]int64  // granted to jobs that are being taken over
	waiting  []*guest          // by priority, then by age
	strange  map[string]*guest // those of them that nobody owns, by job
}

// guest is a job that waits for room: of this coordinator, or one that nobody owns (run nil).
type guest struct {
	run      *run
	priority int
	number   uint64
	bytes    int64
	// Of those that nobody owns:
	invited bool // it is taken over whether it fits or not
	paused  bool // it stands aside,
	wanted  bool // unless somebody waits to act on it
}

// aside tells whether others may pass a guest. ready is that of room.next.
func (g *guest) aside(ready func(*run) bool) bool {
	if g.run == nil {
		return g.paused && !g.wanted
	}
	return !ready(g.run)
}

func newRoom(budget int64) *room {
	return &room{
		budget: budget, granted: make(map[*run]int64), expected: make(map[string]int64), strange: make(map[string]*guest),
	}
}

func compareGuests(a, b *guest) int {
	return cmp.Or(cmp.Compare(b.priority, a.priority), cmp.Compare(a.number, b.number))
}

// fits requires: mu.
func (m *room) fits(bytes int64) bool {
	return m.budget == 0 || m.used == 0 || m.used+bytes <= m.budget
}

// enter grants a job its room if it fits and nobody before it waits; else false. What it had before
// is replaced, also if it is refused. ready is that of next.
func (m *room) enter(r *run, priority int, bytes int64, ready func(*run) bool) bool {
	m.mu.Lock()
	defer m.mu.Unlock()
	m.leave(r)
	mine := &guest{run: r, priority: priority, number: r.number, bytes: bytes}
	if !m.fits(bytes) || !m.isFirst(mine, ready) {
		return false
	}
	m.grant(r, bytes)
	return true
}

// isFirst tells whether nobody waits before a guest, but for those that stand aside. Requires: mu.
func (m *room) isFirst(mine *guest, ready func(*run) bool) bool {
	at := slices.IndexFunc(m.waiting, func(g *guest) bool { return !g.aside(ready) })
	return at < 0 || compareGuests(mine, m.waiting[at]) <= 0
}

// grant requires: mu; the job has no room.
func (m *room) grant(r *run, bytes int64) {
	m.granted[r] = bytes
	m.used += bytes
}

// force grants a job its room in any case: its film is in memory already.
func (m *room) force(r *run, bytes int64) {
	m.mu.Lock()
	defer m.mu.Unlock()
	m.leave(r)
	m.forget(r.id)
	m.grant(r, bytes)
}

// wait lets a job that was refused stand in line.
func (m *room) wait(r *run, priority int, bytes int64) {
	m.mu.Lock()
	defer m.mu.Unlock()
	m.leave(r)
	m.join(&guest{run: r, priority: priority, number: r.number, bytes: bytes})
}

// join requires: mu.
func (m *room) join(g *guest) {
	at, _ := slices.BinarySearchFunc(m.waiting, g, compareGuests)
	m.waiting = slices.Insert(m.waiting, at, g)
}

// remove gives back what a job has, or its place in the line.
func (m *room) remove(r *run) {
	m.mu.Lock()
	defer m.mu.Unlock()
	m.leave(r)
}

// leave requires: mu.
func (m *room) leave(r *run) {
	m.used -= m.granted[r]
	delete(m.granted, r)
	m.waiting = slices.DeleteFunc(m.waiting, func(g *guest) bool { return g.run == r })
}

// next returns the job of this coordinator that is first in line, once there is room for it, which it
// has then; nil: there is none. ready tells whether a job can go on at all: others stand aside.
func (m *room) next(ready func(*run) bool) *run {
	m.mu.Lock()
	defer m.mu.Unlock()
	for _, g := range m.waiting {
		switch {
		case g.aside(ready):
			continue
		case g.run == nil || !m.fits(g.bytes):
			return nil
		}
		m.leave(g.run)
		m.grant(g.run, g.bytes)
		return g.run
	}
	return nil
}

// receive tells whether a job that nobody owns may be taken over, and then expects it: it has its room
// until it is forced in or forgotten. If not, it keeps a place in the line. ready is that of next.
func (m *room) receive(id string, mine *guest, ready func(*run) bool) bool {
	m.mu.Lock()
	defer m.mu.Unlock()
	if known := m.strange[id]; known != nil {
		mine.invited, mine.wanted = known.invited, known.wanted
	}
	m.forget(id)
	if mine.bytes == 0 || m.fits(mine.bytes) && m.isFirst(mine, ready) || mine.invited {
		m.expected[id] = mine.bytes
		m.used += mine.bytes
		return true
	}
	m.strange[id] = mine
	m.join(mine)
	return false
}

// keep forgets the jobs without owner that are not among these any more: they have one.
func (m *room) keep(ids []string) {
	m.mu.Lock()
	defer m.mu.Unlock()
	for _, known := range [][]string{slices.Collect(maps.Keys(m.strange)), slices.Collect(maps.Keys(m.expected))} {
		for _, id := range known {
			if !slices.Contains(ids, id) {
				m.forget(id)
			}
		}
	}
}

// forget requires: mu.
func (m *room) forget(id string) {
	m.used -= m.expected[id]
	delete(m.expected, id)
	if known := m.strange[id]; known != nil {
		delete(m.strange, id)
		m.waiting = slices.DeleteFunc(m.waiting, func(g *guest) bool { return g == known })
	}
}

// invite has a job that waits and that nobody owns taken over at the next look; false: it is none.
func (m *room) invite(id string) bool {
	m.mu.Lock()
	defer m.mu.Unlock()
	known := m.strange[id]
	if known != nil {
		known.invited = true
	}
	return known != nil
}

// recall gives a paused job that nobody owns its place in the line back: somebody waits to act on it.
func (m *room) recall(id string) {
	m.mu.Lock()
	defer m.mu.Unlock()
	if known := m.strange[id]; known != nil {
		known.wanted = true
	}
}

// strangeTo tells whether a job waits that nobody owns.
func (m *room) strangeTo(id string) bool {
	m.mu.Lock()
	defer m.mu.Unlock()
	return m.strange[id] != nil
}

// state is for people: what films may take by now, and together at most.
func (m *room) state() (used, budget int64) {
	m.mu.Lock()
	defer m.mu.Unlock()
	return m.used, m.budget
}
