package film

import (
	"fmt"
	"math"
	"math/rand/v2"
	"syscall"
	"testing"
	"time"
)

// splattedTile has this share of values that are not zero, as large as splats are: the sum of a few,
// dithered to the last bit.
func splattedTile(random *rand.Rand, share float64) []int64 {
	values := make([]int64, FullTileValues)
	for i := range values {
		if random.Float64() < share {
			values[i] = int64(-math.Log(random.Float64()) * FixedOne)
		}
	}
	return values
}

// BenchmarkMerge is all that the coordinator does to a tile: unpack, check, add.
func BenchmarkMerge(b *testing.B) {
	for _, share := range []float64{0.01, 0.14, 0.3, 1} {
		b.Run(fmt.Sprintf("%v", share), func(b *testing.B) {
			codec, err := NewCodec()
			if err != nil {
				b.Fatal(err)
			}
			random := rand.New(rand.NewPCG(1, 2))
			packed := codec.EncodeTile(Address{}, splattedTile(random, share))
			sum := New(testShape)
			b.SetBytes(FullTileValues * 8)
			b.ReportAllocs()
			before := cpuTime()
			for b.Loop() {
				tile, _, err := codec.DecodeTile(testShape, packed)
				if err != nil {
					b.Fatal(err)
				}
				sum.Add(tile)
			}
			b.ReportMetric(float64((cpuTime()-before).Nanoseconds())/float64(b.N), "cpu-ns/op")
		})
	}
}

// cpuTime of the process: a busy machine does not slow it down as much as the wall clock.
func cpuTime() time.Duration {
	var used syscall.Rusage
	_ = syscall.Getrusage(syscall.RUSAGE_SELF, &used) // cannot fail for the process itself
	return time.Duration(used.Utime.Nano() + used.Stime.Nano())
}
