#include "scene_file/ply.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <optional>

#include "scene_file/ply_attributes.h"
#include "scene_file/ply_header.h"

namespace metrofarm::scene_file {
namespace {

bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

template <class T>
double decode(const char* bytes, bool swap) {
  std::array<char, sizeof(T)> buffer;
  std::memcpy(buffer.data(), bytes, sizeof(T));
  if (swap) std::reverse(buffer.begin(), buffer.end());
  T value;
  std::memcpy(&value, buffer.data(), sizeof(T));
  return static_cast<double>(value);
}

double decode(PlyType type, const char* bytes, bool swap) {
  switch (type) {
    case PlyType::kInt8:
      return decode<int8_t>(bytes, swap);
    case PlyType::kUint8:
      return decode<uint8_t>(bytes, swap);
    case PlyType::kInt16:
      return decode<int16_t>(bytes, swap);
    case PlyType::kUint16:
      return decode<uint16_t>(bytes, swap);
    case PlyType::kInt32:
      return decode<int32_t>(bytes, swap);
    case PlyType::kUint32:
      return decode<uint32_t>(bytes, swap);
    case PlyType::kFloat32:
      return decode<float>(bytes, swap);
    case PlyType::kFloat64:
      return decode<double>(bytes, swap);
  }
  return 0;
}

// The values of the body, one after the other, whatever the format. A double holds every PLY type
// exactly.
class ValueReader {
 public:
  ValueReader(std::string_view file, const PlyHeader& header)
      : at_(file.data() + header.body_offset),
        end_(file.data() + file.size()),
        ascii_(header.format == PlyFormat::kAscii),
        swap_(header.format == PlyFormat::kBigEndian),
        line_(header.line_count + 1) {}

  bool read(PlyType type, double& value) {
    if (ascii_) return read_text(value);
    const size_t size = byte_size(type);
    if (remaining() < size) return false;
    value = decode(type, at_, swap_);
    at_ += size;
    return true;
  }

  // Could the rest of the body hold `count` values of at least `bytes` bytes each?
  bool could_hold(uint64_t count, size_t bytes) const {
    return bytes == 0 || count <= (remaining() + 1) / bytes;
  }

  bool ascii() const { return ascii_; }
  int line() const { return ascii_ ? line_ : 0; }

 private:
  size_t remaining() const { return static_cast<size_t>(end_ - at_); }

  bool read_text(double& value) {
    for (; at_ != end_ && is_space(*at_); ++at_) line_ += *at_ == '\n' ? 1 : 0;
    if (at_ != end_ && *at_ == '+') ++at_;
    const auto [next, error] = std::from_chars(at_, end_, value);
    if (error != std::errc() || (next != end_ && !is_space(*next))) return false;
    at_ = next;
    return true;
  }

  const char* at_;
  const char* end_;
  bool ascii_;
  bool swap_;
  int line_;
};

enum Channel { kX, kY, kZ, kNx, kNy, kNz, kU, kV, kChannelCount };

std::optional<Channel> channel_named(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, Channel>, 12> kNames = {{{"x", kX},
                                                                            {"y", kY},
                                                                            {"z", kZ},
                                                                            {"nx", kNx},
                                                                            {"ny", kNy},
                                                                            {"nz", kNz},
                                                                            {"u", kU},
                                                                            {"v", kV},
                                                                            {"s", kU},
                                                                            {"t", kV},
                                                                            {"texture_u", kU},
                                                                            {"texture_v", kV}}};
  for (const auto& [known, channel] : kNames) {
    if (known == name) return channel;
  }
  return std::nullopt;
}

class BodyParser {
 public:
  BodyParser(std::string_view file, const PlyHeader& header, const std::string& file_name,
             uint64_t max_bytes)
      : header_(header), file_name_(file_name), max_bytes_(max_bytes), values_(file, header) {}

  Result<RawMesh> parse() {
    for (const PlyElement& element : header_.elements) {
      const size_t least =
          values_.ascii() ? 2 * element.properties.size() : element.minimum_bytes();
      if (!values_.could_hold(element.count, least)) {
        return error("the header promises " + std::to_string(element.count) + " of element \"" +
                     element.name + "\", more than the file can hold");
      }
      std::optional<Error> problem;
      if (element.name == "vertex") {
        problem = read_vertices(element);
      } else if (element.name == "face") {
        problem = read_faces(element);
      } else {
        problem = skip_element(element);
      }
      if (problem) return *problem;
    }
    return check_indices();
  }

 private:
  Error error(std::string message) const {
    return Error{std::move(message), {file_name_, values_.line()}};
  }
  Error ends_early(const PlyElement& element) const {
    return error("expected a number in element \"" + element.name +
                 "\": the file is damaged or cut short");
  }

  bool read_list(const PlyProperty& property, std::vector<double>& list) {
    double count = 0;
    list.clear();
    if (!values_.read(*property.count_type, count)) return false;
    if (!(count >= 0) || count > 1e9) return false;
    const size_t least = values_.ascii() ? 2 : byte_size(property.type);
    if (!values_.could_hold(static_cast<uint64_t>(count), least)) return false;
    list.resize(static_cast<size_t>(count));
    return std::all_of(list.begin(), list.end(),
                       [&](double& value) { return values_.read(property.type, value); });
  }

  bool skip(const PlyProperty& property) {
    if (property.count_type) return read_list(property, unused_);
    double unused = 0;
    return values_.read(property.type, unused);
  }

  std::optional<Error> skip_element(const PlyElement& element) {
    if (element.properties.empty()) return std::nullopt;
    for (uint64_t i = 0; i < element.count; ++i) {
      for (const PlyProperty& property : element.properties) {
        if (!skip(property)) return ends_early(element);
      }
    }
    return std::nullopt;
  }

  // The scalar properties of one entry go to row_; lists are skipped but for the last one that
  // `kept` names, which stays in list_.
  template <class Kept>
  bool read_row(const PlyElement& element, const Kept& kept) {
    row_.resize(element.properties.size());
    for (size_t p = 0; p < element.properties.size(); ++p) {
      const PlyProperty& property = element.properties[p];
      const bool read = !property.count_type
                            ? values_.read(property.type, row_[p])
                            : read_list(property, kept(property) ? list_ : unused_);
      if (!read) return false;
    }
    return true;
  }

  // Where each channel is among the properties.
  static std::array<std::optional<size_t>, kChannelCount> find_channels(const PlyElement& element) {
    std::array<std::optional<size_t>, kChannelCount> places;
    for (size_t p = 0; p < element.properties.size(); ++p) {
      if (element.properties[p].count_type) continue;
      if (const auto channel = channel_named(element.properties[p].name)) places[*channel] = p;
    }
    return places;
  }

  void append_channels(const std::array<std::optional<size_t>, kChannelCount>& places, int first,
                       int last, std::vector<float>& target) const {
    for (int c = first; c <= last; ++c) target.push_back(static_cast<float>(row_[*places[c]]));
  }

  size_t add_attributes(const std::vector<PlyAttribute>& attributes, bool per_face) {
    const size_t first = mesh_.attributes.size();
    for (const PlyAttribute& attribute : attributes) {
      const auto channels = static_cast<int>(attribute.properties.size());
      mesh_.attributes.push_back({attribute.name, channels, per_face, {}});
    }
    return first;
  }

  // The attributes of the entry in row_, `copies` times.
  void append_attributes(const std::vector<PlyAttribute>& attributes, size_t first, size_t copies) {
    for (size_t a = 0; a < attributes.size(); ++a) {
      std::vector<float>& values = mesh_.attributes[first + a].values;
      for (size_t copy = 0; copy < copies; ++copy) {
        for (size_t p : attributes[a].properties) {
          values.push_back(static_cast<float>(row_[p]) * attributes[a].scale);
        }
      }
    }
  }

  std::optional<Error> read_vertices(const PlyElement& element) {
    if (!mesh_.positions.empty()) return error("the file has two elements named \"vertex\"");
    const auto places = find_channels(element);
    if (!places[kX] || !places[kY] || !places[kZ]) {
      return error("the vertices of a PLY file need the properties x, y and z");
    }
    const bool has_normals = places[kNx] && places[kNy] && places[kNz];
    const bool has_texcoords = places[kU] && places[kV];
    const std::vector<PlyAttribute> attributes = find_attributes(element, "vertex_");
    const size_t first = add_attributes(attributes, false);
    mesh_.positions.reserve(3 * element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
      if (!read_row(element, [](const PlyProperty&) { return false; })) return ends_early(element);
      append_channels(places, kX, kZ, mesh_.positions);
      if (has_normals) append_channels(places, kNx, kNz, mesh_.normals);
      if (has_texcoords) append_channels(places, kU, kV, mesh_.texcoords);
      append_attributes(attributes, first, 1);
    }
    return std::nullopt;
  }

  static bool holds_indices(const PlyProperty& property) {
    return property.count_type &&
           (property.name == "vertex_indices" || property.name == "vertex_index");
  }

  std::optional<Error> read_faces(const PlyElement& element) {
    if (std::none_of(element.properties.begin(), element.properties.end(), holds_indices)) {
      return error("the faces of a PLY file need the list property vertex_indices");
    }
    const std::vector<PlyAttribute> attributes = find_attributes(element, "face_");
    const size_t first = add_attributes(attributes, true);
    mesh_.indices.reserve(mesh_.indices.size() + 3 * element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
      if (!read_row(element, holds_indices)) return ends_early(element);
      if (std::optional<Error> problem = add_face()) return problem;
      if (std::optional<Error> problem = count_face(attributes)) return problem;
      append_attributes(attributes, first, corners_.size() - 2);
    }
    return std::nullopt;
  }

  // The corners of the face are in list_.
  std::optional<Error> add_face() {
    if (list_.size() < 3) return error("a face needs at least 3 corners");
    corners_.clear();
    for (double corner : list_) {
      if (!(corner >= 0) || corner >= 4294967295.0) return error("a face has an invalid index");
      corners_.push_back(static_cast<uint32_t>(corner));
    }
    append_polygon(corners_, mesh_.indices);
    return std::nullopt;
  }

  // Each triangle of a polygon has the attributes of all of it: few bytes may become many.
  std::optional<Error> count_face(const std::vector<PlyAttribute>& attributes) {
    uint64_t values = 3;
    for (const PlyAttribute& attribute : attributes) values += attribute.properties.size();
    face_bytes_ += (corners_.size() - 2) * values * sizeof(float);
    if (face_bytes_ <= max_bytes_) return std::nullopt;
    return error("the faces take more than the " + std::to_string(max_bytes_) +
                 " bytes of memory that are allowed to a file of this size");
  }

  Result<RawMesh> check_indices() {
    for (uint32_t index : mesh_.indices) {
      if (index < mesh_.vertex_count()) continue;
      return Error{"a face names vertex " + std::to_string(index) + ", but the file has " +
                       std::to_string(mesh_.vertex_count()) + " (numbered from 0)",
                   {file_name_}};
    }
    // Faces in several elements need not have the same attributes.
    std::erase_if(mesh_.attributes, [&](const scene::MeshAttribute& attribute) {
      const size_t entries = attribute.per_face ? mesh_.indices.size() / 3 : mesh_.vertex_count();
      return attribute.values.size() != attribute.channels * entries;
    });
    return std::move(mesh_);
  }

  const PlyHeader& header_;
  const std::string& file_name_;
  const uint64_t max_bytes_;
  uint64_t face_bytes_ = 0;
  ValueReader values_;
  std::vector<double> row_;
  std::vector<double> list_;
  std::vector<double> unused_;
  std::vector<uint32_t> corners_;
  RawMesh mesh_;
};

}  // namespace

Result<RawMesh> parse_ply(std::string_view file, const std::string& file_name, uint64_t max_bytes) {
  const Result<PlyHeader> header = parse_ply_header(file, file_name);
  if (!header) return header.error();
  return BodyParser(file, header.value(), file_name, max_bytes).parse();
}

}  // namespace metrofarm::scene_file
