package coordinator_test

import (
	"context"
	"fmt"
	"path/filepath"
	"strings"
	"sync"
	"syscall"
	"testing"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store/bolt"
)

// reportCPU tells the CPU time per operation: on a machine that does other things, the time of the clock
// tells little.
func reportCPU(b *testing.B, measured func()) {
	b.Helper()
	used := func() time.Duration {
		var usage syscall.Rusage
		if err := syscall.Getrusage(syscall.RUSAGE_SELF, &usage); err != nil {
			b.Fatal(err)
		}
		return time.Duration(usage.Utime.Nano() + usage.Stime.Nano())
	}
	before := used()
	measured()
	b.ReportMetric(float64((used()-before).Microseconds())/float64(b.N), "cpu-us/op")
}

// benchFarm is a coordinator with jobs that no worker has looked at.
func benchFarm(b *testing.B, jobs, users int) *coordinator.Coordinator {
	b.Helper()
	must := func(err error) {
		if err != nil {
			b.Fatal(err)
		}
	}
	folder := b.TempDir()
	db, err := bolt.Open(filepath.Join(folder, "metrofarm.db"), nil)
	must(err)
	backend, err := dir.Open(filepath.Join(folder, "blobs"))
	must(err)
	blobs := blob.New(backend)
	sha, size, err := blobs.PutFile(b.Context(), strings.NewReader("<scene/>"), 100)
	must(err)
	digest, err := blobs.PutManifest(b.Context(), []blob.File{{Path: "scene.xml", Size: size, SHA256: sha}})
	must(err)
	c, err := coordinator.New(b.Context(), coordinator.Options{Store: db, Blobs: blobs, LeaseTTL: time.Hour})
	must(err)
	for i := range jobs {
		ctx := auth.With(b.Context(), auth.Identity{User: fmt.Sprint("user ", i%users)})
		_, err := c.Submit(ctx, job.Request{Scene: digest, Entry: "scene.xml"}, "")
		must(err)
	}
	ctx, cancel := context.WithCancel(b.Context())
	done := make(chan struct{})
	go func() { defer close(done); _ = c.Run(ctx) }()
	b.Cleanup(func() { cancel(); <-done; db.Close() })
	return c
}

func benchWorker(b *testing.B, c *coordinator.Coordinator, number int) string {
	b.Helper()
	registered, err := c.Register(b.Context(), &farmv1.RegisterRequest{
		Name: "w", Version: testVersion, Threads: 1, Instance: fmt.Sprintf("%012x%020x", number, 0),
	})
	if err != nil {
		b.Fatal(err)
	}
	return registered.GetWorkerId()
}

func leaseOne(b *testing.B, c *coordinator.Coordinator, worker string) []*farmv1.Task {
	b.Helper()
	answer, err := c.Lease(b.Context(), &farmv1.LeaseRequest{WorkerId: worker, MaxSegments: 1})
	if err != nil {
		b.Fatal(err)
	}
	return answer.GetTasks()
}

func giveBack(b *testing.B, c *coordinator.Coordinator, worker string, tasks []*farmv1.Task) {
	b.Helper()
	in := &farmv1.ReleaseRequest{WorkerId: worker}
	for _, t := range tasks {
		in.Leases = append(in.Leases, leaseOf(t))
	}
	if _, err := c.Release(b.Context(), in); err != nil {
		b.Fatal(err)
	}
}

// BenchmarkLease measures a lease call and a release where 1000 jobs wait and 300 workers are known.
func BenchmarkLease(b *testing.B) {
	for _, users := range []int{1, 1000} {
		b.Run(fmt.Sprintf("jobs=1000/users=%d", users), func(b *testing.B) {
			c := benchFarm(b, 1000, users)
			for number := range 300 {
				benchWorker(b, c, number)
			}
			worker := benchWorker(b, c, 300)
			giveBack(b, c, worker, leaseOne(b, c, worker)) // the first lease of a job is stored
			reportCPU(b, func() {
				for b.Loop() {
					giveBack(b, c, worker, leaseOne(b, c, worker))
				}
			})
		})
	}
}

// BenchmarkHerd measures what one task costs that 300 waiting workers are told of, beside 1000 jobs
// without waiting tasks: from the release of a lease until another worker has it.
func BenchmarkHerd(b *testing.B) {
	c := benchFarm(b, 1000, 10)
	holder := benchWorker(b, c, 1000)
	var held []*farmv1.Task
	for tasks := leaseOne(b, c, holder); len(tasks) > 0; tasks = leaseOne(b, c, holder) {
		held = tasks
	}
	ctx, cancel := context.WithCancel(b.Context())
	type grant struct {
		worker string
		tasks  []*farmv1.Task
	}
	grants := make(chan grant)
	var waiting sync.WaitGroup
	for number := range 300 {
		worker := benchWorker(b, c, number)
		waiting.Go(func() {
			for ctx.Err() == nil {
				answer, err := c.Lease(ctx, &farmv1.LeaseRequest{WorkerId: worker, MaxSegments: 1, WaitSeconds: 30})
				if err == nil && len(answer.GetTasks()) > 0 {
					grants <- grant{worker, answer.GetTasks()}
				}
			}
		})
	}
	last := grant{holder, held}
	reportCPU(b, func() {
		for b.Loop() {
			giveBack(b, c, last.worker, last.tasks)
			last = <-grants
		}
	})
	cancel()
	waiting.Wait()
}
