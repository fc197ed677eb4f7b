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

// splatsPerSegment keeps the films sparse.
const splatsPerSegment = 50

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

// canvas is an open film of the worker.
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
	c.tile(full, film.FullTileValues)[at] += v
	low := film.Address{Low: true, Plane: group*c.shape.Layers + layer}
	cell := y/c.shape.CellHeight()*film.LowSize + x/c.shape.CellWidth()
	c.tile(low, film.LowTileValues)[channel*film.LowSize*film.LowSize+cell] += v
	return c.shape.SplatDigest(false, full.Plane, pixel, channel, v) + c.shape.SplatDigest(true, low.Plane, cell, channel, v)
}

func (c *canvas) tile(a film.Address, size int) []int64 {
	if c.tiles[a] == nil {
		c.tiles[a] = make([]int64, size)
	}
	return c.tiles[a]
}

// renderChains pretends to run a chain group: splats, counts and the new state are a function of
// the spec's seed, the group, the round and the state before.
func (c *canvas) renderChains(spec *jobv1.ResolvedSpec, number uint32, g *farmv1.ChainGroupState) *farmv1.SegmentResult {
	group := int(g.GetGroup())
	n := spec.GetRoundSizes()[number] * uint64(spec.GetGroupSize())
	before := uint64(0)
	for _, index := range g.GetSeedIndices() {
		before = before*31 + index
	}
	var sums []*farmv1.LargeStepSums
	if state := g.GetState(); len(state) > 0 {
		before = binary.LittleEndian.Uint64(state)
	}
	random := keyed(spec.GetSeed(), uint64(group), uint64(number), before)
	large := n / 3
	result := &farmv1.SegmentResult{
		Segment: g.GetGroup(),
		Counts: &farmv1.SegmentCounts{
			Mutations: n, PathEvaluations: n, Rays: 3*n + random.next()%100,
			LargeSteps: large, LargeAccepted: large / 4, SmallSteps: n - large, SmallAccepted: (n - large) / 2,
			Coordinates: 10 * n,
		},
	}
	if spec.GetDelayedRejection().GetEnabled() {
		result.Counts.SecondStages, result.Counts.SecondAccepted = (n-large)/2, (n-large)/8
	}
	if plan.Multiplexed(spec) {
		result.Counts.ProposedByLength, result.Counts.AcceptedByLength = []uint64{0, n - n/4, n / 4}, []uint64{0, n / 4, n / 8}
	}
	c.splatter(random, group%film.Halves, func() int { return group % film.StatGroups }, result)
	result.State = binary.LittleEndian.AppendUint64(nil, random.next())
	for range spec.GetGroupSize() {
		u := random.uniform()
		sums = append(sums, &farmv1.LargeStepSums{Count: large, Sum: u, SumSquares: u * u})
	}
	result.LargeStepSums = sums
	return result
}

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

// renderPaths pretends to trace the samples of one segment.
func (c *canvas) renderPaths(spec *jobv1.ResolvedSpec, cells int, number, segment uint32) *farmv1.SegmentResult {
	perSegment := int(spec.GetBlocksPerSegment()) * int(spec.GetGroupSize())
	n := uint64(min(perSegment, cells-int(segment)*perSegment)) * spec.GetRoundSizes()[number]
	random := keyed(spec.GetSeed(), uint64(segment), uint64(number))
	result := &farmv1.SegmentResult{
		Segment: segment,
		Counts:  &farmv1.SegmentCounts{Mutations: n, PathEvaluations: n, Rays: 2 * n},
	}
	for half := range film.Halves {
		c.splatter(random, half, func() int { return half + 2*int(random.next()%8) }, result)
	}
	return result
}

func (c *canvas) splatter(random *generator, half int, group func() int, result *farmv1.SegmentResult) {
	for range splatsPerSegment {
		pixel := int(random.next() % uint64(c.shape.Width*c.shape.Height))
		layer := int(random.next() % uint64(c.shape.Layers))
		g := group()
		for channel := range film.Channels {
			v := int64(random.uniform() * 3 * film.FixedOne)
			result.Digest += c.add(half, g, layer, pixel, channel, v)
		}
	}
}
