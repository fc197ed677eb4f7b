package main

import (
	"context"
	"errors"
	"flag"
	"fmt"
	"os"
	"strconv"
	"sync"
	"syscall"
	"time"

	"google.golang.org/grpc"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/coordinator/fakeworker"
)

// What real workers are told and ask for.
const (
	heartbeatPace = 3 * time.Second
	leaseWait     = 10 * time.Second
)

// ran is what run prints.
type ran struct {
	Workers       int      `json:"workers"`
	RenderSeconds float64  `json:"render_seconds"`
	Segments      int      `json:"segments_per_batch"`
	Film          filmSize `json:"film"`
	traffic
	CPUSeconds float64 `json:"cpu_seconds"` // of the simulation itself
}

// crew is the simulated workers.
type crew struct {
	coordinator             string
	workers, segments       int
	render, seconds, warmup time.Duration
	film                    *template
	calls                   *calls
}

func run(ctx context.Context, arguments []string) (any, error) {
	f := flag.NewFlagSet("run", flag.ContinueOnError)
	w := crew{calls: newCalls()}
	f.StringVar(&w.coordinator, "coordinator", "127.0.0.1:7070", "`ADDRESS` of the coordinator")
	f.IntVar(&w.workers, "workers", 100, "`N` workers, each with a connection of its own")
	f.IntVar(&w.segments, "segments", 16, "`N` segments per batch at most, at least 4")
	f.DurationVar(&w.render, "render", 1500*time.Millisecond, "`TIME` from a lease to its batch")
	f.DurationVar(&w.seconds, "for", 10*time.Second, "`TIME` to count")
	f.DurationVar(&w.warmup, "warmup", 2*time.Second, "`TIME` before that")
	path := f.String("film", "", "`FILE` that record has written")
	sum := f.Int("sum", 1, "batches that are `N` recorded ones in one")
	if err := f.Parse(arguments); err != nil {
		return nil, err
	}
	if w.workers < 1 || w.segments < 4 {
		return nil, errors.New("-workers must be at least 1, -segments at least 4")
	}
	recorded, err := readRecording(*path)
	if err != nil {
		return nil, err
	}
	if w.film, err = newTemplate(recorded, *sum); err != nil {
		return nil, err
	}
	return w.work(ctx)
}

func (w *crew) work(ctx context.Context) (any, error) {
	ctx, stop := context.WithCancel(ctx)
	defer stop()
	failed := make(chan error, w.workers)
	var group sync.WaitGroup
	for i := range w.workers {
		group.Go(func() {
			if err := w.one(ctx, i); err != nil {
				failed <- err
			}
		})
	}
	before, err := w.count(ctx, failed)
	result := ran{
		Workers: w.workers, RenderSeconds: w.render.Seconds(), Segments: w.segments, Film: w.film.size,
		traffic: w.calls.summary(), CPUSeconds: cpuSeconds() - before,
	}
	stop()
	group.Wait()
	return result, err
}

// count lets the workers work; it fails with the first of them.
func (w *crew) count(ctx context.Context, failed <-chan error) (cpuBefore float64, err error) {
	for _, span := range []time.Duration{w.warmup, w.seconds} {
		w.calls.reset()
		cpuBefore = cpuSeconds()
		select {
		case <-time.After(span):
		case err := <-failed:
			return cpuBefore, err
		case <-ctx.Done():
			return cpuBefore, ctx.Err()
		}
	}
	return cpuBefore, nil
}

// one worker, with a name that no earlier one had.
func (w *crew) one(ctx context.Context, number int) error {
	connection, err := dial(w.coordinator,
		grpc.WithUnaryInterceptor(w.calls.unary), grpc.WithStreamInterceptor(w.calls.stream))
	if err != nil {
		return err
	}
	defer connection.Close()
	// Workers do not all come at the same moment.
	select {
	case <-time.After(time.Duration(number) * min(w.render, w.warmup) / time.Duration(w.workers)):
	case <-ctx.Done():
		return nil
	}
	worker := fakeworker.Worker{
		Client:  farmv1.NewFarmServiceClient(connection),
		Name:    fmt.Sprintf("%s-%d", strconv.FormatInt(int64(os.Getpid()), 36), number),
		Version: "simulated",
		Report: &scenev1.SceneReport{
			Width: uint32(w.film.shape.Width), Height: uint32(w.film.shape.Height),
			Filter: scenev1.Filter_FILTER_GAUSSIAN, FilterRadius: 1.5,
			MaxDepth: -1, RrDepth: 5, SampleCount: 16, Integrator: "pssmlt",
		},
		MaxSegments: uint32(w.segments), Delay: w.render, Pace: heartbeatPace, Wait: leaseWait,
		Leaves: true, StateBytes: w.film.size.StateBytes, Film: w.film.of,
	}
	return worker.Run(ctx)
}

func cpuSeconds() float64 {
	var used syscall.Rusage
	_ = syscall.Getrusage(syscall.RUSAGE_SELF, &used) // cannot fail for the process itself
	return float64(used.Utime.Sec+used.Stime.Sec) + float64(used.Utime.Usec+used.Stime.Usec)/1e6
}
