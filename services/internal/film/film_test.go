package film

import (
	"bytes"
	"math"
	"math/big"
	"math/rand/v2"
	"slices"
	"testing"

	"github.com/klauspost/compress/zstd"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

var testShape = Shape{Width: 70, Height: 41, Layers: 2}

// TestSumsAgainstBigIntegers adds random extremes and compares every value with math/big.
func TestSumsAgainstBigIntegers(t *testing.T) {
	random := rand.New(rand.NewPCG(1, 2))
	f, want := New(testShape), make([]big.Int, LowTileValues)
	index, err := testShape.Index(Address{Low: true, Plane: 3})
	if err != nil {
		t.Fatal(err)
	}
	for range 200 {
		values := make([]int64, LowTileValues)
		for i := range values {
			values[i] = int64(random.Uint64())
			if i%3 == 0 {
				values[i] = []int64{math.MinInt64, math.MaxInt64, -1}[random.IntN(3)]
			}
			want[i].Add(&want[i], big.NewInt(values[i]))
		}
		f.Add(Tile{Index: index, Values: values})
	}
	if err := f.AddFilm(f.Snapshot()); err != nil {
		t.Fatal(err)
	}
	got := make([]float64, LowTileValues)
	f.AddLowPlane(got, 3, 1)
	for cell := range LowSize * LowSize {
		for c := range Channels {
			exact := new(big.Float).SetInt(want[c*LowSize*LowSize+cell].Lsh(&want[c*LowSize*LowSize+cell], 1))
			exact.Quo(exact, big.NewFloat(FixedOne))
			value, _ := exact.Float64()
			if math.Abs(got[cell*Channels+c]-value) > 4e-16*math.Abs(value) {
				t.Fatalf("cell %d channel %d: %v, want %v", cell, c, got[cell*Channels+c], value)
			}
		}
	}
}

func randomTile(random *rand.Rand, a Address) Tile {
	index, _ := testShape.Index(a)
	r := testShape.region(a)
	values := make([]int64, r.values())
	for i := range values {
		if i%r.side < r.width && i/r.side%r.side < r.height {
			values[i] = int64(random.Uint64() >> 20)
		}
	}
	return Tile{Index: index, Values: values}
}

func bytesOf(t *testing.T, f *Film) []byte {
	t.Helper()
	var b bytes.Buffer
	if err := f.Write(&b); err != nil {
		t.Fatal(err)
	}
	return b.Bytes()
}

func TestCanonicalFormIgnoresOrderAndAllocation(t *testing.T) {
	random := rand.New(rand.NewPCG(3, 4))
	tiles := []Tile{
		randomTile(random, Address{Plane: 1, X: 2, Y: 1}), randomTile(random, Address{Plane: 0}),
		randomTile(random, Address{Plane: 1, X: 2, Y: 1}), randomTile(random, Address{Low: true, Plane: 31}),
	}
	forward, backward, parts := New(testShape), New(testShape), New(testShape)
	for i := range tiles {
		forward.Add(tiles[i])
		backward.Add(tiles[len(tiles)-1-i])
		part := New(testShape)
		part.Add(tiles[i])
		if err := parts.AddFilm(part); err != nil {
			t.Fatal(err)
		}
	}
	empty := make([]int64, FullTileValues)
	backward.Add(Tile{Index: 5, Values: empty})
	want := bytesOf(t, forward)
	if !bytes.Equal(want, bytesOf(t, backward)) || !bytes.Equal(want, bytesOf(t, parts)) {
		t.Error("equal films differ in canonical form")
	}
	read, err := Read(bytes.NewReader(want))
	if err != nil || !bytes.Equal(want, bytesOf(t, read)) {
		t.Errorf("reading back: %v", err)
	}
	if _, err := Read(bytes.NewReader(want[:len(want)-9])); err == nil {
		t.Error("a truncated film was read")
	}
}

func TestSnapshotStays(t *testing.T) {
	random := rand.New(rand.NewPCG(5, 6))
	f := New(testShape)
	tile := randomTile(random, Address{})
	f.Add(tile)
	snapshot := f.Snapshot()
	before := bytesOf(t, snapshot)
	f.Add(tile)
	if !bytes.Equal(before, bytesOf(t, snapshot)) || bytes.Equal(before, bytesOf(t, f)) {
		t.Error("a snapshot changed with its film, or the film did not change")
	}
}

func TestWireRoundTripAndDigest(t *testing.T) {
	codec, err := NewCodec()
	if err != nil {
		t.Fatal(err)
	}
	random := rand.New(rand.NewPCG(7, 8))
	for _, a := range []Address{{}, {Plane: 3, X: 2, Y: 1}, {Low: true, Plane: 17}} {
		want := randomTile(random, a)
		got, digest, err := codec.DecodeTile(testShape, codec.EncodeTile(a, want.Values))
		if err != nil || got.Index != want.Index {
			t.Fatalf("%+v: index %d, error %v", a, got.Index, err)
		}
		var splats uint64
		r := testShape.region(a)
		for i, v := range want.Values {
			if got.Values[i] != v {
				t.Fatalf("%+v: value %d is %d, not %d", a, i, got.Values[i], v)
			}
			column, row, c := i%r.side, i/r.side%r.side, i/r.side/r.side
			pixel := (a.Y*TileSize+row)*testShape.Width + a.X*TileSize + column
			if a.Low {
				pixel = row*LowSize + column
			}
			splats += testShape.SplatDigest(a.Low, a.Plane, pixel, c, v)
		}
		if digest != splats {
			t.Errorf("%+v: digest %x of the tile, %x of its splats", a, digest, splats)
		}
	}
}

// TestUnshuffleIsTheInverse with all 64 bits of some values, and none of others.
func TestUnshuffleIsTheInverse(t *testing.T) {
	random := rand.New(rand.NewPCG(9, 10))
	want := make([]int64, LowTileValues)
	for i := range want {
		if i/8%3 > 0 {
			want[i] = int64(random.Uint64())
		}
	}
	if got := unshuffle(shuffle(want)); !slices.Equal(got, want) {
		t.Error("values changed")
	}
}

// TestDigestVector pins the hash that workers compute on their side.
func TestDigestVector(t *testing.T) {
	// mix(0): the first output of SplitMix64 seeded with 0.
	if got := mix(0); got != 0xe220a8397b1dcdaf {
		t.Errorf("mix(0) = %x", got)
	}
	want := (mix(5) | 1) * (mix(1<<48+3*2+1) | 1) * 3
	if got := testShape.SplatDigest(false, 2, 5, 1, 3); got != want {
		t.Errorf("digest %x, want %x", got, want)
	}
}

func TestDecodeRefuses(t *testing.T) {
	codec, err := NewCodec()
	if err != nil {
		t.Fatal(err)
	}
	encoder, _ := zstd.NewWriter(nil)
	outside := make([]int64, FullTileValues)
	outside[TileSize-1] = 1 // beyond column 70 of tile column 2
	pack := func(n int) []byte { return encoder.EncodeAll(make([]byte, n), nil) }
	for name, tile := range map[string]*farmv1.Tile{
		"plane":    {Plane: 4, Data: pack(FullTileValues * 8)},
		"row":      {Y: 2, Data: pack(FullTileValues * 8)},
		"low at x": {Low: true, X: 1, Data: pack(LowTileValues * 8)},
		"short":    {Data: pack(FullTileValues*8 - 1)},
		"long":     {Data: pack(FullTileValues*8 + 1)},
		"bomb":     {Data: pack(1 << 28)},
		"no zstd":  {Data: []byte("no zstd")},
		"empty":    {},
		"outside":  codec.EncodeTile(Address{X: 2}, outside),
	} {
		if _, _, err := codec.DecodeTile(testShape, tile); err == nil {
			t.Errorf("%s: accepted", name)
		}
	}
}

func TestCellPixelsCoverTheImage(t *testing.T) {
	for _, shape := range []Shape{{Width: 70, Height: 41}, {Width: 1, Height: 1}, {Width: 17, Height: 256}} {
		sum := 0
		for cell := range LowSize * LowSize {
			sum += shape.CellPixels(cell%LowSize, cell/LowSize)
		}
		if sum != shape.Width*shape.Height {
			t.Errorf("%+v: cells hold %d pixels", shape, sum)
		}
	}
}

func FuzzDecodeTile(f *testing.F) {
	codec, err := NewCodec()
	if err != nil {
		f.Fatal(err)
	}
	good := codec.EncodeTile(Address{}, make([]int64, FullTileValues))
	f.Add(good.Data, uint32(0), uint32(0), uint32(0), false)
	f.Fuzz(func(t *testing.T, data []byte, plane, x, y uint32, low bool) {
		tile, _, err := codec.DecodeTile(testShape, &farmv1.Tile{Low: low, Plane: plane, X: x, Y: y, Data: data})
		if err == nil {
			New(testShape).Add(tile)
		}
	})
}
