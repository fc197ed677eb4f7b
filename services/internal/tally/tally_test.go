package tally

import (
	"reflect"
	"slices"
	"testing"

	"google.golang.org/protobuf/reflect/protoreflect"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// TestEveryCountIsHashed changes each number of a segment's counts in turn: each changes the words.
func TestEveryCountIsHashed(t *testing.T) {
	zero := FromProto(&farmv1.SegmentCounts{})
	before := zero.Words()
	fields := (&farmv1.SegmentCounts{}).ProtoReflect().Descriptor().Fields()
	for i := range fields.Len() {
		p := &farmv1.SegmentCounts{}
		field, one := fields.Get(i), protoreflect.ValueOfUint64(1)
		if field.IsList() {
			p.ProtoReflect().Mutable(field).List().Append(one)
		} else {
			p.ProtoReflect().Set(field, one)
		}
		counts := FromProto(p)
		if slices.Equal(counts.Words(), before) {
			t.Errorf("%s is no part of the hash", field.Name())
		}
	}
	if fields.Len() < 20 {
		t.Errorf("only %d counts", fields.Len())
	}
}

func TestAddSumsAllButTheLongestStay(t *testing.T) {
	var ones Counts
	fill(reflect.ValueOf(&ones).Elem())
	sum := ones
	sum.Add(ones)
	for i, w := range sum.Words() {
		want := uint64(2)
		if i == len(sum.Words())-3 {
			want = 1
		}
		if w != want {
			t.Errorf("word %d is %d, want %d", i, w, want)
		}
	}
	sum.Add(Counts{LongestStay: 7, ChainsTrapped: 3, ChainsFreed: 1})
	if sum.LongestStay != 7 || sum.TrappedNow() != 2 {
		t.Errorf("longest stay %d, trapped %d", sum.LongestStay, sum.TrappedNow())
	}
}

// fill sets every number to 1.
func fill(v reflect.Value) {
	switch v.Kind() {
	case reflect.Struct:
		for i := range v.NumField() {
			fill(v.Field(i))
		}
	case reflect.Array:
		for i := range v.Len() {
			fill(v.Index(i))
		}
	default:
		v.SetUint(1)
	}
}
