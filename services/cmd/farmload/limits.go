package main

import (
	"context"
	"flag"
	"runtime"
	"sync"
	"syscall"
	"time"
	"unsafe"

	"github.com/klauspost/compress/zstd"

	"metrofarm/services/internal/film"
)

const (
	copyBytes   = 256 << 20 // well beyond the caches
	limitsTime  = 1500 * time.Millisecond
	bothThreads = 2
)

// rate of one and of two threads at a time, in bytes per second of wall time, and of one in bytes
// per CPU second, which a busy machine does not slow down as much.
type rate struct {
	One       float64 `json:"one_thread"`
	Two       float64 `json:"two_threads"`
	PerCPU    float64 `json:"one_thread_per_cpu_second"`
	PerCPUTwo float64 `json:"two_threads_per_cpu_second"`
}

// limited is what limits prints.
type limited struct {
	Film filmSize `json:"film"`
	// CopyBytes read and as many written.
	Copy rate `json:"memory_copied"`
	// Zstd alone, in unpacked bytes.
	Zstd rate `json:"zstd_unpacked"`
	// Merge is all that is done to a film's tiles: unpacked, checked, added; in unpacked bytes.
	Merge rate `json:"merged"`
}

func limits(ctx context.Context, arguments []string) (any, error) {
	f := flag.NewFlagSet("limits", flag.ContinueOnError)
	path := f.String("film", "", "`FILE` that record has written")
	sum := f.Int("sum", 1, "films that are `N` recorded ones in one")
	if err := f.Parse(arguments); err != nil {
		return nil, err
	}
	recorded, err := readRecording(*path)
	if err != nil {
		return nil, err
	}
	t, err := newTemplate(recorded, *sum)
	if err != nil {
		return nil, err
	}
	result := limited{Film: t.size}
	result.Copy, err = measure(ctx, func() func() (int, error) { return copies() })
	if err == nil {
		result.Zstd, err = measure(ctx, func() func() (int, error) { return t.unpacks() })
	}
	if err == nil {
		result.Merge, err = measure(ctx, func() func() (int, error) { return t.merges() })
	}
	return result, err
}

// measure runs steps, each of which tells its bytes, on one thread and on two.
func measure(ctx context.Context, make func() func() (int, error)) (rate, error) {
	one, perCPU, err := measureOn(ctx, 1, make)
	if err != nil {
		return rate{}, err
	}
	two, perCPUTwo, err := measureOn(ctx, bothThreads, make)
	return rate{one, two, perCPU, perCPUTwo}, err
}

func measureOn(ctx context.Context, threads int, prepare func() func() (int, error)) (perSecond, perCPU float64, err error) {
	var group sync.WaitGroup
	var mu sync.Mutex
	for range threads {
		step := prepare()
		group.Go(func() {
			runtime.LockOSThread()
			defer runtime.UnlockOSThread()
			wall, cpu, n, failed := repeat(ctx, step)
			mu.Lock()
			defer mu.Unlock()
			perSecond += float64(n) / wall
			perCPU += float64(n) / cpu / float64(threads)
			if failed != nil {
				err = failed
			}
		})
	}
	group.Wait()
	return perSecond, perCPU, err
}

func repeat(ctx context.Context, step func() (int, error)) (wall, cpu float64, bytes int, err error) {
	if _, err := step(); err != nil { // touches the memory
		return 1, 1, 0, err
	}
	start, before := time.Now(), threadSeconds()
	for time.Since(start) < limitsTime && ctx.Err() == nil {
		n, err := step()
		if err != nil {
			return 1, 1, 0, err
		}
		bytes += n
	}
	return time.Since(start).Seconds(), threadSeconds() - before, bytes, ctx.Err()
}

func threadSeconds() float64 {
	const thread = 1 // RUSAGE_THREAD
	var used syscall.Rusage
	_ = syscall.Getrusage(thread, &used) // cannot fail for the thread itself
	return float64(used.Utime.Sec+used.Stime.Sec) + float64(used.Utime.Usec+used.Stime.Usec)/1e6
}

func copies() func() (int, error) {
	from, to := make([]byte, copyBytes), make([]byte, copyBytes)
	for i := range from {
		from[i] = byte(i)
	}
	return func() (int, error) { return copy(to, from), nil }
}

func (t *template) unpacks() func() (int, error) {
	decoder, err := zstd.NewReader(nil, zstd.WithDecoderConcurrency(1))
	buffer := make([]byte, 0, film.FullTileValues*int(unsafe.Sizeof(int64(0))))
	return func() (bytes int, _ error) {
		for _, tile := range t.tiles {
			var raw []byte
			if err == nil {
				raw, err = decoder.DecodeAll(tile.GetData(), buffer)
			}
			bytes += len(raw)
		}
		return bytes, err
	}
}

func (t *template) merges() func() (int, error) {
	sum := film.New(t.shape)
	return func() (bytes int, _ error) {
		for _, packed := range t.tiles {
			tile, _, err := t.codec.DecodeTile(t.shape, packed)
			if err != nil {
				return 0, err
			}
			sum.Add(tile)
			bytes += len(tile.Values) * int(unsafe.Sizeof(tile.Values[0]))
		}
		return bytes, nil
	}
}
