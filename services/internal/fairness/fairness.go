// Package fairness decides which job gets the next worker. It is pure: the caller passes the time and
// serializes calls.
//
// The rule:
//
//   - A job of higher priority goes before all of lower priority, whoever they belong to.
//   - Among jobs of equal priority, those of the user who used least of late go first. A user's usage is
//     the CPU time of the work that was taken from workers for their jobs, halved every HalfLife, and
//     what the work that is leased at the moment will take. Coordinators that share a farm tell each
//     other of it, so that a user with jobs at several gets no more than one with jobs at one.
//   - Among jobs of one user, and of users with equal usage, the older goes first.
//
// Only jobs that have work for more workers are in the queue: what a job cannot use goes to the next.
// As long as users with jobs of equal priority have waiting work, their usages differ by no more than
// the work that is leased at a time.
package fairness

import (
	"container/heap"
	"iter"
	"math"
	"time"
)

// HalfLife is the time after which used CPU time counts half: a user who is new to the farm goes before
// one who had all of it by some minutes, not by hours.
const HalfLife = 10 * time.Minute

// forgotten is the usage, in seconds, below which a user is like one who never used anything.
const forgotten = 1e-9

// worthTelling is the usage, in seconds, from which on other coordinators hear of it.
const worthTelling = 0.01

// Job is what the rule looks at.
type Job struct {
	User     string
	Priority int
	// Number is the order of creation; no two jobs have the same.
	Number uint64
	// Underway is the CPU time that its leased work will take, in seconds, as far as can be told.
	Underway float64
	// Wants: it has work for another worker.
	Wants bool
}

// Ledger keeps what users used of late. The zero value is ready.
type Ledger struct {
	since time.Time // what accounts say holds for this moment
	users map[string]*account
}

// account of a user; all in seconds.
type account struct {
	used      float64
	elsewhere float64 // used at other coordinators, as they said last
	underway  float64 // in the order that is being made
}

// Charge adds CPU time to a user's usage. Times that cannot be are left out.
func (l *Ledger) Charge(user string, seconds float64, now time.Time) {
	if !(seconds > 0) || math.IsInf(seconds, 0) {
		return
	}
	l.settle(now)
	l.account(user).used += seconds / l.factor(now)
}

// Usage is what a user used of late here, in seconds.
func (l *Ledger) Usage(user string, now time.Time) float64 {
	if a := l.users[user]; a != nil {
		return a.used * l.factor(now)
	}
	return 0
}

// Usages of all users who used enough here to tell others of, in seconds.
func (l *Ledger) Usages(now time.Time) map[string]float64 {
	usages := make(map[string]float64)
	for user := range l.users {
		if used := l.Usage(user, now); used >= worthTelling {
			usages[user] = used
		}
	}
	return usages
}

// Elsewhere replaces what users used of late at other coordinators, in seconds: what each of them said.
// Times that cannot be are left out.
func (l *Ledger) Elsewhere(now time.Time, said ...map[string]float64) {
	l.settle(now)
	for _, a := range l.users {
		a.elsewhere = 0
	}
	for _, usages := range said {
		for user, seconds := range usages {
			if seconds > 0 && !math.IsInf(seconds, 0) {
				l.account(user).elsewhere += seconds
			}
		}
	}
}

func (l *Ledger) account(user string) *account {
	a := l.users[user]
	if a == nil {
		a = &account{}
		l.users[user] = a
	}
	return a
}

// factor is what remains by now of a second that was used when the ledger was settled. A clock that was
// set back changes nothing until it has caught up.
func (l *Ledger) factor(now time.Time) float64 {
	return math.Exp2(-float64(max(now.Sub(l.since), 0)) / float64(HalfLife))
}

// settle moves the accounts on to now when a half-life has passed, and closes those that are empty.
func (l *Ledger) settle(now time.Time) {
	switch {
	case l.users == nil:
		l.users, l.since = make(map[string]*account), now
		return
	case now.Sub(l.since) < HalfLife:
		return
	}
	factor := l.factor(now)
	for user, a := range l.users {
		if a.used *= factor; a.used < forgotten && a.elsewhere == 0 {
			delete(l.users, user)
		}
	}
	l.since = now
}

// Order returns the indices of the jobs that want workers, first which goes first. The ledger must not
// be used while they are read.
func (l *Ledger) Order(jobs []Job, now time.Time) iter.Seq[int] {
	return func(yield func(int) bool) {
		queue := l.queue(jobs, now)
		heap.Init(&queue)
		for len(queue) > 0 {
			if !yield(queue[0].index) {
				return
			}
			heap.Pop(&queue)
		}
	}
}

// queue returns the jobs that want workers with what decides between them, in no order: most often
// only the first one or two are asked for.
func (l *Ledger) queue(jobs []Job, now time.Time) queue {
	l.settle(now)
	for _, a := range l.users {
		a.underway = 0
	}
	var wanting queue
	for i := range jobs {
		j := &jobs[i]
		a := l.account(j.User)
		a.underway += j.Underway
		if j.Wants {
			wanting = append(wanting, entry{priority: j.Priority, user: a, number: j.Number, index: i})
		}
	}
	factor := l.factor(now)
	for i := range wanting {
		e := &wanting[i]
		e.usage = e.user.used*factor + e.user.elsewhere + e.user.underway
	}
	return wanting
}

// entry is a job that wants workers.
type entry struct {
	priority int
	user     *account
	usage    float64 // of the user
	number   uint64
	index    int
}

func (e *entry) before(o *entry) bool {
	switch {
	case e.priority != o.priority:
		return e.priority > o.priority
	case e.usage != o.usage:
		return e.usage < o.usage
	default:
		return e.number < o.number
	}
}

// queue is a heap.
type queue []entry

func (q queue) Len() int           { return len(q) }
func (q queue) Less(i, j int) bool { return q[i].before(&q[j]) }
func (q queue) Swap(i, j int)      { q[i], q[j] = q[j], q[i] }

// Push is not used: a queue is made at once.
func (q *queue) Push(any) { panic("fairness: a queue only shrinks") }

// Pop removes the last entry.
func (q *queue) Pop() any {
	*q = (*q)[:len(*q)-1]
	return nil
}
