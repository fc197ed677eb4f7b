package lease

import (
	"sync/atomic"
	"time"
)

// lookAgain is how long a table is left alone after it had nothing to copy.
const lookAgain = time.Second

// load is what can be read of a table while others use it, so that whoever looks for work passes by
// the many tables that have none.
type load struct {
	waiting, leases atomic.Int64
	ripe            atomic.Int64 // Unix time in nanoseconds from which on GrantCopies may find something
}

// Waiting is the number of tasks that nobody holds. It may be called at any time.
func (t *Table) Waiting() int { return int(t.load.waiting.Load()) }

// Leases is the number of live leases. It may be called at any time.
func (t *Table) Leases() int { return int(t.load.leases.Load()) }

// Ripe tells whether a lease may have run out or a task may straggle. It may be called at any time.
func (t *Table) Ripe(now time.Time) bool {
	return t.load.leases.Load() > 0 && now.UnixNano() >= t.load.ripe.Load()
}

// change notes that the number of a task's holders changes.
func (l *load) change(before, after int) {
	l.leases.Add(int64(after - before))
	switch {
	case before == 0 && after > 0:
		l.waiting.Add(-1)
	case before > 0 && after == 0:
		l.waiting.Add(1)
	}
}

// granted notes the first lease of a table whose leases live for ttl. Later ones are ripe later.
func (l *load) granted(now time.Time, ttl time.Duration) {
	if l.leases.Load() == 1 {
		l.ripens(now.Add(ttl))
	}
}

func (l *load) ripens(at time.Time) { l.ripe.Store(at.UnixNano()) }

func (l *load) clear() {
	l.waiting.Store(0)
	l.leases.Store(0)
}
