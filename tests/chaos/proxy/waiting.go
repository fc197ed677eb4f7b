package main

import (
	"context"
	"sync"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// leaseSet is a set of leases.
type leaseSet struct {
	mu     sync.Mutex
	leases map[leaseKey]bool
}

type leaseKey struct {
	task  string
	epoch uint64
}

func keyOf(l *farmv1.LeaseRef) leaseKey { return leaseKey{l.GetTaskId(), l.GetEpoch()} }

func (s *leaseSet) add(l *farmv1.LeaseRef) {
	s.mu.Lock()
	defer s.mu.Unlock()
	if s.leases == nil {
		s.leases = make(map[leaseKey]bool)
	}
	s.leases[keyOf(l)] = true
}

func (s *leaseSet) remove(l *farmv1.LeaseRef) {
	s.mu.Lock()
	defer s.mu.Unlock()
	delete(s.leases, keyOf(l))
}

func (s *leaseSet) has(l *farmv1.LeaseRef) bool {
	s.mu.Lock()
	defer s.mu.Unlock()
	return s.leases[keyOf(l)]
}

// waiters wait for deliveries of others to pass.
type waiters struct {
	mu    sync.Mutex
	waits map[chan struct{}]func(worker, job string, places []place) bool
}

func newWaiters() *waiters {
	return &waiters{waits: make(map[chan struct{}]func(string, string, []place) bool)}
}

// note tells that a delivery has passed.
func (w *waiters) note(worker, job string, places []place) {
	w.mu.Lock()
	defer w.mu.Unlock()
	for done, wanted := range w.waits {
		if wanted(worker, job, places) {
			close(done)
			delete(w.waits, done)
		}
	}
}

// await waits for any delivery.
func (w *waiters) await(ctx context.Context, atMost time.Duration) {
	w.wait(ctx, atMost, func(string, string, []place) bool { return true })
}

// awaitOther waits until another worker has delivered any of these segments.
func (w *waiters) awaitOther(ctx context.Context, worker, job string, places []place, atMost time.Duration) {
	mine := make(map[place]bool)
	for _, p := range places {
		mine[p] = true
	}
	w.wait(ctx, atMost, func(other, of string, delivered []place) bool {
		if other == worker || of != job {
			return false
		}
		for _, p := range delivered {
			if mine[p] {
				return true
			}
		}
		return false
	})
}

func (w *waiters) wait(ctx context.Context, atMost time.Duration, wanted func(string, string, []place) bool) {
	done := make(chan struct{})
	w.mu.Lock()
	w.waits[done] = wanted
	w.mu.Unlock()
	select {
	case <-done:
	case <-ctx.Done():
	case <-time.After(atMost):
	}
	w.mu.Lock()
	defer w.mu.Unlock()
	delete(w.waits, done)
}
