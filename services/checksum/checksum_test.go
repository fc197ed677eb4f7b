package checksum_test

import (
	"math/rand/v2"
	"os"
	"path/filepath"
	"strings"
	"testing"

	"google.golang.org/protobuf/encoding/prototext"
	"google.golang.org/protobuf/proto"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// examples reads the messages that both implementations know, by name of the file.
func examples(t *testing.T) map[string]checksum.Message {
	t.Helper()
	paths, err := filepath.Glob("../../proto/testdata/*.txtpb")
	if err != nil || len(paths) == 0 {
		t.Fatalf("no examples, error %v", err)
	}
	read := map[string]checksum.Message{}
	for _, path := range paths {
		text, err := os.ReadFile(path)
		if err != nil {
			t.Fatal(err)
		}
		var m checksum.Message = &farmv1.ReportRequest{}
		if strings.HasPrefix(filepath.Base(path), "segment_") {
			m = &farmv1.SegmentResult{}
		}
		if err := prototext.Unmarshal(text, m); err != nil {
			t.Fatalf("%s: %v", path, err)
		}
		read[filepath.Base(path)] = m
	}
	return read
}

func TestExamples(t *testing.T) {
	for name, m := range examples(t) {
		if err := checksum.Check(m); err != nil {
			t.Errorf("%s: %v", name, err)
		}
	}
}

// Whatever bit of a message flips on its way: it cannot be read, says the same as before, or is told.
func TestEveryFlippedBitIsTold(t *testing.T) {
	for name, m := range examples(t) {
		sent, err := proto.Marshal(m)
		if err != nil {
			t.Fatal(err)
		}
		read := 0
		for bit := range 8 * len(sent) {
			sent[bit/8] ^= 1 << (bit % 8)
			got := m.ProtoReflect().New().Interface().(checksum.Message)
			if proto.Unmarshal(sent, got) == nil && !proto.Equal(got, m) {
				read++
				if checksum.Check(got) == nil {
					t.Errorf("%s: bit %d changes the message to %v and is not told", name, bit, got)
				}
			}
			sent[bit/8] ^= 1 << (bit % 8)
		}
		if len(sent) > 0 && read == 0 {
			t.Errorf("%s: no flipped bit of %d bytes can be read", name, len(sent))
		}
	}
}

// Neither elements that change places nor bytes that move between fields give the same checksum.
func TestOrderCounts(t *testing.T) {
	sums := []*farmv1.LargeStepSums{{Count: 1}, {Count: 2}}
	first := checksum.Of(&farmv1.SegmentResult{LargeStepSums: sums})
	second := checksum.Of(&farmv1.SegmentResult{LargeStepSums: []*farmv1.LargeStepSums{sums[1], sums[0]}})
	if first == second {
		t.Error("two large-step sums may change places")
	}
	failure := func(worker, task string) *farmv1.ReportRequest {
		return &farmv1.ReportRequest{WorkerId: worker, Lease: &farmv1.LeaseRef{TaskId: task}}
	}
	if checksum.Of(failure("ab", "c")) == checksum.Of(failure("a", "bc")) {
		t.Error("a byte may move between fields")
	}
}

// A header has up to 64 MiB of states.
func BenchmarkStates(b *testing.B) {
	state := make([]byte, 1<<20)
	random := rand.New(rand.NewPCG(1, 1))
	for i := range state {
		state[i] = byte(random.Uint32())
	}
	m := &farmv1.SegmentResult{State: state}
	b.SetBytes(int64(len(state)))
	for b.Loop() {
		checksum.Of(m)
	}
}
