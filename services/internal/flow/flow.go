// Package flow keeps workers from sending more than a coordinator can take: how long each of them
// collects before it delivers, and how much memory batches have that are not merged yet. It knows
// neither jobs nor the network.
package flow

import "time"

// Bounds of the time that a worker collects segments in a film before it delivers it. The shortest
// keeps images live; the longest bounds what is lost with a worker.
const (
	MinSeal = 3 * time.Second
	MaxSeal = 10 * time.Minute
)

// SealInterval is how long each of so many workers should collect, so that all of them together
// deliver at most `budget` bytes per second.
func SealInterval(workers int, batchBytes, budget float64) time.Duration {
	seconds := float64(workers) * batchBytes / budget
	return time.Duration(min(max(seconds, MinSeal.Seconds()), MaxSeal.Seconds()) * float64(time.Second))
}

// BatchSize is how large batches are, packed: an average in which the latest count most, because
// batches grow with the time that workers collect.
type BatchSize struct {
	bytes float64 // 0: none has come
}

// latestShare is the weight of the latest batch.
const latestShare = 0.25

// Add counts a batch.
func (b *BatchSize) Add(bytes int) {
	if b.bytes == 0 {
		b.bytes = float64(bytes)
	}
	b.bytes += latestShare * (float64(bytes) - b.bytes)
}

// packedShare is what a batch is taken to have of its film's memory before any has come.
const packedShare = 1.0 / 16

// Expect is the size of the next batch of a film that takes so many bytes unpacked.
func (b *BatchSize) Expect(unpacked int64) float64 {
	if b.bytes > 0 {
		return b.bytes
	}
	return packedShare * float64(unpacked)
}
