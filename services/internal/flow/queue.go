package flow

import (
	"context"
	"slices"
	"sync"
)

// MaxInFlight is how many batches of one worker may be under way at a time.
const MaxInFlight = 2

// Queue bounds the memory of batches that have arrived and are not merged: those being read,
// each with its header and all its tiles unpacked from the start, and those held for a second
// worker. A batch waits until it fits beside the others; one that is larger than the budget is read
// alone. Nobody who was let in waits for anybody else, so all of them end. Methods may be called from
// several goroutines.
type Queue struct {
	budget int64

	mu          sync.Mutex
	read, held  int64
	reading     int
	peak        int64          // of read and held together
	waiting     []*reservation // by arrival
	inFlight    map[string]int // batches by worker
	withholding bool
}

type reservation struct {
	bytes int64
	ready chan struct{}
}

// NewQueue returns an empty queue that keeps to a budget of bytes.
func NewQueue(budget int64) *Queue {
	return &Queue{budget: budget, inFlight: make(map[string]int)}
}

// Begin notes a batch of a worker; false: the worker has too many under way. Each that was begun
// must end.
func (q *Queue) Begin(worker string) bool {
	q.mu.Lock()
	defer q.mu.Unlock()
	if q.inFlight[worker] >= MaxInFlight {
		return false
	}
	q.inFlight[worker]++
	return true
}

// End notes that a batch of a worker is answered.
func (q *Queue) End(worker string) {
	q.mu.Lock()
	defer q.mu.Unlock()
	if q.inFlight[worker]--; q.inFlight[worker] == 0 {
		delete(q.inFlight, worker)
	}
}

// Reserve waits until a batch of so many bytes may be read. Each that may must be freed.
func (q *Queue) Reserve(ctx context.Context, bytes int64) error {
	mine := &reservation{bytes, make(chan struct{})}
	q.mu.Lock()
	q.waiting = append(q.waiting, mine)
	q.admit()
	q.mu.Unlock()
	select {
	case <-mine.ready:
		return nil
	case <-ctx.Done():
	}
	q.mu.Lock()
	defer q.mu.Unlock()
	select {
	case <-mine.ready: // at the same moment
		q.leave(bytes)
	default:
		q.waiting = slices.DeleteFunc(q.waiting, func(w *reservation) bool { return w == mine })
	}
	q.admit()
	return ctx.Err()
}

// Grow notes bytes of a batch beyond what was reserved for it, its packed tiles: they are in memory
// already, the next batch waits for them.
func (q *Queue) Grow(bytes int64) {
	q.mu.Lock()
	defer q.mu.Unlock()
	q.read += bytes
	q.peak = max(q.peak, q.read+q.held)
}

// Free gives back what was reserved, and what it grew by.
func (q *Queue) Free(bytes int64) {
	q.mu.Lock()
	defer q.mu.Unlock()
	q.leave(bytes)
	q.admit()
}

// leave requires: mu.
func (q *Queue) leave(bytes int64) {
	q.read -= bytes
	q.reading--
}

// admit lets in what fits, strictly by arrival: else a large batch might wait forever. What is held
// stops nobody from being read alone: it may wait for just that batch. Requires: mu.
func (q *Queue) admit() {
	for len(q.waiting) > 0 {
		first := q.waiting[0]
		if q.reading > 0 && q.read+q.held+first.bytes > q.budget {
			return
		}
		q.read += first.bytes
		q.reading++
		q.peak = max(q.peak, q.read+q.held)
		close(first.ready)
		q.waiting = q.waiting[1:]
	}
}

// Hold notes a batch that waits for a second worker; false: there is no room for it. Half of the
// budget is for those that can be merged. One is always held, whatever its size.
func (q *Queue) Hold(bytes int64) bool {
	q.mu.Lock()
	defer q.mu.Unlock()
	if q.held > 0 && q.held+bytes > q.budget/2 {
		return false
	}
	q.held += bytes
	q.peak = max(q.peak, q.read+q.held)
	return true
}

// Unhold gives back what was held.
func (q *Queue) Unhold(bytes int64) {
	q.mu.Lock()
	defer q.mu.Unlock()
	q.held -= bytes
	q.admit()
}

// Withholds tells whether no work should be granted that ends in a batch: from when there is more
// than the budget, batches that wait for room included, until a quarter of it is free again.
// changed: it was otherwise when last asked.
func (q *Queue) Withholds() (withholding, changed bool) {
	q.mu.Lock()
	defer q.mu.Unlock()
	load, before := q.load(), q.withholding
	switch {
	case load > q.budget:
		q.withholding = true
	case load <= q.budget-q.budget/4:
		q.withholding = false
	}
	return q.withholding, q.withholding != before
}

// load requires: mu.
func (q *Queue) load() int64 {
	load := q.read + q.held
	for _, w := range q.waiting {
		load += w.bytes
	}
	return load
}

// Peak is the most memory that batches ever took, held ones included.
func (q *Queue) Peak() int64 {
	q.mu.Lock()
	defer q.mu.Unlock()
	return q.peak
}

// Bytes is the memory of batches that are being read.
func (q *Queue) Bytes() int64 {
	q.mu.Lock()
	defer q.mu.Unlock()
	return q.read
}
