package fairness

import (
	"fmt"
	"iter"
	"math"
	"math/rand/v2"
	"slices"
	"testing"
	"time"
)

var start = time.Unix(1000, 0)

func numbers(jobs []Job, order iter.Seq[int]) []uint64 {
	var all []uint64
	for i := range order {
		all = append(all, jobs[i].Number)
	}
	return all
}

func TestOrder(t *testing.T) {
	var l Ledger
	l.Charge("a", 100, start)
	l.Charge("b", 50, start)
	jobs := []Job{
		{User: "a", Number: 1, Wants: true},
		{User: "b", Number: 2, Wants: true},
		{User: "b", Number: 3, Wants: true, Priority: -1},
		{User: "a", Number: 4, Wants: true, Priority: 1},
		{User: "b", Number: 5},
		{User: "b", Number: 6, Wants: true},
	}
	if got := numbers(jobs, l.Order(jobs, start)); !slices.Equal(got, []uint64{4, 2, 6, 1, 3}) {
		t.Errorf("order %v", got)
	}
	jobs[4].Underway = 60 // b's lead is gone, though the job itself wants nothing
	if got := numbers(jobs, l.Order(jobs, start)); !slices.Equal(got, []uint64{4, 1, 2, 6, 3}) {
		t.Errorf("with work under way: order %v", got)
	}
	jobs[4].Underway = 50 // a tie goes by age, over users
	if got := numbers(jobs, l.Order(jobs, start)); !slices.Equal(got, []uint64{4, 1, 2, 6, 3}) {
		t.Errorf("tie: order %v", got)
	}
}

func TestUsageDecays(t *testing.T) {
	var l Ledger
	l.Charge("a", 100, start)
	for _, bad := range []float64{math.NaN(), math.Inf(1), -3, 0} {
		l.Charge("a", bad, start)
	}
	if got := l.Usage("a", start.Add(-time.Hour)); got != 100 {
		t.Errorf("%v after the clock was set back", got)
	}
	l.Charge("a", 10, start.Add(HalfLife))
	if got := l.Usage("a", start.Add(2*HalfLife)); math.Abs(got-30) > 1e-9 {
		t.Errorf("usage %v, want 30", got)
	}
	if got := l.Usage("b", start); got != 0 {
		t.Errorf("a stranger's usage is %v", got)
	}
	for i := range 100 {
		l.Charge(fmt.Sprint("user ", i), 1, start.Add(2*HalfLife))
	}
	l.Charge("new", 1, start.Add(100*HalfLife))
	if len(l.users) != 1 {
		t.Errorf("%d users are remembered for ever", len(l.users)-1)
	}
}

func TestOrderDoesNotDependOnTheList(t *testing.T) {
	random := rand.New(rand.NewPCG(1, 2))
	for range 200 {
		var l Ledger
		jobs := randomJobs(random, 1+random.IntN(40))
		for _, user := range users {
			l.Charge(user, float64(random.IntN(4)), start)
		}
		want := numbers(jobs, l.Order(jobs, start))
		random.Shuffle(len(jobs), func(i, j int) { jobs[i], jobs[j] = jobs[j], jobs[i] })
		if got := numbers(jobs, l.Order(jobs, start)); !slices.Equal(got, want) {
			t.Fatalf("order %v, then %v", want, got)
		}
	}
}

var users = []string{"a", "b", "c", "d"}

func randomJobs(random *rand.Rand, n int) []Job {
	jobs := make([]Job, n)
	for i := range jobs {
		jobs[i] = Job{
			User: users[random.IntN(len(users))], Priority: random.IntN(3) - 1, Number: uint64(i),
			Underway: float64(random.IntN(3)), Wants: random.IntN(3) > 0,
		}
	}
	return jobs
}

// Whatever was used, no job goes before one of higher priority that wants a worker, all that want one
// are in the order, and users of one level are sorted by usage.
func TestNoPriorityInversion(t *testing.T) {
	random := rand.New(rand.NewPCG(3, 4))
	for range 500 {
		var l Ledger
		jobs := randomJobs(random, random.IntN(50))
		usage := make(map[string]float64)
		for _, user := range users {
			l.Charge(user, 10*random.Float64(), start)
			usage[user] = l.Usage(user, start)
		}
		wanting := 0
		for _, j := range jobs {
			usage[j.User] += j.Underway
			if j.Wants {
				wanting++
			}
		}
		order := slices.Collect(l.Order(jobs, start))
		if len(order) != wanting {
			t.Fatalf("%d of %d jobs are in the order", len(order), wanting)
		}
		for k, i := range order {
			if k == 0 {
				continue
			}
			before, after := jobs[order[k-1]], jobs[i]
			switch {
			case before.Priority < after.Priority:
				t.Fatalf("%+v goes before %+v", before, after)
			case before.Priority == after.Priority && usage[before.User] > usage[after.User]+1e-9:
				t.Fatalf("%+v goes before %+v with usages %v", before, after, usage)
			case before.Priority == after.Priority && before.User == after.User && before.Number > after.Number:
				t.Fatalf("%+v goes before %+v", before, after)
			}
		}
	}
}

// farm simulates workers that render tasks of random length.
type farm struct {
	ledger  Ledger
	jobs    []Job
	tasks   []int     // that are left, by job
	mean    []float64 // seconds of a task, by job
	got     map[string]float64
	waited  []time.Time // since when a job got nothing
	longest []time.Duration
	random  *rand.Rand
}

func newFarm(mean map[string]float64, jobs ...Job) *farm {
	f := &farm{jobs: jobs, got: map[string]float64{}, random: rand.New(rand.NewPCG(5, 6))}
	for i := range jobs {
		f.jobs[i].Number = uint64(i)
		f.jobs[i].Wants = true
		f.tasks = append(f.tasks, math.MaxInt)
		f.mean = append(f.mean, mean[jobs[i].User])
		f.waited = append(f.waited, start)
		f.longest = append(f.longest, 0)
	}
	return f
}

func first(order iter.Seq[int]) (index int, found bool) {
	for i := range order {
		return i, true
	}
	return 0, false
}

// run lets workers work for a time; each is told what to do when it is free.
func (f *farm) run(workers int, duration time.Duration) {
	type lease struct {
		job  int
		ends time.Time
		cost float64
	}
	busy := make([]lease, 0, workers)
	now := start
	for now.Before(start.Add(duration)) {
		for len(busy) < workers {
			i, found := first(f.ledger.Order(f.jobs, now))
			if !found {
				break
			}
			cost := f.mean[i] * (0.5 + f.random.Float64())
			busy = append(busy, lease{i, now.Add(time.Duration(cost * float64(time.Second))), cost})
			f.jobs[i].Underway += f.mean[i]
			f.tasks[i]--
			f.jobs[i].Wants = f.tasks[i] > 0
			f.longest[i] = max(f.longest[i], now.Sub(f.waited[i]))
			f.waited[i] = now
		}
		next := slices.MinFunc(busy, func(a, b lease) int { return a.ends.Compare(b.ends) })
		busy = slices.DeleteFunc(busy, func(l lease) bool { return l == next })
		now = next.ends
		f.jobs[next.job].Underway -= f.mean[next.job]
		f.ledger.Charge(f.jobs[next.job].User, next.cost, now)
		f.got[f.jobs[next.job].User] += next.cost
	}
}

func TestOneJobGetsAsMuchAsTen(t *testing.T) {
	jobs := []Job{{User: "one"}}
	for range 10 {
		jobs = append(jobs, Job{User: "ten"})
	}
	// The tasks of one take eight times as long as the other's.
	f := newFarm(map[string]float64{"one": 8, "ten": 1}, jobs...)
	const workers, seconds = 20, 3600.
	f.run(workers, seconds*time.Second)
	if total := f.got["one"] + f.got["ten"]; total < 0.99*workers*seconds {
		t.Errorf("workers stood idle: %v of %v s", total, workers*seconds)
	}
	if share := f.got["one"] / (f.got["one"] + f.got["ten"]); math.Abs(share-0.5) > 0.01 {
		t.Errorf("one got %.3f of the work", share)
	}
}

func TestNobodyStarvesAmongEquals(t *testing.T) {
	f := newFarm(map[string]float64{"a": 1, "b": 30, "c": 5}, Job{User: "a"}, Job{User: "b"}, Job{User: "c"})
	f.ledger.Charge("a", 600, start) // had the farm for itself before
	f.run(4, time.Hour)
	for i, longest := range f.longest {
		// a waits until the others have caught up: at most 600 s each, by 4 workers.
		if longest > 6*time.Minute {
			t.Errorf("%s waited for %v", f.jobs[i].User, longest)
		}
	}
}

func TestWhatAJobCannotUseGoesOn(t *testing.T) {
	f := newFarm(map[string]float64{"a": 1, "b": 1}, Job{User: "a", Priority: 5}, Job{User: "b", Priority: -5})
	f.tasks[0] = 100
	f.run(10, time.Minute)
	if f.got["a"] < 70 || f.got["a"] > 130 || f.got["b"] < 400 {
		t.Errorf("work %v", f.got)
	}
}

func BenchmarkOrder(b *testing.B) {
	for _, users := range []int{1, 1000} {
		b.Run(fmt.Sprintf("jobs=1000/users=%d", users), func(b *testing.B) {
			var l Ledger
			jobs := make([]Job, 1000)
			for i := range jobs {
				jobs[i] = Job{User: fmt.Sprint(i % users), Number: uint64(i), Wants: true}
				l.Charge(jobs[i].User, float64(i*7919%1000+1), start)
			}
			for b.Loop() {
				first(l.Order(jobs, start))
			}
		})
	}
}

func TestUsageElsewhereCounts(t *testing.T) {
	var here, there Ledger
	there.Charge("a", 100, start)
	there.Charge("idle", worthTelling/2, start)
	here.Charge("b", 60, start)
	said := there.Usages(start)
	if len(said) != 1 || said["a"] != 100 {
		t.Errorf("said %v", said)
	}
	jobs := []Job{{User: "a", Number: 1, Wants: true}, {User: "b", Number: 2, Wants: true}}
	here.Elsewhere(start, said, map[string]float64{"b": math.NaN(), "a": -1, "c": math.Inf(1)})
	if got := numbers(jobs, here.Order(jobs, start)); !slices.Equal(got, []uint64{2, 1}) {
		t.Errorf("order %v", got)
	}
	// What is said replaces what was said before, and is not told on.
	here.Elsewhere(start.Add(time.Second), map[string]float64{"a": 50})
	here.Elsewhere(start.Add(2*time.Second), map[string]float64{"a": 50})
	if got := numbers(jobs, here.Order(jobs, start.Add(2*time.Second))); !slices.Equal(got, []uint64{1, 2}) {
		t.Errorf("order %v after half of it has gone", got)
	}
	if said := here.Usages(start); len(said) != 1 || said["b"] != 60 {
		t.Errorf("said %v", said)
	}
	here.Elsewhere(start.Add(3 * HalfLife))
	if got := numbers(jobs, here.Order(jobs, start.Add(3*HalfLife))); !slices.Equal(got, []uint64{1, 2}) {
		t.Errorf("order %v after the other has left", got)
	}
}
