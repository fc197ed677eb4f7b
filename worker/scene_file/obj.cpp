#include "scene_file/obj.h"

#include <charconv>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

namespace metrofarm::scene_file {
namespace {

constexpr uint32_t kAbsent = std::numeric_limits<uint32_t>::max();

// Indices of one corner of a face into the file's lists, from 0.
struct Corner {
  uint32_t position = kAbsent;
  uint32_t texcoord = kAbsent;
  uint32_t normal = kAbsent;

  auto operator<=>(const Corner&) const = default;
};

bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}

// What is left of one line.
class Cursor {
 public:
  Cursor(const char* begin, const char* end) : at_(begin), end_(end) {}

  bool at_end() {
    while (at_ != end_ && is_blank(*at_)) ++at_;
    return at_ == end_ || *at_ == '#';
  }

  std::string_view word() {
    if (at_end()) return {};
    const char* begin = at_;
    while (at_ != end_ && !is_blank(*at_)) ++at_;
    return {begin, static_cast<size_t>(at_ - begin)};
  }

  template <class Number>
  bool number(Number& value) {
    if (at_end()) return false;
    if (*at_ == '+') ++at_;
    const auto [next, error] = std::from_chars(at_, end_, value);
    if (error != std::errc()) return false;
    at_ = next;
    return true;
  }

  bool skip(char c) {
    if (at_ == end_ || *at_ != c) return false;
    ++at_;
    return true;
  }

  bool at_separator() const { return at_ == end_ || is_blank(*at_) || *at_ == '#'; }
  char peek() const { return at_ == end_ ? '\0' : *at_; }

 private:
  const char* at_;
  const char* end_;
};

class ObjParser {
 public:
  ObjParser(std::string_view text, const std::string& file_name)
      : text_(text), file_name_(file_name) {}

  Result<RawMesh> parse() {
    const char* at = text_.data();
    const char* end = at + text_.size();
    for (line_ = 1; at < end && !error_; ++line_) {
      const auto* newline = static_cast<const char*>(std::memchr(at, '\n', end - at));
      const char* line_end = newline ? newline : end;
      parse_line(Cursor(at, line_end));
      at = newline ? newline + 1 : end;
    }
    if (error_) return *error_;
    drop_unused_attributes();
    return std::move(mesh_);
  }

 private:
  void fail(std::string message) {
    if (!error_) error_ = Error{std::move(message), {file_name_, line_}};
  }

  void parse_line(Cursor line) {
    const std::string_view keyword = line.word();
    if (keyword == "v") {
      read_numbers(line, 3, "v", positions_);
    } else if (keyword == "vn") {
      read_numbers(line, 3, "vn", normals_);
    } else if (keyword == "vt") {
      read_texcoord(line);
    } else if (keyword == "f") {
      parse_face(line);
    }
  }

  // Numbers beyond `count` (weights, colours) are skipped.
  void read_numbers(Cursor& line, int count, const char* keyword, std::vector<float>& values) {
    for (int i = 0; i < count; ++i) {
      double value = 0;
      if (!line.number(value)) {
        return fail(std::string("\"").append(keyword) + "\" needs " + std::to_string(count) +
                    " numbers");
      }
      values.push_back(static_cast<float>(value));
    }
  }

  // The second coordinate is optional.
  void read_texcoord(Cursor& line) {
    double u = 0;
    double v = 0;
    if (!line.number(u)) return fail("\"vt\" needs 1 to 3 numbers");
    if (!line.at_end() && !line.number(v)) return fail("\"vt\" needs 1 to 3 numbers");
    texcoords_.insert(texcoords_.end(), {static_cast<float>(u), static_cast<float>(v)});
  }

  // From the file's index (from 1, or negative: from the end) to one from 0.
  uint32_t resolve(int64_t index, size_t count, const char* kind) {
    const auto size = static_cast<int64_t>(count);
    if (index >= 1 && index <= size) return static_cast<uint32_t>(index - 1);
    if (index <= -1 && index >= -size) return static_cast<uint32_t>(size + index);
    fail("the face names " + std::string(kind) + " " + std::to_string(index) +
         ", but the file has defined " + std::to_string(count) + " so far");
    return 0;
  }

  bool read_corner(Cursor& line, Corner& corner) {
    int64_t index = 0;
    if (!line.number(index)) return false;
    corner.position = resolve(index, positions_.size() / 3, "vertex");
    if (!line.skip('/')) return line.at_separator();
    if (line.peek() != '/') {
      if (line.at_separator()) return true;  // "1/"
      if (!line.number(index)) return false;
      corner.texcoord = resolve(index, texcoords_.size() / 2, "texture coordinate");
    }
    if (!line.skip('/') || line.at_separator()) return line.at_separator();
    if (!line.number(index)) return false;
    corner.normal = resolve(index, normals_.size() / 3, "normal");
    return line.at_separator();
  }

  void parse_face(Cursor& line) {
    polygon_.clear();
    while (!line.at_end() && !error_) {
      Corner corner;
      if (!read_corner(line, corner)) {
        return fail("a face corner must look like 1, 1/2, 1//3 or 1/2/3");
      }
      if (!error_) polygon_.push_back(vertex_of(corner));
    }
    if (error_) return;
    if (polygon_.size() < 3) return fail("a face needs at least 3 corners");
    append_polygon(polygon_, mesh_.indices);
  }

  // Corners that share a position are chained: first_vertex_[position], then next_vertex_. What a
  // long chain has no place for is found in crowd_.
  uint32_t vertex_of(const Corner& corner) {
    constexpr int kLongestChain = 32;
    first_vertex_.resize(positions_.size() / 3, kAbsent);
    int length = 0;
    for (uint32_t v = first_vertex_[corner.position]; v != kAbsent; v = next_vertex_[v], ++length) {
      if (corners_[v] == corner) return v;
    }
    const auto vertex = static_cast<uint32_t>(corners_.size());
    if (length < kLongestChain) {
      next_vertex_.push_back(std::exchange(first_vertex_[corner.position], vertex));
    } else {
      const auto [found, is_new] = crowd_.emplace(corner, vertex);
      if (!is_new) return found->second;
      next_vertex_.push_back(kAbsent);
    }
    corners_.push_back(corner);
    append(positions_, corner.position, 3, mesh_.positions);
    append(texcoords_, corner.texcoord, 2, mesh_.texcoords);
    append(normals_, corner.normal, 3, mesh_.normals);
    return vertex;
  }

  void append(const std::vector<float>& source, uint32_t index, size_t width,
              std::vector<float>& target) {
    for (size_t i = 0; i < width; ++i) {
      target.push_back(index == kAbsent ? 0.0F : source[width * index + i]);
    }
  }

  void drop_unused_attributes() {
    bool has_texcoords = false;
    bool has_normals = false;
    for (const Corner& corner : corners_) {
      has_texcoords |= corner.texcoord != kAbsent;
      has_normals |= corner.normal != kAbsent;
    }
    if (!has_texcoords) mesh_.texcoords.clear();
    if (!has_normals) mesh_.normals.clear();
  }

  std::string_view text_;
  const std::string& file_name_;
  int line_ = 0;
  std::optional<Error> error_;

  std::vector<float> positions_;
  std::vector<float> texcoords_;
  std::vector<float> normals_;

  std::vector<uint32_t> polygon_;
  std::vector<Corner> corners_;
  std::vector<uint32_t> first_vertex_;
  std::vector<uint32_t> next_vertex_;
  std::map<Corner, uint32_t> crowd_;
  RawMesh mesh_;
};

}  // namespace

Result<RawMesh> parse_obj(std::string_view text, const std::string& file_name) {
  return ObjParser(text, file_name).parse();
}

}  // namespace metrofarm::scene_file
