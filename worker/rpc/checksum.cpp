#include "rpc/checksum.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/check.h"
#include "math/rng.h"

namespace metrofarm::rpc {

namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

constexpr int kSingle = -1;  // instead of an index: the field is not repeated

// The element of a field, or the field itself.
struct Value {
  const Message& of;
  const FieldDescriptor* field;
  int index;

  const Reflection& reflection() const { return *of.GetReflection(); }
  bool single() const { return index == kSingle; }
};

uint64_t bits_of_integer(const Value& v) {
  const Reflection& r = v.reflection();
  const auto* f = v.field;
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
      return static_cast<uint64_t>(
          int64_t{v.single() ? r.GetInt32(v.of, f) : r.GetRepeatedInt32(v.of, f, v.index)});
    case FieldDescriptor::CPPTYPE_INT64:
      return static_cast<uint64_t>(v.single() ? r.GetInt64(v.of, f)
                                              : r.GetRepeatedInt64(v.of, f, v.index));
    case FieldDescriptor::CPPTYPE_UINT32:
      return v.single() ? r.GetUInt32(v.of, f) : r.GetRepeatedUInt32(v.of, f, v.index);
    case FieldDescriptor::CPPTYPE_UINT64:
      return v.single() ? r.GetUInt64(v.of, f) : r.GetRepeatedUInt64(v.of, f, v.index);
    case FieldDescriptor::CPPTYPE_BOOL:
      return (v.single() ? r.GetBool(v.of, f) : r.GetRepeatedBool(v.of, f, v.index)) ? 1 : 0;
    default:
      METROFARM_CHECK(f->cpp_type() == FieldDescriptor::CPPTYPE_ENUM);
      return static_cast<uint64_t>(
          int64_t{v.single() ? r.GetEnumValue(v.of, f) : r.GetRepeatedEnumValue(v.of, f, v.index)});
  }
}

uint64_t bits_of(const Value& v) {
  const Reflection& r = v.reflection();
  if (v.field->cpp_type() == FieldDescriptor::CPPTYPE_FLOAT)
    return std::bit_cast<uint32_t>(v.single() ? r.GetFloat(v.of, v.field)
                                              : r.GetRepeatedFloat(v.of, v.field, v.index));
  if (v.field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE)
    return std::bit_cast<uint64_t>(v.single() ? r.GetDouble(v.of, v.field)
                                              : r.GetRepeatedDouble(v.of, v.field, v.index));
  return bits_of_integer(v);
}

std::vector<const FieldDescriptor*> by_number(const Message& message) {
  const auto* descriptor = message.GetDescriptor();
  std::vector<const FieldDescriptor*> fields;
  for (int i = 0; i < descriptor->field_count(); ++i) fields.push_back(descriptor->field(i));
  std::sort(fields.begin(), fields.end(),
            [](const auto* a, const auto* b) { return a->number() < b->number(); });
  return fields;
}

class Sum {
 public:
  void fields(const Message& message, std::string_view except) {
    for (const FieldDescriptor* f : by_number(message))
      if (f->name() != except) field({message, f, kSingle});
  }
  uint64_t value() const { return value_; }

 private:
  void word(uint64_t w) { value_ = mix64(value_ ^ w); }

  // Begins a field that is set.
  void open(const FieldDescriptor* f, int elements) {
    word(static_cast<uint64_t>(f->number()));
    word(static_cast<uint64_t>(elements));
  }

  void field(const Value& v) {
    if (v.field->is_map()) return entries(v.of, v.field);
    if (v.field->is_repeated()) return list(v.of, v.field);
    if (!is_set(v)) return;
    open(v.field, 1);
    element(v);
  }

  // Without tracked presence: whether any bit is. The library's word for it could differ for -0.
  bool is_set(const Value& v) {
    if (v.field->has_presence()) return v.reflection().HasField(v.of, v.field);
    std::string scratch;
    if (v.field->cpp_type() == FieldDescriptor::CPPTYPE_STRING)
      return !v.reflection().GetStringReference(v.of, v.field, &scratch).empty();
    return bits_of(v) != 0;
  }

  void list(const Message& of, const FieldDescriptor* f) {
    const int n = of.GetReflection()->FieldSize(of, f);
    if (n == 0) return;
    open(f, n);
    for (int i = 0; i < n; ++i) element({of, f, i});
  }

  // Of a map, whose keys are strings.
  void entries(const Message& of, const FieldDescriptor* f) {
    const int n = of.GetReflection()->FieldSize(of, f);
    if (n == 0) return;
    std::map<std::string, const Message*> sorted;
    for (int i = 0; i < n; ++i) {
      const Message& entry = of.GetReflection()->GetRepeatedMessage(of, f, i);
      sorted[entry.GetReflection()->GetString(entry, f->message_type()->map_key())] = &entry;
    }
    open(f, n);
    for (const auto& [key, entry] : sorted) message(*entry);
  }

  void message(const Message& m) {
    fields(m, "");
    word(0);
  }

  void element(const Value& v) {
    const Reflection& r = v.reflection();
    std::string scratch;
    switch (v.field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_MESSAGE:
        return message(v.single() ? r.GetMessage(v.of, v.field)
                                  : r.GetRepeatedMessage(v.of, v.field, v.index));
      case FieldDescriptor::CPPTYPE_STRING:
        return octets(v.single() ? r.GetStringReference(v.of, v.field, &scratch)
                                 : r.GetRepeatedStringReference(v.of, v.field, v.index, &scratch));
      default:
        word(bits_of(v));
    }
  }

  void octets(std::string_view data) {
    static_assert(std::endian::native == std::endian::little);
    word(data.size());
    while (!data.empty()) {
      uint64_t w = 0;
      const size_t n = std::min(data.size(), sizeof w);
      std::memcpy(&w, data.data(), n);
      word(w);
      data.remove_prefix(n);
    }
  }

  uint64_t value_ = 0;
};

}  // namespace

uint64_t checksum(const Message& message) {
  Sum sum;
  sum.fields(message, "checksum");
  return sum.value();
}

}  // namespace metrofarm::rpc
