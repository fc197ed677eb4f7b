package coordinator

import (
	"cmp"
	"context"
	"errors"
	"fmt"
	"slices"
	"sync"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
)

// The films of all jobs of a coordinator share a budget. A job needs room for what plan.Memory
// estimates from the moment its size is known: when its scene was inspected, when auto has chosen an
// integrator, or when it is taken over or refined with a checkpoint. Where there is none it waits,
// queued, and holds nothing; the first of those that wait by priority and age goes on when its film
// fits, and nobody passes it, or a large film would wait for ever. Jobs without owner that do not fit
// stay where they are, so that another coordinator may take them, but keep their place here: smaller
// jobs behind them wait too. A film always fits where there is no other.

// room is the memory of films: what is granted, and who waits. Methods may be called from several
// goroutines.
type room struct {
	budget int64 // 0: no bound

	mu      sync.Mutex
	used    int64
	granted map[*run]int64
	waiting []*guest          // by priority, then by age
	strange map[string]*guest // those of them that nobody owns, by job
}

// guest is a job that waits for room: of this coordinator, or one that nobody owns (run nil).
type guest struct {
	run      *run
	priority int
	number   uint64
	bytes    int64
}

func newRoom(budget int64) *room {
	return &room{budget: budget, granted: make(map[*run]int64), strange: make(map[string]*guest)}
}

func compareGuests(a, b *guest) int {
	return cmp.Or(cmp.Compare(b.priority, a.priority), cmp.Compare(a.number, b.number))
}

// fits requires: mu.
func (m *room) fits(bytes int64) bool {
	return m.budget == 0 || m.used == 0 || m.used+bytes <= m.budget
}

// enter grants a job its room if it fits and nobody before it waits; else false. What it had before
// is replaced, also if it is refused.
func (m *room) enter(r *run, priority int, bytes int64) bool {
	m.mu.Lock()
	defer m.mu.Unlock()
	m.leave(r)
	mine := &guest{run: r, priority: priority, number: r.number, bytes: bytes}
	if !m.fits(bytes) || len(m.waiting) > 0 && compareGuests(m.waiting[0], mine) < 0 {
		return false
	}
	m.grant(r, bytes)
	return true
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
		case g.run != nil && !ready(g.run):
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

// receive tells whether a job that nobody owns may be taken over. If not, it keeps a place in the line.
func (m *room) receive(id string, priority int, number uint64, bytes int64) bool {
	m.mu.Lock()
	defer m.mu.Unlock()
	m.forget(id)
	mine := &guest{priority: priority, number: number, bytes: bytes}
	if bytes == 0 || m.fits(bytes) && (len(m.waiting) == 0 || compareGuests(mine, m.waiting[0]) < 0) {
		return true
	}
	m.strange[id] = mine
	m.join(mine)
	return false
}

// keep forgets the jobs without owner that are not among these any more: others have taken them.
func (m *room) keep(ids []string) {
	m.mu.Lock()
	defer m.mu.Unlock()
	for id := range m.strange {
		if !slices.Contains(ids, id) {
			m.forget(id)
		}
	}
}

// forget requires: mu.
func (m *room) forget(id string) {
	if known := m.strange[id]; known != nil {
		delete(m.strange, id)
		m.waiting = slices.DeleteFunc(m.waiting, func(g *guest) bool { return g == known })
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

// needs is the memory of a job's film by its spec. Requires: mu; spec is set.
func (r *run) needs() int64 {
	bytes, _ := plan.Memory(r.spec)
	return int64(bytes)
}

// whenThereIsRoom goes on with a job, at once or when its film fits. Requires: mu; spec is set, no
// task is open.
func (r *run) whenThereIsRoom(goOn func()) {
	r.rec.FilmBytes = r.needs()
	defer r.leaveRoomIfGone()
	if r.c.room.enter(r, r.rec.Request.Priority, r.rec.FilmBytes) {
		goOn()
		return
	}
	r.c.room.wait(r, r.rec.Request.Priority, r.rec.FilmBytes)
	r.parked = goOn
	r.setState(job.Queued, r.waitsForRoom())
	r.c.wake()
}

// leaveRoomIfGone: a job that is lost meanwhile was taken out of the room before it entered.
func (r *run) leaveRoomIfGone() {
	if r.gone.Load() {
		r.c.room.remove(r)
	}
}

// waitingForRoom requires: mu.
func (r *run) waitingForRoom() bool { return r.parked != nil && !r.rec.State.Ended() }

// waitsForRoom says what a job waits for. Requires: mu.
func (r *run) waitsForRoom() string {
	const mebi = 1 << 20
	used, budget := r.c.room.state()
	return fmt.Sprintf("waiting for memory: the film takes up to %d MiB, and those of other jobs %d of %d MiB",
		r.rec.FilmBytes/mebi, used/mebi, budget/mebi)
}

// letIn lets jobs go on whose films fit by now.
func (c *Coordinator) letIn() {
	for {
		r := c.room.next((*run).mayGoOn)
		if r == nil || !r.unpark() {
			return
		}
	}
}

// mayGoOn tells whether a job that waits for room would go on if it had it.
func (r *run) mayGoOn() bool { return !r.gone.Load() && !r.standing.idle.Load() }

// unpark goes on with a job that has its room now; false: the store is out of reach, and it waits on.
func (r *run) unpark() bool {
	defer r.c.announce()
	r.mu.Lock()
	defer r.mu.Unlock()
	switch {
	case r.parked == nil || r.rec.State.Ended() || r.gone.Load():
		r.c.room.remove(r)
		return true
	case r.rec.Paused || !r.mayAct():
		r.c.room.wait(r, r.rec.Request.Priority, r.rec.FilmBytes)
		return false
	}
	goOn := r.parked
	r.parked = nil
	goOn()
	r.save()
	return true
}

// hasRoomFor tells whether a job that nobody owns may be taken over now.
func (c *Coordinator) hasRoomFor(ctx context.Context, id string) (bool, error) {
	stored, err := c.options.Store.Job(ctx, id)
	switch {
	case errors.Is(err, job.ErrNotFound):
		return false, nil
	case err != nil:
		return false, err
	case stored.State.Ended():
		return true, nil // it only needs to be stored with all that belongs to it
	}
	strange := c.room.strangeTo(id)
	takes := c.room.receive(id, stored.Request.Priority, stored.Number, stored.FilmBytes)
	if !takes && !strange {
		c.log.Info("job without owner is not taken over: there is no room for its film", "job", id, "film_bytes", stored.FilmBytes)
	}
	return takes, nil
}

// takeToCancel takes over a job that no coordinator has room for, if this is one: to be canceled it
// must be owned. It is read as a job that has ended is.
func (c *Coordinator) takeToCancel(ctx context.Context, id string) error {
	if !c.room.strangeTo(id) {
		return nil
	}
	stored, err := c.options.Store.Job(ctx, id)
	if err != nil {
		return err
	}
	done, err := c.readers.enter(ctx, id, stored.FilmBytes, c.options.ReadPatience)
	if err != nil {
		return err
	}
	defer done()
	rec, epoch, err := c.options.Store.Acquire(ctx, c.claim(), id)
	if err != nil {
		return fmt.Errorf("job %s: %w: %w", id, job.ErrUnavailable, err)
	}
	c.take(ctx, c.newRun(rec, epoch))
	return nil
}
