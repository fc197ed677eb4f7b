package coordinator

import (
	"context"
	"errors"
	"math/rand/v2"
	"slices"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// A job belongs to one coordinator at a time, by a lease in the store under an epoch. The owner renews
// its leases every third of their duration, in a goroutine that nothing else can hold up. Every
// coordinator looks for jobs whose lease has run out every sixth of it, acquires them and goes on from
// their checkpoint. With the default of 6 s, a job is taken over about 7 s after its owner was last
// heard of.
//
// An owner learns that it lost a job from a beat or from a save that is fenced off, and drops the job
// from memory: store and blobs belong to the next owner. What it leaves among the blobs, or writes there
// late, is named by no record; package sweep finds that. An owner that cannot reach the store goes on
// merging what workers deliver, but leases nothing from the lease's end on, and decides nothing that
// it cannot store. If nobody has taken its jobs when the store is back it goes on where it was.
//
// Jobs that have ended, once all of them is stored, are nobody's: any coordinator shows them from the
// store, and acquires them to delete them or to let them go on. The store keeps a list of that, at which
// all of them look as often as for jobs without owner: who follows such a job, or lists it, is told.

const (
	beatsPerTTL = 3
	looksPerTTL = 6
	// leaveTimeout bounds the release of the jobs on shutdown: their leases run out anyway.
	leaveTimeout = 3 * time.Second
)

func (c *Coordinator) claim() store.Claim {
	return store.Claim{Owner: c.options.Member.ID, TTL: c.options.OwnershipTTL}
}

// keepLeases renews the leases until ctx ends.
func (c *Coordinator) keepLeases(ctx context.Context) {
	interval := c.options.OwnershipTTL / beatsPerTTL
	for pause := interval; ; {
		select {
		case <-ctx.Done():
			return
		case <-time.After(pause):
		}
		pause = interval
		if err := c.beat(ctx); err != nil && ctx.Err() == nil {
			c.trouble(err)
			pause = interval / beatsPerTTL
		}
	}
}

// beat renews membership and leases.
func (c *Coordinator) beat(ctx context.Context) error {
	ctx, cancel := context.WithTimeout(ctx, c.options.OwnershipTTL/2)
	defer cancel()
	sent, held := c.options.Now(), c.held()
	lost, err := c.options.Store.Beat(ctx, c.presence(), c.options.OwnershipTTL, held)
	if err != nil {
		return err
	}
	for _, id := range lost {
		if r := c.running(id); r != nil && r.epoch == held[id] {
			c.lose(r)
		}
	}
	c.mu.Lock()
	c.beatAt = sent
	c.mu.Unlock()
	if c.down.Swap(false) {
		c.log.Info("store is back")
		c.wake()
		c.announce()
	}
	c.hearOfOthers(ctx)
	return nil
}

// presence is what other coordinators shall know of this one.
func (c *Coordinator) presence() store.Member {
	m := c.options.Member
	c.mu.Lock()
	defer c.mu.Unlock()
	m.Usage, m.Jobs = c.usage.Usages(c.options.Now()), c.unended()
	return m
}

// hearOfOthers takes in what others say that users used, and how many jobs they have. Without it the queue
// and the limits go by what they said last, which is no reason to stop anything.
func (c *Coordinator) hearOfOthers(ctx context.Context) {
	members, err := c.options.Store.Members(ctx)
	if err != nil {
		c.metrics.storeErrors.Inc()
		c.log.Warn("what users used at other coordinators is not known; their shares go by what was said last", "error", err)
		return
	}
	var said []map[string]float64
	crowd := make(map[string]int)
	for _, m := range members {
		if m.ID == c.options.Member.ID {
			continue
		}
		said = append(said, m.Usage)
		for user, n := range m.Jobs {
			crowd[user] += n
		}
	}
	c.mu.Lock()
	defer c.mu.Unlock()
	c.crowd = crowd
	c.usage.Elsewhere(c.options.Now(), said...)
}

// held lists the owned jobs with their epochs.
func (c *Coordinator) held() map[string]uint64 {
	c.mu.Lock()
	defer c.mu.Unlock()
	held := make(map[string]uint64, len(c.jobs))
	for id, r := range c.jobs {
		held[id] = r.epoch
	}
	return held
}

// suspended tells whether the leases may have run out: nothing may be promised any more.
func (c *Coordinator) suspended() bool {
	c.mu.Lock()
	defer c.mu.Unlock()
	return c.options.Now().Sub(c.beatAt) > c.options.OwnershipTTL
}

// trouble notes that the store failed. An outage passes; anything else ends Run.
func (c *Coordinator) trouble(err error) {
	c.metrics.storeErrors.Inc()
	switch {
	case !errors.Is(err, store.ErrUnavailable):
		c.fatal(err)
	case !c.down.Swap(true):
		c.log.Warn("store cannot be reached; jobs go on as far as they can without it", "error", err)
	}
}

// lose drops a job that another coordinator owns.
func (c *Coordinator) lose(r *run) {
	if r.gone.Swap(true) {
		return
	}
	c.log.Warn("job has moved to another coordinator", "job", r.id, "epoch", r.epoch)
	c.metrics.lost.Inc()
	c.drop(r)
}

// drop forgets a job without touching what is stored.
func (c *Coordinator) drop(r *run) {
	r.gone.Store(true)
	r.cancelTransfer()
	c.mu.Lock()
	c.remove(r)
	c.moved = append(c.moved, r)
	c.mu.Unlock()
	c.wake()
}

// remove forgets a job. Requires: Coordinator.mu.
func (c *Coordinator) remove(r *run) {
	if c.jobs[r.id] == r {
		delete(c.jobs, r.id)
	}
	c.order = slices.DeleteFunc(c.order, func(o *run) bool { return o == r })
	c.room.remove(r)
}

// insert makes a job one that this coordinator owns.
func (c *Coordinator) insert(r *run) {
	c.mu.Lock()
	defer c.mu.Unlock()
	c.jobs[r.id] = r
	at, _ := slices.BinarySearchFunc(c.order, r.number, func(o *run, n uint64) int { return int(o.number) - int(n) })
	c.order = slices.Insert(c.order, at, r)
}

// endLostStreams lets readers of lost jobs connect again, to where the jobs are now, and frees what
// was held for them.
func (c *Coordinator) endLostStreams() {
	c.mu.Lock()
	moved := c.moved
	c.moved = nil
	c.mu.Unlock()
	for _, r := range moved {
		r.mu.Lock()
		r.checks.clear(c.merging)
		r.mu.Unlock()
		r.closeStreams()
	}
}

// takeJobs takes over jobs without owner, and hears of those that want none, until ctx ends.
func (c *Coordinator) takeJobs(ctx context.Context) {
	defer c.reading.Wait()
	for {
		if err := errors.Join(c.hearOfChanges(ctx), c.takeWaiting(ctx)); err != nil && ctx.Err() == nil {
			c.trouble(err)
		}
		select {
		case <-ctx.Done():
			return
		case <-time.After(c.options.OwnershipTTL / looksPerTTL):
		}
	}
}

func (c *Coordinator) takeWaiting(ctx context.Context) error {
	ids, err := c.options.Store.Waiting(ctx)
	if err != nil {
		return err
	}
	// Each begins with another job and takes its share, so that several coordinators share them.
	share := c.shareOf(ctx, len(ids))
	rand.Shuffle(len(ids), func(i, j int) { ids[i], ids[j] = ids[j], ids[i] })
	c.room.keep(ids)
	for _, id := range ids {
		if ctx.Err() != nil || share == 0 {
			return nil
		}
		if c.running(id) != nil { // its beat is late
			continue
		}
		if takes, err := c.hasRoomFor(ctx, id); err != nil {
			return err
		} else if !takes {
			continue
		}
		rec, epoch, err := c.options.Store.Acquire(ctx, c.claim(), id)
		switch {
		case errors.Is(err, store.ErrOwned), errors.Is(err, job.ErrNotFound):
		case err != nil:
			return err
		default:
			c.take(ctx, c.newRun(rec, epoch))
			share--
		}
	}
	return nil
}

// shareOf is how many of so many jobs without owner this coordinator takes before it looks again.
func (c *Coordinator) shareOf(ctx context.Context, jobs int) int {
	if jobs <= 1 {
		return jobs
	}
	members, err := c.options.Store.Members(ctx)
	if err != nil || len(members) == 0 {
		return jobs
	}
	return (jobs + len(members) - 1) / len(members)
}

// take goes on with a job that was acquired. It is owned at once, as its lease must be renewed; its
// checkpoint is read in a goroutine, as that can take long. Until then the job is like one that waits.
func (c *Coordinator) take(ctx context.Context, r *run) {
	c.log.Info("job taken over", "job", r.id, "state", string(r.rec.State), "epoch", r.epoch)
	c.metrics.taken.Inc()
	if r.rec.State.Ended() {
		c.insert(r) // housekeeping retires it
		return
	}
	c.room.force(r, r.rec.FilmBytes)
	rec := r.rec
	r.loading, r.rec.State, r.activity = true, job.Queued, "reading its checkpoint"
	c.insert(r)
	c.reading.Go(func() { c.goOn(ctx, r, rec) })
}

// goOn reads the checkpoint of a job and lets it go on from there.
func (c *Coordinator) goOn(ctx context.Context, r *run, rec store.Record) {
	defer c.announce()
	saved, err := c.readInTurn(ctx, rec)
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.gone.Load() {
		return
	}
	r.loading, r.rec.State, r.activity = false, rec.State, ""
	if err := r.resume(saved, err); err != nil {
		// Its checkpoint may be there later, or another coordinator may reach it.
		c.log.Error("job cannot be taken over now", "job", r.id, "error", err)
		c.drop(r)
		return
	}
	if r.state == nil {
		r.standBack()
		return
	}
	c.room.force(r, r.rec.FilmBytes) // records of earlier versions do not tell
	r.leaveRoomIfGone()
}

// unusable tells whether a checkpoint will never be readable.
func unusable(err error) bool {
	return errors.Is(err, blob.ErrNotFound) || errors.Is(err, checkpoint.ErrCorrupt)
}

// retire gives up a job that has ended and is stored with all that belongs to it.
func (r *run) retire() {
	r.mu.Lock()
	retired := r.rec.State.Ended() && r.mayAct() && !r.dirty && len(r.events.unsaved) == 0 && len(r.garbage) == 0 &&
		r.transfer.Load() == nil
	if retired {
		r.gone.Store(true)
		r.state, r.image, r.finishing = nil, nil, nil
	}
	r.mu.Unlock()
	if !retired {
		return
	}
	c := r.c
	c.mu.Lock()
	c.remove(r)
	c.ended[r.rec.State]++
	c.mu.Unlock()
	if err := c.options.Store.Release(context.Background(), r.epoch, r.id); err != nil {
		c.log.Warn("ended job is released when its lease has run out", "job", r.id, "error", err)
	}
	r.closeStreams()
}

// handOver gives a job to the other coordinators.
func (c *Coordinator) handOver(r *run) {
	if r.gone.Swap(true) {
		return
	}
	c.mu.Lock()
	c.remove(r)
	c.mu.Unlock()
	ctx, cancel := context.WithTimeout(context.Background(), leaveTimeout)
	defer cancel()
	if err := c.options.Store.Release(ctx, r.epoch, r.id); err != nil {
		c.log.Warn("job is taken over when its lease has run out", "job", r.id, "error", err)
	}
}

// leave ends the membership, and gives the jobs that are left to the other coordinators.
func (c *Coordinator) leave() {
	held := c.held()
	for _, r := range c.runs() {
		r.gone.Store(true)
	}
	ctx, cancel := context.WithTimeout(context.Background(), leaveTimeout)
	defer cancel()
	if err := c.options.Store.Leave(ctx, c.options.Member.ID, held); err != nil {
		c.log.Warn("jobs are taken over when their leases have run out", "error", err)
	}
}

// Ready tells why requests cannot be served, nil if they can.
func (c *Coordinator) Ready(context.Context) error {
	if c.down.Load() || c.suspended() {
		return store.ErrUnavailable
	}
	return nil
}
