#include "scene_file/ply_header.h"

#include <array>
#include <utility>

#include "scene_file/names.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file {
namespace {

using Words = std::vector<std::string_view>;

std::optional<PlyType> type_named(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, PlyType>, 16> kTypes = {{
      {"char", PlyType::kInt8},
      {"int8", PlyType::kInt8},
      {"uchar", PlyType::kUint8},
      {"uint8", PlyType::kUint8},
      {"short", PlyType::kInt16},
      {"int16", PlyType::kInt16},
      {"ushort", PlyType::kUint16},
      {"uint16", PlyType::kUint16},
      {"int", PlyType::kInt32},
      {"int32", PlyType::kInt32},
      {"uint", PlyType::kUint32},
      {"uint32", PlyType::kUint32},
      {"float", PlyType::kFloat32},
      {"float32", PlyType::kFloat32},
      {"double", PlyType::kFloat64},
      {"float64", PlyType::kFloat64},
  }};
  for (const auto& [known, type] : kTypes) {
    if (known == name) return type;
  }
  return std::nullopt;
}

class HeaderParser {
 public:
  HeaderParser(std::string_view file, const std::string& file_name)
      : file_(file), file_name_(file_name) {}

  Result<PlyHeader> parse() {
    if (next_line() != "ply") return error("not a PLY file: the first line must be \"ply\"");
    while (!at_end_) {
      const std::string_view line = next_line();
      if (line == "end_header") {
        if (!has_format_) return error("the header has no \"format\" line");
        header_.body_offset = offset_;
        header_.line_count = line_;
        return std::move(header_);
      }
      if (std::optional<Error> problem = parse_line(split_list(line))) return *problem;
    }
    return error("the header doesn't end in \"end_header\"");
  }

 private:
  Error error(std::string message) const { return Error{std::move(message), {file_name_, line_}}; }

  std::string_view next_line() {
    const size_t newline = file_.find('\n', offset_);
    at_end_ = newline == std::string_view::npos;
    const std::string_view line =
        file_.substr(offset_, at_end_ ? std::string_view::npos : newline - offset_);
    offset_ = at_end_ ? file_.size() : newline + 1;
    ++line_;
    return trim(line);
  }

  std::optional<Error> parse_line(const Words& words) {
    if (words.empty() || words[0] == "comment" || words[0] == "obj_info") return std::nullopt;
    if (words[0] == "format") return parse_format(words);
    if (words[0] == "element") return parse_element(words);
    if (words[0] == "property") return parse_property(words);
    return error("unknown PLY header keyword \"" + std::string(words[0]) + "\"");
  }

  std::optional<Error> parse_format(const Words& words) {
    const std::string_view name = words.size() > 1 ? words[1] : std::string_view();
    has_format_ = true;
    if (name == "ascii") {
      header_.format = PlyFormat::kAscii;
    } else if (name == "binary_little_endian") {
      header_.format = PlyFormat::kLittleEndian;
    } else if (name == "binary_big_endian") {
      header_.format = PlyFormat::kBigEndian;
    } else {
      return error("unknown PLY format \"" + std::string(name) + "\"" +
                   suggestion(name, {"ascii", "binary_little_endian", "binary_big_endian"}));
    }
    return std::nullopt;
  }

  std::optional<Error> parse_element(const Words& words) {
    const auto count = words.size() == 3 ? parse_integer(words[2]) : std::nullopt;
    if (!count || *count < 0) return error("expected \"element NAME COUNT\"");
    header_.elements.push_back({std::string(words[1]), static_cast<uint64_t>(*count), {}});
    return std::nullopt;
  }

  std::optional<Error> parse_property(const Words& words) {
    if (header_.elements.empty()) return error("a property must follow an element");
    const bool is_list = words.size() == 5 && words[1] == "list";
    if (!is_list && words.size() != 3) {
      return error("expected \"property TYPE NAME\" or \"property list TYPE TYPE NAME\"");
    }
    PlyProperty property;
    property.name = std::string(words.back());
    const std::optional<PlyType> type = type_named(words[words.size() - 2]);
    if (is_list) property.count_type = type_named(words[2]);
    if (!type || (is_list && !property.count_type)) return error("unknown PLY property type");
    property.type = *type;
    header_.elements.back().properties.push_back(std::move(property));
    return std::nullopt;
  }

  std::string_view file_;
  const std::string& file_name_;
  size_t offset_ = 0;
  int line_ = 0;
  bool at_end_ = false;
  bool has_format_ = false;
  PlyHeader header_;
};

}  // namespace

size_t byte_size(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
    case PlyType::kUint8:
      return 1;
    case PlyType::kInt16:
    case PlyType::kUint16:
      return 2;
    case PlyType::kInt32:
    case PlyType::kUint32:
    case PlyType::kFloat32:
      return 4;
    case PlyType::kFloat64:
      return 8;
  }
  return 0;
}

size_t PlyElement::minimum_bytes() const {
  size_t bytes = 0;
  for (const PlyProperty& property : properties) {
    bytes += byte_size(property.count_type.value_or(property.type));
  }
  return bytes;
}

Result<PlyHeader> parse_ply_header(std::string_view file, const std::string& file_name) {
  return HeaderParser(file, file_name).parse();
}

}  // namespace metrofarm::scene_file
