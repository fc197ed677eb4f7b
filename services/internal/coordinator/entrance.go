package coordinator

import (
	"context"
	"errors"
	"fmt"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
)

// How jobs enter the room for films (room.go), and wait for it.

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
	if r.c.room.enter(r, r.rec.Request.Priority, r.rec.FilmBytes, (*run).mayGoOn) {
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

// standBack gives back the room of a paused job that was taken over without a usable checkpoint: it has no
// film before its scene is inspected, which asks for room again, and that may be long. Requires: mu.
func (r *run) standBack() {
	if r.rec.Paused && r.spec == nil {
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
	defer r.leaveRoomIfGone()
	priority, bytes := r.rec.Request.Priority, r.rec.FilmBytes
	switch {
	case r.parked == nil || r.rec.State.Ended() || r.gone.Load():
		r.c.room.remove(r)
		return true
	case r.rec.Paused || !r.mayAct():
		r.c.room.wait(r, priority, bytes)
		return false
	case !r.c.room.enter(r, priority, bytes, (*run).mayGoOn): // a change of its priority has put it back in line
		r.c.room.wait(r, priority, bytes)
		return true
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
	takes := c.room.receive(id, &guest{
		priority: stored.Request.Priority, number: stored.Number, bytes: stored.FilmBytes, paused: stored.Paused,
	}, (*run).mayGoOn)
	if !takes && !strange {
		c.log.Info("job without owner is not taken over: there is no room for its film", "job", id, "film_bytes", stored.FilmBytes)
	}
	return takes, nil
}

// takeToCancel has a job taken over that no coordinator has room for, if this is one: to be canceled it
// must be owned. It returns when that is so.
func (c *Coordinator) takeToCancel(ctx context.Context, id string) error {
	if !c.room.invite(id) {
		return nil
	}
	ctx, cancel := context.WithTimeout(ctx, c.options.ReadPatience)
	defer cancel()
	for {
		taken, err := c.isTaken(ctx, id)
		if err != nil || taken {
			return err
		}
		select {
		case <-ctx.Done():
			return fmt.Errorf("job %s is about to be taken over: %w", id, job.ErrUnavailable)
		case <-time.After(c.options.Tick):
		}
	}
}

// isTaken tells whether a job can be acted on here, or belongs to another coordinator.
func (c *Coordinator) isTaken(ctx context.Context, id string) (bool, error) {
	if r := c.running(id); r != nil {
		r.mu.Lock()
		defer r.mu.Unlock()
		return !r.loading, nil
	}
	stored, err := c.options.Store.Job(ctx, id)
	return c.elsewhere(stored.Owner) && stored.Owner.ID != "", err
}
