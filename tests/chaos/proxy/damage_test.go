package main

import (
	"math/rand/v2"
	"strings"
	"testing"

	"google.golang.org/protobuf/proto"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

const width = 64

// sample is a delivery of two segments whose film has one tile with values in its first row.
func sample() parcel {
	values := make([]int64, 32*32*3)
	for i := range 20 {
		values[i] = int64(i) << 30
	}
	tile := &farmv1.Tile{Plane: 1, X: 1, Data: pack(values)}
	batch := &farmv1.BatchHeader{
		JobId: "job", Round: 1, TileCount: 1,
		Segments: []*farmv1.SegmentResult{{Segment: 3, Digest: 5}, {Segment: 4}},
	}
	batch.Digest = digestOf(tile)
	batch.Segments[1].Digest = batch.GetDigest() - 5
	for _, s := range batch.GetSegments() {
		s.Counts, s.State = &farmv1.SegmentCounts{Rays: 7}, []byte("state")
		s.LargeStepSums = []*farmv1.LargeStepSums{{Count: 1, Sum: 0.5}, {}}
		s.Checksum = checksum.Of(s)
	}
	return parcel{
		header: &farmv1.DeliverHeader{Batch: batch},
		tiles:  []*farmv1.DeliverTiles{{Tiles: []*farmv1.Tile{tile}}},
	}
}

// digestOf a tile of a film that is width pixels wide, by the words of BatchHeader.digest.
func digestOf(t *farmv1.Tile) uint64 {
	values, err := unpack(t.GetData())
	if err != nil {
		panic(err)
	}
	var sum uint64
	for i, v := range values {
		channel, row, column := i/1024, i/32%32, i%32
		pixel := uint64(t.GetY()*32+uint32(row))*width + uint64(t.GetX()*32+uint32(column))
		sum += uint64(v) * pixelHash(pixel) * planeHash(uint64(t.GetPlane()), uint64(channel))
	}
	return sum
}

func TestDamageChangesTheParcelAndLeavesTheOriginal(t *testing.T) {
	for _, f := range allFaults {
		if !f.damages() {
			continue
		}
		x := sample()
		for seed := range uint64(50) {
			y, detail, err := damaged(x, f, rand.New(rand.NewPCG(seed, 0)))
			if err != nil || detail == "" {
				t.Fatalf("%s: detail %q, error %v", f, detail, err)
			}
			same := proto.Equal(x.header, y.header) && proto.Equal(x.tiles[0], y.tiles[0])
			if same || !proto.Equal(x.header, sample().header) || !proto.Equal(x.tiles[0], sample().tiles[0]) {
				t.Errorf("%s: nothing changed, or the original did (%s)", f, detail)
			}
		}
	}
}

func TestADamagedReportIsAnotherOfTheSameWorker(t *testing.T) {
	sample := &farmv1.ReportRequest{
		WorkerId: "w", Lease: &farmv1.LeaseRef{TaskId: "job/b0", Epoch: 1},
		Result: &farmv1.ReportRequest_Bootstrap{Bootstrap: &farmv1.BootstrapResult{Values: []float32{0, 1, 2}}},
	}
	in := proto.CloneOf(sample)
	for seed := range uint64(200) {
		out, detail, err := damagedReport(in, rand.New(rand.NewPCG(seed, 0)))
		if err != nil || detail == "" {
			t.Fatalf("detail %q, error %v", detail, err)
		}
		if proto.Equal(in, out) || !proto.Equal(in, sample) || out.GetWorkerId() != "w" {
			t.Errorf("%s: %v became %v", detail, sample, out)
		}
	}
}

func TestForgeryFitsItsDigests(t *testing.T) {
	x := sample()
	y, err := forged(x, 4)
	if err != nil {
		t.Fatal(err)
	}
	batch := y.header.GetBatch()
	if batch.GetDigest() == x.header.GetBatch().GetDigest() || batch.GetDigest() != digestOf(y.tiles[0].GetTiles()[0]) {
		t.Errorf("digest %x of the film %x", batch.GetDigest(), digestOf(y.tiles[0].GetTiles()[0]))
	}
	if batch.GetSegments()[0].GetDigest() != 5 || batch.GetSegments()[1].GetDigest() != batch.GetDigest()-5 {
		t.Errorf("segments %v do not add up to %x", batch.GetSegments(), batch.GetDigest())
	}
	for _, s := range batch.GetSegments() {
		if err := checksum.Check(s); err != nil {
			t.Errorf("segment %d: %v", s.GetSegment(), err)
		}
	}
}

func anything(fault) bool { return true }

func TestScheduleIsAFunctionOfItsSeed(t *testing.T) {
	draw := func(seed uint64) (faults []fault) {
		s, err := newSchedule(seed, 0.5, "repeat,flip-value")
		if err != nil {
			t.Fatal(err)
		}
		for range 64 {
			_, f, _ := s.delivery(anything)
			faults = append(faults, f)
		}
		return faults
	}
	first, again, other := draw(1), draw(1), draw(2)
	differences := 0
	for i := range first {
		if first[i] != again[i] {
			t.Errorf("message %d: %s, again %s", i+1, first[i], again[i])
		}
		if first[i] != other[i] {
			differences++
		}
	}
	if differences == 0 {
		t.Error("another seed gives the same schedule")
	}
	if _, err := newSchedule(1, 0.5, "repeat,nonsense"); err == nil {
		t.Error("a fault that does not exist is taken")
	}
}

// Every fault comes once before any comes again, and one that nobody could have waits for who can.
func TestFaultsTakeTurns(t *testing.T) {
	s, err := newSchedule(3, 1, strings.Join(faultNames(), ","))
	if err != nil {
		t.Fatal(err)
	}
	seen := map[fault]int{}
	for range len(allFaults) - 2 { // without flipReport, and flipState is refused
		_, f, _ := s.delivery(func(f fault) bool { return f != flipState })
		seen[f]++
	}
	if _, f, _ := s.delivery(anything); f != flipState {
		t.Errorf("%q comes before what was refused", f)
	}
	for _, f := range allFaults {
		want := 1
		if f == flipState || f == flipReport {
			want = 0
		}
		if seen[f] != want {
			t.Errorf("%q came %d times", f, seen[f])
		}
	}
	if _, f, _ := s.delivery(func(fault) bool { return false }); f != none {
		t.Errorf("%q came although nothing is taken", f)
	}
}
