package lease

import (
	"fmt"
	"math/rand/v2"
	"testing"
	"time"
)

// Whatever happens to a table, its counts are those of its tasks, and it is ripe when it has a lease that
// has run out, and soon after it has a copy to give.
func TestLoadTellsTheTruth(t *testing.T) {
	random := rand.New(rand.NewPCG(1, 2))
	for round := range 50 {
		k := table(0)
		now := start
		var refs []Ref
		holder := func() string { return string(rune('a' + random.IntN(4))) }
		for step := range 300 {
			now = now.Add(time.Duration(random.IntN(2000)) * time.Millisecond)
			who, id := holder(), fmt.Sprint(random.IntN(12))
			switch random.IntN(12) {
			case 0, 1:
				k.Put(id, uint64(step))
			case 2:
				k.PutApart(id, uint64(step))
			case 3, 4, 5:
				refs = append(refs, k.Grant(who, 2, several[:random.IntN(len(several))], now)...)
			case 6:
				k.Done(id, now)
			case 7:
				k.Drop(id)
			case 8:
				k.ReleaseWorker(who)
			case 9:
				for _, ref := range refs {
					k.Renew(ref, who, 0.5, now)
				}
			case 10:
				k.Expire(now)
			case 11:
				if random.IntN(20) == 0 {
					k.Clear()
				}
			}
			checkLoad(t, k, now, who)
			if t.Failed() {
				t.Fatalf("round %d, step %d", round, step)
			}
		}
	}
}

func checkLoad(t *testing.T, k *Table, now time.Time, who string) {
	t.Helper()
	waiting, leases, overdue := 0, 0, false
	for _, task := range k.ordered {
		if len(task.holders) == 0 {
			waiting++
		}
		for _, h := range task.holders {
			overdue = overdue || !now.Before(h.deadline)
		}
		leases += len(task.holders)
	}
	if k.Waiting() != waiting || k.Leases() != leases {
		t.Errorf("says %d waiting and %d leases, has %d and %d", k.Waiting(), k.Leases(), waiting, leases)
	}
	if overdue && !k.Ripe(now) {
		t.Error("a lease has run out")
	}
	if k.Ripe(now) {
		k.GrantCopies(who, 1, now)
		return
	}
	for _, task := range k.ordered {
		// patience may have shrunk since the table was looked at: that is found a little later.
		if !task.apart && k.straggles(task, who, now) && !k.Ripe(now.Add(lookAgain)) {
			t.Errorf("task %s straggles", task.id)
		}
	}
}

func TestForgivenLossesDoNotPoison(t *testing.T) {
	k := table(1)
	for _, worker := range []string{"a", "b", "c"} {
		k.NoteLost("0", worker)
	}
	if p, poisoned := k.Poisoned(several); !poisoned || len(p.Lost) != 3 {
		t.Fatalf("%+v", p)
	}
	k.Forgive("b")
	if p, poisoned := k.Poisoned(several); poisoned {
		t.Errorf("%+v", p)
	}
}
