// Package checksum computes the checksums of what workers send, see SegmentResult.checksum in
// task.proto. It is pure. It is not internal because the proxy of the chaos tests forges with it.
package checksum

import (
	"cmp"
	"encoding/binary"
	"fmt"
	"math"
	"slices"

	"google.golang.org/protobuf/proto"
	"google.golang.org/protobuf/reflect/protoreflect"
)

// Message has a checksum of its own.
type Message interface {
	proto.Message
	GetChecksum() uint64
}

// own is the name of the field that has the checksum.
const own protoreflect.Name = "checksum"

// Check says how content and checksum differ, nil if they do not.
func Check(m Message) error {
	if has, should := m.GetChecksum(), Of(m); has != should {
		return fmt.Errorf("checksum %016x, and its content has %016x", has, should)
	}
	return nil
}

// Of returns the checksum of all other fields of a message.
func Of(m Message) uint64 {
	var s sum
	s.fields(m.ProtoReflect(), own)
	return uint64(s)
}

// sum is a checksum under way.
type sum uint64

func (s *sum) word(w uint64) { *s = sum(mix(uint64(*s) ^ w)) }

// mix is the finalizer of SplitMix64.
func mix(x uint64) uint64 {
	z := (x + 1) * 0x9e3779b97f4a7c15
	z = (z ^ z>>30) * 0xbf58476d1ce4e5b9
	z = (z ^ z>>27) * 0x94d049bb133111eb
	return z ^ z>>31
}

func (s *sum) message(m protoreflect.Message) {
	s.fields(m, "")
	s.word(0)
}

func (s *sum) fields(m protoreflect.Message, except protoreflect.Name) {
	for _, f := range byNumber(m.Descriptor().Fields()) {
		if f.Name() != except {
			s.field(f, m)
		}
	}
}

func byNumber(fields protoreflect.FieldDescriptors) []protoreflect.FieldDescriptor {
	sorted := make([]protoreflect.FieldDescriptor, fields.Len())
	for i := range sorted {
		sorted[i] = fields.Get(i)
	}
	slices.SortFunc(sorted, func(a, b protoreflect.FieldDescriptor) int { return cmp.Compare(a.Number(), b.Number()) })
	return sorted
}

func (s *sum) field(f protoreflect.FieldDescriptor, m protoreflect.Message) {
	value := m.Get(f)
	switch {
	case f.IsMap():
		s.entries(f, value.Map())
	case f.IsList():
		s.list(f, value.List())
	case f.HasPresence():
		if m.Has(f) {
			s.open(f, 1)
			s.element(f, value)
		}
	default:
		s.plain(f, value)
	}
}

// open begins a field that is set.
func (s *sum) open(f protoreflect.FieldDescriptor, elements int) {
	s.word(uint64(f.Number()))
	s.word(uint64(elements))
}

func (s *sum) list(f protoreflect.FieldDescriptor, elements protoreflect.List) {
	n := elements.Len()
	if n == 0 {
		return
	}
	s.open(f, n)
	for i := range n {
		s.element(f, elements.Get(i))
	}
}

// entries of a map, whose keys are strings.
func (s *sum) entries(f protoreflect.FieldDescriptor, entries protoreflect.Map) {
	if entries.Len() == 0 {
		return
	}
	var keys []string
	entries.Range(func(k protoreflect.MapKey, _ protoreflect.Value) bool {
		keys = append(keys, k.Value().Interface().(string)) // nothing else is defined
		return true
	})
	slices.Sort(keys)
	s.open(f, len(keys))
	for _, k := range keys {
		key := protoreflect.ValueOfString(k)
		s.plain(f.MapKey(), key)
		s.plain(f.MapValue(), entries.Get(key.MapKey()))
		s.word(0)
	}
}

// plain is a field that counts as set unless all its bits are zero.
func (s *sum) plain(f protoreflect.FieldDescriptor, value protoreflect.Value) {
	switch f.Kind() {
	case protoreflect.MessageKind:
	case protoreflect.StringKind, protoreflect.BytesKind:
		if len(octets(f, value)) == 0 {
			return
		}
	default:
		if bits(f, value) == 0 {
			return
		}
	}
	s.open(f, 1)
	s.element(f, value)
}

func (s *sum) element(f protoreflect.FieldDescriptor, value protoreflect.Value) {
	switch f.Kind() {
	case protoreflect.MessageKind:
		s.message(value.Message())
	case protoreflect.StringKind, protoreflect.BytesKind:
		s.octets(octets(f, value))
	default:
		s.word(bits(f, value))
	}
}

func octets(f protoreflect.FieldDescriptor, value protoreflect.Value) []byte {
	if f.Kind() == protoreflect.StringKind {
		return []byte(value.String())
	}
	return value.Bytes()
}

func (s *sum) octets(data []byte) {
	s.word(uint64(len(data)))
	for len(data) >= 8 {
		s.word(binary.LittleEndian.Uint64(data))
		data = data[8:]
	}
	if len(data) > 0 {
		var last [8]byte
		copy(last[:], data)
		s.word(binary.LittleEndian.Uint64(last[:]))
	}
}

// bits of a number.
func bits(f protoreflect.FieldDescriptor, value protoreflect.Value) uint64 {
	switch f.Kind() {
	case protoreflect.BoolKind:
		if value.Bool() {
			return 1
		}
		return 0
	case protoreflect.EnumKind:
		return uint64(value.Enum())
	case protoreflect.Int32Kind, protoreflect.Sint32Kind, protoreflect.Sfixed32Kind,
		protoreflect.Int64Kind, protoreflect.Sint64Kind, protoreflect.Sfixed64Kind:
		return uint64(value.Int())
	case protoreflect.Uint32Kind, protoreflect.Fixed32Kind, protoreflect.Uint64Kind, protoreflect.Fixed64Kind:
		return value.Uint()
	case protoreflect.FloatKind:
		return uint64(math.Float32bits(float32(value.Float())))
	case protoreflect.DoubleKind:
		return math.Float64bits(value.Float())
	default:
		panic(fmt.Sprintf("checksum: %s is of kind %s, which proto3 does not have", f.FullName(), f.Kind()))
	}
}
