package lease

import "time"

// Grant leases up to limit tasks to a worker: waiting ones in order and, only when none waits,
// copies of tasks that straggle elsewhere. A task is not offered again to a worker that failed it,
// unless alone says that there is no other. Tasks that were put apart come first, by themselves.
func (t *Table) Grant(worker string, limit int, alone bool, now time.Time) []Ref {
	if granted := t.GrantApart(worker, limit, now); len(granted) > 0 {
		return granted
	}
	waits := func(k *task) bool {
		return !k.apart && len(k.holders) == 0 && (alone || k.failures[worker] == 0)
	}
	if granted := t.grant(worker, limit, waits, now); len(granted) > 0 {
		return granted
	}
	return t.grant(worker, limit, func(k *task) bool { return !k.apart && t.straggles(k, worker, now) }, now)
}

// GrantApart does the same with tasks that were put apart only.
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
	k.holders = append(k.holders, h)
	return Ref{Task: k.id, Epoch: h.epoch}
}

// straggles tells whether a copy of the task is worth giving to a worker: held elsewhere for three
// times the usual time, and never sooner than the time to live.
func (t *Table) straggles(k *task, worker string, now time.Time) bool {
	if len(k.holders) == 0 || len(k.holders) >= maxHolders || t.finished == 0 || k.failures[worker] > 0 {
		return false
	}
	h := k.holders[0]
	usual := t.spent / time.Duration(t.finished)
	return h.worker != worker && now.Sub(h.granted) > max(t.ttl, 3*usual)
}
