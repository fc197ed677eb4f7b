#include "scene_file/serialized.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <string>

namespace metrofarm::scene_file {
namespace {

constexpr uint16_t kFormatId = 0x041C;
constexpr size_t kHeaderBytes = 4;  // format id and version before each compressed mesh

enum Flags : uint32_t {
  kHasNormals = 0x0001,
  kHasTexcoords = 0x0002,
  kHasColours = 0x0008,
  kFaceNormals = 0x0010,
  kSinglePrecision = 0x1000,
  kDoublePrecision = 0x2000,
};

template <class T>
std::optional<T> read_at(std::string_view bytes, size_t offset) {
  if (offset > bytes.size() || bytes.size() - offset < sizeof(T)) return std::nullopt;
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

Error truncated() {
  return Error{"the .serialized file is damaged or cut short"};
}

struct Section {
  std::string_view compressed;
  uint16_t version = 0;
};

// The file ends in a dictionary: the offset of every mesh, then their number as uint32. Offsets
// have 32 bits in version 3 and 64 bits in version 4.
Result<Section> find_section(std::string_view file, int64_t shape_index) {
  const auto format = read_at<uint16_t>(file, 0);
  const auto version = read_at<uint16_t>(file, 2);
  if (!format || !version || *format != kFormatId) {
    return Error{"not a Mitsuba .serialized file (its first bytes are wrong)"};
  }
  if (*version != 3 && *version != 4) {
    return Error{".serialized version " + std::to_string(*version) +
                 " is not supported; versions 3 and 4 are"};
  }
  const auto count = read_at<uint32_t>(file, file.size() - sizeof(uint32_t));
  const size_t offset_bytes = *version == 4 ? 8 : 4;
  if (!count || *count > (file.size() - sizeof(uint32_t)) / offset_bytes) return truncated();
  if (shape_index < 0 || shape_index >= int64_t{*count}) {
    return Error{"shape_index " + std::to_string(shape_index) +
                 " is out of range: the file holds " + std::to_string(*count) +
                 " meshes, numbered from 0"};
  }
  const size_t dictionary = file.size() - sizeof(uint32_t) - offset_bytes * *count;
  const auto offset_of = [&](size_t i) -> size_t {
    const size_t at = dictionary + offset_bytes * i;
    if (*version == 4) return read_at<uint64_t>(file, at).value_or(0);
    return read_at<uint32_t>(file, at).value_or(0);
  };
  const auto index = static_cast<size_t>(shape_index);
  const size_t begin = offset_of(index);
  const size_t end = index + 1 < *count ? offset_of(index + 1) : dictionary;
  if (begin > end || end > dictionary || end - begin < kHeaderBytes) return truncated();
  return Section{file.substr(begin + kHeaderBytes, end - begin - kHeaderBytes), *version};
}

// Decompresses as much as is asked for, so that memory follows the data and not its headers.
class Inflater {
 public:
  explicit Inflater(std::string_view compressed) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(compressed.data()));
    stream_.avail_in = static_cast<uInt>(compressed.size());
    ready_ = inflateInit(&stream_) == Z_OK;
  }
  ~Inflater() {
    if (ready_) inflateEnd(&stream_);
  }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  bool read(void* target, size_t bytes) {
    auto* out = static_cast<Bytef*>(target);
    while (ready_ && bytes > 0) {
      const auto chunk = static_cast<uInt>(std::min<size_t>(bytes, 1U << 30));
      stream_.next_out = out;
      stream_.avail_out = chunk;
      const int status = inflate(&stream_, Z_NO_FLUSH);
      const size_t produced = chunk - stream_.avail_out;
      out += produced;
      bytes -= produced;
      if (bytes > 0 && (produced == 0 || status != Z_OK)) return false;
    }
    return ready_;
  }

  template <class T>
  bool read_value(T& value) {
    return read(&value, sizeof(T));
  }

  template <class Stored, class T>
  bool read_array(std::vector<T>& values, uint64_t count) {
    constexpr uint64_t kBlock = 1U << 16;
    std::vector<Stored> block(std::min(count, kBlock));
    while (values.size() < count) {
      block.resize(std::min<uint64_t>(kBlock, count - values.size()));
      if (!read(block.data(), block.size() * sizeof(Stored))) return false;
      values.insert(values.end(), block.begin(), block.end());
    }
    return true;
  }

 private:
  z_stream stream_{};
  bool ready_ = false;
};

bool skip_name(Inflater& in) {
  char c = 1;
  while (c != '\0') {
    if (!in.read_value(c)) return false;
  }
  return true;
}

uint64_t floats_per_vertex(uint32_t flags) {
  return 3 + ((flags & kHasNormals) ? 3 : 0) + ((flags & kHasTexcoords) ? 2 : 0) +
         ((flags & kHasColours) ? 3 : 0);
}

template <class Real>
bool read_vertices(Inflater& in, uint32_t flags, uint64_t count, RawMesh& mesh) {
  if (!in.read_array<Real>(mesh.positions, 3 * count)) return false;
  if ((flags & kHasNormals) && !in.read_array<Real>(mesh.normals, 3 * count)) return false;
  if ((flags & kHasTexcoords) && !in.read_array<Real>(mesh.texcoords, 2 * count)) return false;
  if (!(flags & kHasColours)) return true;
  scene::MeshAttribute colours{"vertex_color", 3, false, {}};
  if (!in.read_array<Real>(colours.values, 3 * count)) return false;
  mesh.attributes.push_back(std::move(colours));
  return true;
}

}  // namespace

Result<RawMesh> parse_serialized(std::string_view file, int64_t shape_index, uint64_t max_bytes) {
  const Result<Section> section = find_section(file, shape_index);
  if (!section) return section.error();
  if (section.value().compressed.size() > UINT32_MAX) return Error{"mesh larger than 4 GiB"};
  Inflater in(section.value().compressed);
  uint32_t flags = 0;
  uint64_t vertex_count = 0;
  uint64_t triangle_count = 0;
  if (!in.read_value(flags)) return truncated();
  if (section.value().version == 4 && !skip_name(in)) return truncated();
  if (!in.read_value(vertex_count) || !in.read_value(triangle_count)) return truncated();
  if (vertex_count > UINT32_MAX || triangle_count > UINT32_MAX) return truncated();

  RawMesh mesh;
  mesh.face_normals = (flags & kFaceNormals) != 0;
  const bool doubles = (flags & kDoublePrecision) != 0;
  // Old files have neither flag and hold floats.
  if (doubles && (flags & kSinglePrecision)) return truncated();
  const uint64_t bytes = sizeof(float) * (floats_per_vertex(flags) * vertex_count) +
                         sizeof(uint32_t) * 3 * triangle_count;
  // Deflate packs at most 1032 : 1.
  if (bytes / 1032 > section.value().compressed.size()) return truncated();
  if (bytes > max_bytes) {
    return Error{"mesh " + std::to_string(shape_index) + " takes " + std::to_string(bytes) +
                 " bytes of memory; of a file of " + std::to_string(file.size()) +
                 " bytes at most " + std::to_string(max_bytes) + " are allowed"};
  }
  if (doubles ? !read_vertices<double>(in, flags, vertex_count, mesh)
              : !read_vertices<float>(in, flags, vertex_count, mesh)) {
    return truncated();
  }
  if (!in.read_array<uint32_t>(mesh.indices, 3 * triangle_count)) return truncated();
  for (uint32_t index : mesh.indices) {
    if (index >= vertex_count) {
      return Error{"a triangle names vertex " + std::to_string(index) + ", but the mesh has " +
                   std::to_string(vertex_count)};
    }
  }
  return mesh;
}

}  // namespace metrofarm::scene_file
