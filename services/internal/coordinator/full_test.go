package coordinator_test

import (
	"errors"
	"testing"
	"time"

	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/redis"
	"metrofarm/services/internal/store/redis/redistest"
)

// A Redis whose memory is used up takes nothing in. Its coordinators keep their jobs and go on as soon as it
// has memory, and what users delete makes room.
func TestARedisWithoutMemory(t *testing.T) {
	t.Parallel()
	server := redistest.Start(t)
	request := chainsRequest(100)
	want := reference(t, request)
	db, err := redis.Open(t.Context(), server.URL, redis.Options{Patience: time.Second})
	if err != nil {
		t.Fatal(err)
	}
	defer db.Close()
	const ttl = time.Second
	s := newSite(t)
	s.shared = db
	s.tune = func(o *coordinator.Options) {
		o.Member, o.OwnershipTTL = store.Member{ID: "only", REST: "http://only"}, ttl
	}
	s.start()
	defer s.stop()
	dismiss := s.crew(workers(1, nil)...)
	old := s.submit(chainsRequest(20))
	s.settled(old)
	dismiss()
	id := s.submit(request)

	server.LimitMemory(1)
	defer s.crew(workers(2, nil)...)()
	if _, err := s.c.Submit(t.Context(), s.job(id).Request, ""); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("submitted without memory: %v", err)
	}
	s.check(s.c.Delete(t.Context(), old))
	time.Sleep(3 * ttl / 2) // the lease has ended, unless it was renewed without memory
	for deadline := time.Now().Add(patience); ; time.Sleep(ttl / 20) {
		stored, err := db.Job(t.Context(), id)
		s.check(err)
		if stored.Owner.ID == "only" {
			break
		}
		if time.Now().After(deadline) {
			t.Fatal("the job's lease is not renewed")
		}
	}
	if state := s.job(id).State; state.Ended() {
		t.Errorf("the job is %s, which cannot be stored", state)
	}
	server.LimitMemory(0)
	sameFilm(t, s.finished(id), want)
	if _, err := s.c.Job(t.Context(), old); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("the deleted job is there: %v", err)
	}
}

// Where a file of this machine is the store and its disk is full, the coordinator ends and says so; the next
// one goes on, once there is space.
func TestAStoreOnAFullDisk(t *testing.T) {
	t.Parallel()
	request := chainsRequest(60)
	want := reference(t, request)
	p := newPair(t, 600*time.Millisecond)
	s := p.sites[0]
	s.start()
	id := s.submit(request)
	p.lines[0].full.Store(true)
	defer s.crew(workers(2, nil)...)()
	select {
	case <-s.done:
	case <-time.After(patience):
		t.Fatal("the coordinator goes on, and nothing of it is stored")
	}
	if state := p.record(id).State; state != job.Queued {
		t.Errorf("the job is stored as %s", state)
	}
	s.stop()
	p.lines[0].full.Store(false)
	s.start()
	defer s.stop()
	sameFilm(t, s.finished(id), want)
}
