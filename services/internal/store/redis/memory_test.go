package redis

import (
	"errors"
	"fmt"
	"slices"
	"testing"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/redis/redistest"
)

// A server whose memory is used up takes nothing more in, but leases last, and what is deleted makes room.
func TestAServerWithoutMemory(t *testing.T) {
	server := redistest.Start(t)
	s := open(t, server.URL, Options{Patience: time.Second})
	defer s.Close()
	ctx := t.Context()
	for _, id := range []string{"a", "b", "c"} {
		if _, _, err := s.CreateJob(ctx, claim("m"), record(id), "", ""); err != nil {
			t.Fatal(err)
		}
	}
	server.LimitMemory(1)
	changed := record("a")
	changed.Revision = 1
	_, _, create := s.CreateJob(ctx, claim("m"), record("d"), "key", "f")
	_, _, sequence := s.CreateSequence(ctx, claim("m"), store.Sequence{ID: "q"}, []store.Record{record("e")}, "", "")
	update := s.UpdateJob(ctx, 1, changed, []job.Event{{Sequence: 1}})
	for what, err := range map[string]error{"create": create, "sequence": sequence, "update": update} {
		if !errors.Is(err, store.ErrUnavailable) {
			t.Errorf("%s without memory: %v", what, err)
		}
	}
	lost, beat := s.Beat(ctx, store.Member{ID: "m"}, time.Minute, map[string]uint64{"a": 1, "b": 1, "c": 1})
	release := s.Release(ctx, 1, "b")
	_, epoch, acquire := s.Acquire(ctx, claim("n"), "b")
	remove := s.DeleteJob(ctx, epoch, "b")
	leave := s.Leave(ctx, "m", map[string]uint64{"c": 1})
	if err := errors.Join(beat, release, acquire, remove, leave); err != nil || len(lost) != 0 {
		t.Errorf("leases and deletions without memory: lost %v, error %v", lost, err)
	}
	server.LimitMemory(0)
	if err := s.UpdateJob(ctx, 1, changed, []job.Event{{Sequence: 1}}); err != nil {
		t.Errorf("update with memory again: %v", err)
	}
	if r, created, err := s.CreateJob(ctx, claim("m"), record("d"), "key", "f"); err != nil || !created || r.Number != 4 {
		t.Errorf("number %d, created %v, error %v: what was refused left something", r.Number, created, err)
	}
	jobs, err := s.Jobs(ctx, 0, 10)
	var ids []string
	for _, j := range jobs {
		ids = append(ids, j.ID)
	}
	if err != nil || !slices.Equal(ids, []string{"d", "c", "a"}) {
		t.Errorf("jobs %v, error %v", ids, err)
	}
}

// Servers before 7 put what a script's command was told into a reply of their own.
func TestRepliesOfServersThatWillServeLater(t *testing.T) {
	for text, want := range map[string]bool{
		"OOM command not allowed when used memory > 'maxmemory'. script: 1f, on @user_script:5.":                                                     true,
		"ERR Error running script (call to f_1f): @user_script:5: @user_script: 5: -OOM command not allowed when used memory > 'maxmemory'.":         true,
		"ERR Error running script (call to f_1f): @user_script:9: @user_script: 9: -MISCONF Errors writing to the AOF file: No space left on device": true,
		"ERR Error running script (call to f_1f): @user_script:5: Wrong number of args calling Redis command From Lua script":                        false,
		"WRONGTYPE Operation against a key holding the wrong kind of value":                                                                          false,
	} {
		if got := unavailable(fmt.Errorf("call: %w", reply(text))); got != want {
			t.Errorf("%q: unavailable %v, want %v", text, got, want)
		}
	}
}

// reply is an error that a server answered.
type reply string

func (r reply) Error() string { return string(r) }
func (reply) RedisError()     {}
