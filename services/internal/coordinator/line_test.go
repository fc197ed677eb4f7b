package coordinator_test

import (
	"context"
	"errors"
	"sync/atomic"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// line is a coordinator's way to a store, which a test can cut.
type line struct {
	store.Store
	cut atomic.Bool
	// frozen: beats are taken to be answered, as a process takes them to be that was stopped right after
	// one.
	frozen atomic.Bool
	writes atomic.Int64 // updates that were made
	// full: nothing can be written, as on a disk that is full; that does not pass by itself.
	full atomic.Bool
	// silent: who the members are, and what their users used, cannot be read.
	silent atomic.Bool
}

var errSilent = errors.New("a record that nobody can read")

func (l *line) Members(ctx context.Context) ([]store.Member, error) {
	if l.silent.Load() {
		return nil, errSilent
	}
	return l.Store.Members(ctx)
}

func (l *line) state() error {
	if l.cut.Load() {
		return store.ErrUnavailable
	}
	return nil
}

func (l *line) Beat(ctx context.Context, m store.Member, ttl time.Duration, held map[string]uint64) ([]string, error) {
	if l.frozen.Load() {
		return nil, nil
	}
	if err := l.state(); err != nil {
		return nil, err
	}
	return l.Store.Beat(ctx, m, ttl, held)
}

func (l *line) Leave(ctx context.Context, member string, held map[string]uint64) error {
	if err := l.state(); err != nil {
		return err
	}
	return l.Store.Leave(ctx, member, held)
}

func (l *line) CreateJob(ctx context.Context, c store.Claim, r store.Record, key, fingerprint string) (store.Record, bool, error) {
	if err := l.state(); err != nil {
		return store.Record{}, false, err
	}
	return l.Store.CreateJob(ctx, c, r, key, fingerprint)
}

func (l *line) UpdateJob(ctx context.Context, epoch uint64, r store.Record, events []job.Event) error {
	err := l.state()
	if l.full.Load() {
		err = errFull
	}
	if err == nil {
		err = l.Store.UpdateJob(ctx, epoch, r, events)
	}
	if err == nil {
		l.writes.Add(1)
	}
	return err
}

func (l *line) Release(ctx context.Context, epoch uint64, id string) error {
	if err := l.state(); err != nil {
		return err
	}
	return l.Store.Release(ctx, epoch, id)
}

func (l *line) Waiting(ctx context.Context) ([]string, error) {
	if err := l.state(); err != nil {
		return nil, err
	}
	if l.frozen.Load() {
		return nil, nil
	}
	return l.Store.Waiting(ctx)
}

func (l *line) Acquire(ctx context.Context, c store.Claim, id string) (store.Record, uint64, error) {
	if err := l.state(); err != nil {
		return store.Record{}, 0, err
	}
	return l.Store.Acquire(ctx, c, id)
}

func (l *line) Job(ctx context.Context, id string) (store.Owned, error) {
	if err := l.state(); err != nil {
		return store.Owned{}, err
	}
	return l.Store.Job(ctx, id)
}

func (l *line) Jobs(ctx context.Context, before uint64, limit int) ([]store.Owned, error) {
	if err := l.state(); err != nil {
		return nil, err
	}
	return l.Store.Jobs(ctx, before, limit)
}
