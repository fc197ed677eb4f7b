#include "scene_file/mitsuba/document.h"

#include <algorithm>
#include <pugixml.hpp>

#include "scene_file/mitsuba/defaults.h"
#include "scene_file/names.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

constexpr int kMaxIncludeDepth = 16;
constexpr int kMaxIncludes = 4096;
constexpr int kMaxElementDepth = 64;

// One XML file: turns offsets into locations.
struct XmlFile {
  std::string name;
  std::vector<size_t> line_starts;
  bool legacy = false;
  pugi::xml_document document;

  void index_lines(std::string_view text) {
    line_starts = {0};
    for (size_t i = 0; i < text.size(); ++i) {
      if (text[i] == '\n') line_starts.push_back(i + 1);
    }
  }

  SourceLocation at(std::ptrdiff_t offset) const {
    if (offset < 0) return {name};
    const auto next =
        std::upper_bound(line_starts.begin(), line_starts.end(), static_cast<size_t>(offset));
    return {name, static_cast<int>(next - line_starts.begin())};
  }
};

class DocumentBuilder {
 public:
  DocumentBuilder(const LoadOptions& options, FileAccess& files, Problems& problems)
      : files_(files), problems_(problems), defaults_(options.defaults) {}

  Document build(const std::filesystem::path& path) {
    Document document;
    Element holder;
    add_file(path, {path.string()}, holder, 0);
    if (problems_.failed()) return document;
    if (holder.children.empty() || holder.children[0].tag != "scene") {
      problems_.fail("the root element must be <scene version=\"3.0.0\">", {path.string()});
      return document;
    }
    defaults_.check_overrides(path.string(), problems_);
    document.root = std::move(holder.children[0]);
    index_ids(document.root, document);
    resolve_aliases(document);
    return document;
  }

 private:
  struct Alias {
    std::string id;
    std::string as;
    SourceLocation where;
  };

  // Appends the root of the file to `parent`, or the children of the root if the file is an include
  // whose root is a <scene>.
  void add_file(const std::filesystem::path& path, const SourceLocation& where, Element& parent,
                int depth) {
    if (depth > kMaxIncludeDepth || ++include_count_ > kMaxIncludes) {
      return problems_.fail("includes are nested too deeply or too many; does \"" + path.string() +
                                "\" include itself?",
                            where);
    }
    const Result<FileBytes> bytes = files_.read(path);
    if (!bytes) return problems_.fail(bytes.error().message, where);
    XmlFile file;
    file.name = path.string();
    file.index_lines(*bytes.value());
    const pugi::xml_parse_result parsed =
        file.document.load_buffer(bytes.value()->data(), bytes.value()->size());
    if (!parsed) {
      return problems_.fail(std::string("not well-formed XML: ") + parsed.description(),
                            file.at(parsed.offset));
    }
    const pugi::xml_node root = file.document.document_element();
    check_version(root, depth > 0, file);
    if (depth > 0 && std::string_view(root.name()) == "scene") {
      for (pugi::xml_node child : root.children()) convert(child, file, parent, depth, 1);
    } else {
      convert(root, file, parent, depth, 0);
    }
  }

  void check_version(pugi::xml_node root, bool included, XmlFile& file) {
    const SourceLocation where = file.at(root.offset_debug());
    const std::string version = root.attribute("version").value();
    if (version.empty()) {
      if (!included) problems_.fail("the root element needs version=\"3.0.0\"", where);
      return;
    }
    const auto major = parse_integer(std::string_view(version).substr(0, version.find('.')));
    if (!major || *major < 0) {
      problems_.fail("invalid version \"" + version + "\": expected something like 3.0.0", where);
    } else if (*major > 3) {
      problems_.unsupported("version " + version + " is newer than what is supported (0.4 to 3.x)",
                            where);
    } else {
      file.legacy = *major < 2;
    }
  }

  void convert(pugi::xml_node node, const XmlFile& file, Element& parent, int depth, int nesting) {
    if (node.type() != pugi::node_element || problems_.failed()) return;
    const SourceLocation where = file.at(node.offset_debug());
    if (nesting > kMaxElementDepth) return problems_.fail("elements are nested too deeply", where);
    Element element;
    element.tag = file.legacy ? lower_case(node.name()) : node.name();
    element.where = where;
    element.legacy = file.legacy;
    const TagInfo* info = find_tag(element.tag);
    if (!info) {
      return problems_.unsupported(
          "unknown element <" + element.tag + ">" + suggestion(element.tag, known_tags()), where);
    }
    copy_attributes(node, *info, element);
    if (info->kind == TagKind::kDirective) return follow_directive(element, parent, depth);
    for (pugi::xml_node child : node.children()) convert(child, file, element, depth, nesting + 1);
    parent.children.push_back(std::move(element));
  }

  void copy_attributes(pugi::xml_node node, const TagInfo& info, Element& element) {
    for (pugi::xml_attribute attribute : node.attributes()) {
      const std::string name = attribute.name();
      if (std::find(info.attributes.begin(), info.attributes.end(), name) ==
          info.attributes.end()) {
        problems_.unsupported("unknown attribute \"" + name + "\" of <" + element.tag + ">" +
                                  suggestion(name, info.attributes),
                              element.where);
        continue;
      }
      if (element.find(name)) {
        return problems_.fail("attribute \"" + name + "\" is given twice", element.where);
      }
      std::string value = defaults_.substitute(attribute.value(), element.where, problems_);
      if (element.legacy && name == "name" && info.kind != TagKind::kDirective) {
        value = snake_case(value);
      }
      element.attributes.emplace_back(name, std::move(value));
    }
  }

  // Fails unless the directive has all the attributes that it may have.
  bool has_all(const Element& directive, std::initializer_list<std::string_view> attributes) {
    for (std::string_view attribute : attributes) {
      if (directive.find(attribute)) continue;
      problems_.fail(
          "<" + directive.tag + "> needs the attribute \"" + std::string(attribute) + "\"",
          directive.where);
      return false;
    }
    return true;
  }

  void follow_directive(const Element& directive, Element& parent, int depth) {
    if (directive.tag == "default") {
      if (has_all(directive, {"name", "value"})) {
        defaults_.define(directive.get("name"), directive.get("value"));
      }
    } else if (directive.tag == "include") {
      if (!has_all(directive, {"filename"})) return;
      const auto path = files_.find(directive.get("filename"));
      if (!path) return problems_.fail(path.error().message, directive.where);
      add_file(path.value(), directive.where, parent, depth + 1);
    } else if (directive.tag == "path") {
      if (!has_all(directive, {"value"})) return;
      const auto added = files_.add_search_directory(directive.get("value"));
      if (!added) problems_.fail(added.error().message, directive.where);
    } else if (directive.tag == "alias") {
      if (!has_all(directive, {"id", "as"})) return;
      aliases_.push_back({directive.get("id"), directive.get("as"), directive.where});
    }
  }

  void index_ids(const Element& element, Document& document) {
    const std::string* id = element.tag == "ref" ? nullptr : element.find("id");
    if (id) add_id(*id, element, element.where, document);
    for (const Element& child : element.children) index_ids(child, document);
  }

  void add_id(const std::string& id, const Element& element, const SourceLocation& where,
              Document& document) {
    const auto [it, added] = document.by_id.emplace(id, &element);
    if (added) return;
    problems_.fail("the id \"" + id + "\" is already taken by the " + it->second->tag + " at " +
                       Error{"", it->second->where}.to_string() + "ids must be unique",
                   where);
  }

  void resolve_aliases(Document& document) {
    for (const Alias& alias : aliases_) {
      const auto it = document.by_id.find(alias.id);
      if (it == document.by_id.end()) {
        std::vector<std::string_view> known;
        for (const auto& [id, element] : document.by_id) known.push_back(id);
        std::sort(known.begin(), known.end());
        return problems_.fail(
            "<alias> names the unknown id \"" + alias.id + "\"" + suggestion(alias.id, known),
            alias.where);
      }
      add_id(alias.as, *it->second, alias.where, document);
    }
  }

  FileAccess& files_;
  Problems& problems_;
  Defaults defaults_;
  std::vector<Alias> aliases_;
  int include_count_ = 0;
};

}  // namespace

Document read_document(const std::filesystem::path& file, const LoadOptions& options,
                       FileAccess& files, Problems& problems) {
  return DocumentBuilder(options, files, problems).build(file);
}

}  // namespace metrofarm::scene_file::mitsuba
