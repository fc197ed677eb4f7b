package lease

import "time"

// Grant leases up to limit waiting tasks to a worker, in order. A task is not offered again to a worker
// that failed it, unless it failed on all of the crew, the workers that could have it at the moment.
// Tasks that were put apart come first, by themselves.
func (t *Table) Grant(worker string, limit int, crew []string, now time.Time) []Ref {
	if granted := t.GrantApart(worker, limit, now); len(granted) > 0 {
		return granted
	}
	return t.grant(worker, limit, func(k *task) bool {
		return !k.apart && len(k.holders) == 0 && (k.failures[worker] == 0 || k.failedOnAll(crew))
	}, now)
}

// GrantCopies leases copies of tasks that straggle elsewhere. It is for workers for which no task of any
// job waits.
func (t *Table) GrantCopies(worker string, limit int, now time.Time) []Ref {
	granted := t.GrantApart(worker, limit, now)
	if len(granted) == 0 {
		granted = t.grant(worker, limit, func(k *task) bool { return !k.apart && t.straggles(k, worker, now) }, now)
	}
	if len(granted) == 0 {
		t.load.ripens(t.nextLook(now))
	}
	return granted
}

// GrantApart leases tasks that were put apart only, waiting ones and copies of those that straggle.
func (t *Table) GrantApart(worker string, limit int, now time.Time) []Ref {
	return t.grant(worker, limit, func(k *task) bool {
		waits := len(k.holders) == 0 && k.failures[worker] == 0
		return k.apart && !k.barred[worker] && (waits || t.straggles(k, worker, now))
	}, now)
}

func (t *Table) grant(worker string, limit int, wanted func(*task) bool, now time.Time) []Ref {
	var granted []Ref
	for _, k := range t.ordered {
		if len(granted) == limit {
			break
		}
		if wanted(k) {
			granted = append(granted, t.lease(k, worker, now))
		}
	}
	return granted
}

func (t *Table) lease(k *task, worker string, now time.Time) Ref {
	h := holding{epoch: t.nextEpoch(), worker: worker, granted: now, deadline: now.Add(t.ttl)}
	if !k.silent.IsZero() {
		t.again.Tasks++
		t.again.Longest = max(t.again.Longest, now.Sub(k.silent))
		k.silent = time.Time{}
	}
	t.setHolders(k, append(k.holders, h))
	t.expectDeadline(h.deadline)
	t.load.granted(now, t.ttl)
	return Ref{Task: k.id, Epoch: h.epoch}
}

// straggles tells whether a copy of the task is worth giving to a worker.
func (t *Table) straggles(k *task, worker string, now time.Time) bool {
	if len(k.holders) == 0 || len(k.holders) >= maxHolders || t.finished == 0 || k.failures[worker] > 0 {
		return false
	}
	h := k.holders[0]
	return h.worker != worker && now.Sub(h.granted) > t.patience()
}

// patience is how long a task may be held before it straggles: three times the usual time, never less
// than the time to live, and longer than it may linger.
func (t *Table) patience() time.Duration {
	if t.finished == 0 {
		return t.ttl + t.linger
	}
	return max(t.ttl, 3*t.spent/time.Duration(t.finished)) + t.linger
}

// nextLook is when some task straggles or some lease runs out, as far as is known, and at most
// lookAgain from now: patience changes as tasks are done.
func (t *Table) nextLook(now time.Time) time.Time {
	next := now.Add(min(lookAgain, t.ttl))
	if t.deadline.Before(next) && !t.deadline.IsZero() {
		next = t.deadline
	}
	if t.finished == 0 {
		return next
	}
	patience := t.patience()
	for _, k := range t.ordered {
		if len(k.holders) == 0 || len(k.holders) >= maxHolders {
			continue
		}
		if straggles := k.holders[0].granted.Add(patience); straggles.Before(next) {
			next = straggles
		}
	}
	return next
}
