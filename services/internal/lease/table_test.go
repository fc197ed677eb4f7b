package lease

import (
	"fmt"
	"slices"
	"testing"
	"time"
)

const ttl = 10 * time.Second

var start = time.Unix(1000, 0)

func table(tasks int) *Table {
	epoch := uint64(0)
	t := NewTable(ttl, func() uint64 { epoch++; return epoch })
	for i := range tasks {
		t.Put(fmt.Sprint(i), uint64(tasks-i)) // the last put comes first
	}
	return t
}

// several workers, so that there is always one that has not failed.
var several = []string{"a", "b", "c", "d"}

func at(seconds int) time.Time { return start.Add(time.Duration(seconds) * time.Second) }

func TestGrantsInOrderAndOnce(t *testing.T) {
	k := table(3)
	first := k.Grant("a", 2, several, at(0))
	second := k.Grant("b", 2, several, at(0))
	if len(first) != 2 || first[0].Task != "2" || first[1].Task != "1" || len(second) != 1 || second[0].Task != "0" {
		t.Fatalf("first %v, second %v", first, second)
	}
	if second[0].Epoch <= first[1].Epoch {
		t.Error("epochs do not grow")
	}
	if none := k.Grant("c", 1, several, at(0)); len(none) != 0 {
		t.Errorf("granted %v again", none)
	}
}

func TestExpiryAndFencing(t *testing.T) {
	k := table(1)
	old := k.Grant("a", 1, several, at(0))[0]
	k.Expire(at(1))
	if !k.Renew(old, "a", 0.5, at(8)) || k.Renew(old, "b", 0.5, at(8)) {
		t.Fatal("only the holder renews")
	}
	for second := 2; second < 18; second++ {
		if expired := k.Expire(at(second)); len(expired) != 0 {
			t.Fatalf("expired at %d: %v", second, expired)
		}
	}
	if expired := k.Expire(at(18)); len(expired) != 1 || expired[0].Worker != "a" || expired[0].Ref != old {
		t.Fatalf("expired %v", expired)
	}
	if k.Held(old, "a") || k.Renew(old, "a", 1, at(18)) || k.Fail(old, "a", "") {
		t.Error("an expired lease is alive")
	}
	if again := k.LeasedAgain(); again.Tasks != 0 {
		t.Errorf("leased again before it was: %+v", again)
	}
	next := k.Grant("a", 1, several, at(21))
	if again := k.LeasedAgain(); again != (Again{1, 13 * time.Second}) { // from the renewal at 8
		t.Errorf("leased again: %+v", again)
	}
	if again := k.LeasedAgain(); again.Tasks != 0 {
		t.Errorf("told twice: %+v", again)
	}
	if len(next) != 1 || next[0].Epoch <= old.Epoch {
		t.Errorf("granted %v after %v", next, old)
	}
}

func TestSleepingCoordinatorBlamesNobody(t *testing.T) {
	k := table(1)
	ref := k.Grant("a", 1, several, at(0))[0]
	k.Expire(at(1))
	if expired := k.Expire(at(3600)); len(expired) != 0 || !k.Renew(ref, "a", 0, at(3601)) {
		t.Errorf("expired %v", expired)
	}
}

func TestFailedTaskGoesToOthersFirst(t *testing.T) {
	k := table(1)
	ref := k.Grant("a", 1, several, at(0))[0]
	k.Fail(ref, "a", "no")
	if got := k.Grant("a", 1, several, at(1)); len(got) != 0 {
		t.Errorf("granted %v to the worker that failed it", got)
	}
	if got := k.Grant("a", 1, []string{"a"}, at(1)); len(got) != 1 {
		t.Error("not granted though there is no other worker")
	}
}

func TestPoison(t *testing.T) {
	k := table(1)
	alone := []string{"a"}
	fail := func(worker string) { k.Fail(k.Grant(worker, 1, alone, at(0))[0], worker, "by "+worker) }
	fail("a")
	fail("a")
	if _, poisoned := k.Poisoned(alone); poisoned {
		t.Error("poisoned after two failures")
	}
	fail("a")
	if _, poisoned := k.Poisoned(several); poisoned {
		t.Error("one worker of several poisons")
	}
	if _, poisoned := k.Poisoned(nil); poisoned {
		t.Error("one worker poisons that is not there any more")
	}
	if p, poisoned := k.Poisoned(alone); !poisoned || p.Evidence != "by a" || p.Failures != 3 {
		t.Errorf("the only worker failed three times: %+v", p)
	}
	fail("b")
	k.Grant("c", 1, several, at(0))
	k.Expire(at(1))
	k.Expire(at(5))
	for _, e := range k.Expire(at(10)) {
		if _, poisoned := k.Poisoned(several); poisoned {
			t.Error("a lease that ran out counts as a loss")
		}
		k.NoteLost(e.Task, e.Worker)
	}
	if p, poisoned := k.Poisoned(several); !poisoned || len(p.Failed) != 2 || len(p.Lost) != 1 {
		t.Errorf("two failures and a loss: %+v", p)
	}
}

// Two workers that both failed a task are asked once more; there is no third to wait for.
func TestPoisonWithTwoWorkers(t *testing.T) {
	k := table(1)
	two := []string{"a", "b"}
	fail := func(worker string) { k.Fail(k.Grant(worker, 1, two, at(0))[0], worker, "by "+worker) }
	fail("a")
	if got := k.Grant("a", 1, two, at(0)); len(got) != 0 {
		t.Errorf("granted %v to who failed it, before the other has tried", got)
	}
	fail("b")
	if p, poisoned := k.Poisoned(two); poisoned {
		t.Errorf("poisoned after one failure of each: %+v", p)
	}
	if got := k.Grant("c", 1, append(two, "c"), at(0)); len(got) != 1 || !k.Release(got[0], "c") {
		t.Errorf("a third worker gets %v", got)
	}
	if got := k.Grant("a", 1, append(two, "c"), at(0)); len(got) != 0 {
		t.Errorf("granted %v to who failed it, though a third has not", got)
	}
	fail("b")
	if p, poisoned := k.Poisoned(append(two, "c")); poisoned {
		t.Errorf("poisoned though a third has not tried: %+v", p)
	}
	if p, poisoned := k.Poisoned(two); !poisoned || p.Failures != 3 || !slices.Equal(p.Failed, two) || p.Evidence != "by b" {
		t.Errorf("both failed, one of them twice: %+v", p)
	}
}

func TestStragglersRunTwice(t *testing.T) {
	k := table(2)
	refs := k.Grant("slow", 2, several, at(0))
	k.Done(refs[0].Task, at(2))
	for second := 1; second <= 40; second++ {
		k.Renew(refs[1], "slow", 0.1, at(second))
	}
	if got := k.GrantCopies("fast", 1, at(9)); len(got) != 0 {
		t.Errorf("copied %v before a time to live", got)
	}
	if got := k.GrantCopies("slow", 1, at(40)); len(got) != 0 {
		t.Error("copied to its own holder")
	}
	copied := k.GrantCopies("fast", 1, at(40))
	if len(copied) != 1 || !k.Held(refs[1], "slow") {
		t.Fatalf("copied %v", copied)
	}
	if got := k.GrantCopies("third", 1, at(40)); len(got) != 0 {
		t.Error("copied twice")
	}
	k.Done(copied[0].Task, at(41))
	if k.Open() != 0 || k.Renew(refs[1], "slow", 1, at(41)) {
		t.Error("a done task is alive")
	}
}

func TestTasksPutApart(t *testing.T) {
	k := table(2)
	k.PutApart("check 5", 5)
	k.PutApart("check 4", 4)
	k.Bar("check 4", "a")
	tasks := func(refs []Ref) (names []string) {
		for _, r := range refs {
			names = append(names, r.Task)
		}
		return names
	}
	if got := tasks(k.Grant("a", 9, []string{"a"}, at(0))); !slices.Equal(got, []string{"check 5"}) {
		t.Errorf("a first gets %v", got)
	}
	if got := tasks(k.Grant("a", 9, []string{"a"}, at(0))); !slices.Equal(got, []string{"1", "0"}) {
		t.Errorf("a then gets %v", got)
	}
	if got := tasks(k.GrantApart("b", 9, at(0))); !slices.Equal(got, []string{"check 4"}) {
		t.Errorf("b gets %v", got)
	}
	if k.Suits("check 4", "a") || !k.Suits("check 4", "b") || k.Suits("none", "b") {
		t.Error("suits whom it should not, or not whom it should")
	}
	k.ReleaseWorker("a")
	if got := tasks(k.Grant("b", 9, several, at(0))); !slices.Equal(got, []string{"check 5"}) {
		t.Errorf("after a left, b gets %v", got)
	}
}

func TestTaskPutApartIsNeverPoison(t *testing.T) {
	k := table(0)
	k.PutApart("check", 0)
	for _, worker := range []string{"a", "b", "c"} {
		refs := k.Grant(worker, 1, []string{worker}, at(0))
		if len(refs) != 1 || !k.Fail(refs[0], worker, "") || k.Suits("check", worker) {
			t.Fatalf("%s: %v", worker, refs)
		}
		if again := k.Grant(worker, 1, []string{worker}, at(0)); len(again) > 0 {
			t.Errorf("%s gets it again", worker)
		}
	}
	if p, poisoned := k.Poisoned([]string{"a", "b", "c"}); poisoned {
		t.Errorf("%+v", p)
	}
}

func TestNothingStragglesWhileItMayLinger(t *testing.T) {
	k := table(2)
	k.Linger(30 * time.Second)
	k.Grant("a", 1, several, at(0))
	k.Done("1", at(1))
	held := k.Grant("a", 1, several, at(1))[0]
	if got := k.GrantCopies("b", 1, at(40)); len(got) != 0 {
		t.Errorf("granted %v: it may still lie in a film", got)
	}
	if got := k.GrantCopies("b", 1, at(42)); len(got) != 1 || got[0].Task != held.Task {
		t.Errorf("granted %v", got)
	}
}

func TestWaitingTasksAreCounted(t *testing.T) {
	k := table(3)
	k.PutApart("check", 9)
	if got := k.Waiting(); got != 4 {
		t.Errorf("%d wait", got)
	}
	ref := k.GrantApart("a", 1, at(0))[0]
	k.Grant("b", 2, several, at(0))
	if got := k.Waiting(); got != 1 || ref.Task != "check" {
		t.Errorf("%d wait", got)
	}
}
