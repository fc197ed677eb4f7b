package flow_test

import (
	"context"
	"errors"
	"sync"
	"testing"
	"time"

	"metrofarm/services/internal/flow"
)

const (
	mega   = 1e6
	budget = 64 * mega
)

func TestOneWorkerDeliversOften(t *testing.T) {
	for _, batch := range []float64{0, 1000, 17 * mega} {
		if got := flow.SealInterval(1, batch, budget); got != flow.MinSeal {
			t.Errorf("batches of %g bytes: every %v, want %v", batch, got, flow.MinSeal)
		}
	}
}

// Where the bounds leave it free the interval keeps to the budget exactly; above it never does
// except where the longest interval is reached.
func TestManyWorkersKeepToTheBudget(t *testing.T) {
	for _, workers := range []int{2, 10, 100, 1000, 10000} {
		for _, batch := range []float64{0.1 * mega, 4 * mega, 17 * mega, 60 * mega} {
			interval := flow.SealInterval(workers, batch, budget)
			rate := float64(workers) * batch / interval.Seconds()
			switch {
			case interval < flow.MinSeal || interval > flow.MaxSeal:
				t.Errorf("%d workers, %g bytes: every %v", workers, batch, interval)
			case interval < flow.MaxSeal && rate > budget*1.0001:
				t.Errorf("%d workers, %g bytes: every %v is %g bytes per second", workers, batch, interval, rate)
			case interval > flow.MinSeal && interval < flow.MaxSeal && rate < budget*0.9999:
				t.Errorf("%d workers, %g bytes: every %v leaves the budget unused", workers, batch, interval)
			}
		}
	}
	if got := flow.SealInterval(1000, 10*mega, budget); got < 156*time.Second || got > 157*time.Second {
		t.Errorf("1000 workers with batches of 10 MB deliver every %v", got)
	}
}

func TestBatchSizeFollows(t *testing.T) {
	var size flow.BatchSize
	if got := size.Expect(160 * mega); got != 10*mega {
		t.Errorf("%g bytes are expected before any came", got)
	}
	size.Add(4 * mega)
	if got := size.Expect(160 * mega); got != 4*mega {
		t.Errorf("%g bytes after a batch of 4 MB", got)
	}
	for range 30 {
		size.Add(12 * mega)
	}
	if got := size.Expect(160 * mega); got < 11.9*mega || got > 12*mega {
		t.Errorf("%g bytes after many batches of 12 MB", got)
	}
}

func TestTwoBatchesPerWorker(t *testing.T) {
	q := flow.NewQueue(100)
	for _, worker := range []string{"a", "a", "b"} {
		if !q.Begin(worker) {
			t.Fatalf("a batch of %s was refused", worker)
		}
	}
	if q.Begin("a") {
		t.Error("a third was taken")
	}
	q.End("a")
	if !q.Begin("a") {
		t.Error("refused after one had ended")
	}
}

// reserve tells whether it is let in, for what should be.
func reserve(t *testing.T, q *flow.Queue, bytes int64) bool {
	t.Helper()
	return reserveWithin(t, q, bytes, time.Minute)
}

// waits tells whether it is not let in at once.
func waits(t *testing.T, q *flow.Queue, bytes int64) bool {
	t.Helper()
	return !reserveWithin(t, q, bytes, 20*time.Millisecond)
}

func reserveWithin(t *testing.T, q *flow.Queue, bytes int64, patience time.Duration) bool {
	t.Helper()
	ctx, cancel := context.WithTimeout(t.Context(), patience)
	defer cancel()
	err := q.Reserve(ctx, bytes)
	if err != nil && !errors.Is(err, context.DeadlineExceeded) {
		t.Fatal(err)
	}
	return err == nil
}

func TestBatchesWaitForRoom(t *testing.T) {
	q := flow.NewQueue(100)
	if !reserve(t, q, 60) || !reserve(t, q, 40) {
		t.Fatal("refused within the budget")
	}
	if !waits(t, q, 1) {
		t.Error("let in beyond the budget")
	}
	q.Free(40)
	q.Grow(30)
	if !waits(t, q, 11) {
		t.Error("let in although the other has grown")
	}
	if !reserve(t, q, 10) {
		t.Error("refused within the budget")
	}
	q.Free(10)
	q.Free(90)
	if got := q.Bytes(); got != 0 {
		t.Errorf("%d bytes when all is over", got)
	}
}

func TestAGiantIsReadAloneAndIsNotOvertaken(t *testing.T) {
	q := flow.NewQueue(100)
	if !q.Hold(10) || !reserve(t, q, 50) {
		t.Fatal("refused within the budget")
	}
	giant := make(chan error)
	go func() { giant <- q.Reserve(t.Context(), 1000) }()
	for {
		if withheld, _ := q.Withholds(); withheld { // it has arrived
			break
		}
		time.Sleep(time.Millisecond)
	}
	if !waits(t, q, 1) {
		t.Error("a small one has overtaken")
	}
	q.Free(50)
	if err := <-giant; err != nil {
		t.Fatal(err)
	}
	q.Free(1000)
	if !reserve(t, q, 90) {
		t.Error("refused after the giant")
	}
}

func TestLeasesAreWithheldUntilAQuarterIsFree(t *testing.T) {
	q := flow.NewQueue(100)
	if !reserve(t, q, 60) || !reserve(t, q, 40) {
		t.Fatal("refused within the budget")
	}
	check := func(step string, withheld, changed bool) {
		t.Helper()
		if w, c := q.Withholds(); w != withheld || c != changed {
			t.Errorf("%s: withheld %v, changed %v", step, w, c)
		}
	}
	check("full", false, false)
	q.Grow(1)
	check("over", true, true)
	check("over", true, false)
	q.Free(21)
	check("a fifth is free", true, false)
	q.Free(5)
	check("a quarter is free", false, true)
}

func TestHalfOfTheBudgetIsForWhatCanBeMerged(t *testing.T) {
	q := flow.NewQueue(100)
	if !q.Hold(30) || q.Hold(21) || !q.Hold(20) {
		t.Error("what is held is not bounded by half of the budget")
	}
	q.Unhold(30)
	q.Unhold(20)
	if !q.Hold(1000) {
		t.Error("one batch is always held")
	}
}

// Many at once, some giving up: all others get through, and the bound holds all the time.
func TestEverybodyGetsThrough(t *testing.T) {
	const limit, largest = 1000, 400
	q := flow.NewQueue(limit)
	var group sync.WaitGroup
	for i := range int64(200) {
		group.Go(func() {
			ctx, cancel := context.WithCancel(t.Context())
			defer cancel()
			bytes := 1 + i*7919%largest
			if i%10 == 0 {
				time.AfterFunc(time.Millisecond, cancel)
			}
			if err := q.Reserve(ctx, bytes); err != nil {
				return
			}
			time.Sleep(100 * time.Microsecond)
			q.Free(bytes)
		})
	}
	group.Wait()
	if q.Bytes() != 0 || q.Peak() > limit || q.Peak() < limit/2 {
		t.Errorf("%d bytes at the end, %d at most", q.Bytes(), q.Peak())
	}
}
