package fakeworker

import (
	"encoding/binary"
	"hash/fnv"
	"math"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/plan"
)

// splatsPerStep keeps the films sparse: of a mutation of all chains of a group, or a sample of all
// cells of a segment.
const splatsPerStep = 3

// generator is SplitMix64.
type generator uint64

// keyed starts a generator that is a function of its key alone.
func keyed(key ...uint64) *generator {
	h := fnv.New64a()
	for _, k := range key {
		_ = binary.Write(h, binary.LittleEndian, k) // a hash never fails
	}
	g := generator(h.Sum64())
	return &g
}

func (g *generator) next() uint64 {
	*g += 0x9e3779b97f4a7c15
	z := uint64(*g)
	z = (z ^ z>>30) * 0xbf58476d1ce4e5b9
	z = (z ^ z>>27) * 0x94d049bb133111eb
	return z ^ z>>31
}

func (g *generator) uniform() float64 { return float64(g.next()>>11) / (1 << 53) }

// BootstrapValue is the f of a bootstrap index: mostly dark, sometimes bright.
func BootstrapValue(seed, index uint64) float32 {
	u := keyed(seed, index).uniform()
	if u < 0.5 {
		return 0
	}
	return float32(math.Pow(u, 8))
}

// canvas is an open film of the worker; without tiles it only knows digests.
type canvas struct {
	shape film.Shape
	tiles map[film.Address][]int64
}

func newCanvas(spec *jobv1.ResolvedSpec) *canvas {
	return &canvas{shape: plan.Shape(spec), tiles: map[film.Address][]int64{}}
}

// add splats and returns the splat's digest.
func (c *canvas) add(half, group, layer, pixel, channel int, v int64) uint64 {
	x, y := pixel%c.shape.Width, pixel/c.shape.Width
	full := film.Address{Plane: half*c.shape.Layers + layer, X: x / film.TileSize, Y: y / film.TileSize}
	at := (channel*film.TileSize+y%film.TileSize)*film.TileSize + x%film.TileSize
	low := film.Address{Low: true, Plane: group*c.shape.Layers + layer}
	cell := y/c.shape.CellHeight()*film.LowSize + x/c.shape.CellWidth()
	if c.tiles != nil {
		c.tile(full, film.FullTileValues)[at] += v
		c.tile(low, film.LowTileValues)[channel*film.LowSize*film.LowSize+cell] += v
	}
	return c.shape.SplatDigest(false, full.Plane, pixel, channel, v) + c.shape.SplatDigest(true, low.Plane, cell, channel, v)
}

func (c *canvas) tile(a film.Address, size int) []int64 {
	if c.tiles[a] == nil {
		c.tiles[a] = make([]int64, size)
	}
	return c.tiles[a]
}

// renderChains pretends to run a chain group: what mutation i of the group's chains splats and counts
// is a function of the spec's seed, the group, the seeds of its chains and i, wherever rounds end.
func (c *canvas) renderChains(spec *jobv1.ResolvedSpec, number uint32, g *farmv1.ChainGroupState) *farmv1.SegmentResult {
	group := int(g.GetGroup())
	size, chains := spec.GetRoundSizes()[number], uint64(spec.GetGroupSize())
	origin, done := chainsBefore(g)
	result := &farmv1.SegmentResult{Segment: g.GetGroup(), Counts: chainCounts(spec, done*chains, (done+size)*chains)}
	for i := done; i < done+size; i++ {
		random := keyed(spec.GetSeed(), uint64(group), i, origin)
		result.Counts.Rays += random.next() % 100
		c.splatter(random, group%film.Halves, func() int { return group % film.StatGroups }, result)
	}
	result.State = binary.LittleEndian.AppendUint64(binary.LittleEndian.AppendUint64(nil, origin), done+size)
	for chain := range chains {
		u, k := keyed(origin, uint64(group), chain).uniform(), largeSteps(done+size)
		result.LargeStepSums = append(result.LargeStepSums,
			&farmv1.LargeStepSums{Count: k, Sum: float64(k) * u, SumSquares: float64(k) * u * u})
	}
	return result
}

// chainCounts of the mutations from a to b of a group: differences of what they are in all, so that it
// does not matter where rounds end.
func chainCounts(spec *jobv1.ResolvedSpec, a, b uint64) *farmv1.SegmentCounts {
	n, large := b-a, largeSteps(b)-largeSteps(a)
	oneIn := func(k uint64) uint64 { return b/k - a/k }
	counts := &farmv1.SegmentCounts{
		Mutations: n, PathEvaluations: n, Rays: 3 * n,
		LargeSteps: large, LargeAccepted: oneIn(12), SmallSteps: n - large, SmallAccepted: oneIn(4),
		Coordinates: 10 * n,
	}
	if spec.GetDelayedRejection().GetEnabled() {
		counts.SecondStages, counts.SecondAccepted = oneIn(3), oneIn(12)
	}
	if plan.Multiplexed(spec) {
		counts.ProposedByLength = []uint64{0, n - oneIn(4), oneIn(4)}
		counts.AcceptedByLength = []uint64{0, oneIn(4), oneIn(8)}
	}
	return counts
}

// chainsBefore tells where the chains of a group come from and how many mutations each has behind it.
func chainsBefore(g *farmv1.ChainGroupState) (origin, done uint64) {
	if state := g.GetState(); len(state) > 0 {
		return binary.LittleEndian.Uint64(state), binary.LittleEndian.Uint64(state[8:])
	}
	for _, index := range g.GetSeedIndices() {
		origin = origin*31 + index
	}
	return origin, 0
}

// largeSteps of the first n mutations.
func largeSteps(n uint64) uint64 { return n / 3 }

// trap pretends that chains of group 3 are trapped.
func trap(result *farmv1.SegmentResult, number uint32) {
	switch {
	case result.GetSegment() != 3:
	case number == 0:
		result.Counts.LongestStay, result.Counts.ChainsTrapped = 4000, 2
	case number == 1:
		result.Counts.LongestStay, result.Counts.ChainsFreed = 4500, 1
	}
}

// renderPaths pretends to trace the samples of one segment, from the first one on, wherever rounds end.
func (c *canvas) renderPaths(spec *jobv1.ResolvedSpec, cells int, task *farmv1.PathSegmentsTask) *farmv1.SegmentResult {
	perSegment := int(spec.GetBlocksPerSegment()) * int(spec.GetGroupSize())
	segment, size := task.GetFirstSegment(), spec.GetRoundSizes()[task.GetRound()]
	n := uint64(min(perSegment, cells-int(segment)*perSegment)) * size
	result := &farmv1.SegmentResult{
		Segment: segment,
		Counts:  &farmv1.SegmentCounts{Mutations: n, PathEvaluations: n, Rays: 2 * n},
	}
	for i := task.GetFirstSample(); i < task.GetFirstSample()+size; i++ {
		random := keyed(spec.GetSeed(), uint64(segment), i)
		half := int(i % film.Halves)
		c.splatter(random, half, func() int { return half + 2*int(random.next()%8) }, result)
	}
	return result
}

func (c *canvas) splatter(random *generator, half int, group func() int, result *farmv1.SegmentResult) {
	for range splatsPerStep {
		pixel := int(random.next() % uint64(c.shape.Width*c.shape.Height))
		layer := int(random.next() % uint64(c.shape.Layers))
		g := group()
		for channel := range film.Channels {
			v := int64(random.uniform() * 3 * film.FixedOne)
			result.Digest += c.add(half, g, layer, pixel, channel, v)
		}
	}
}
