// Parameter lists ("type name" value ...) and typed access to them. What nothing asks for is
// unknown to the plugin, and finish() says so: a misspelt parameter must not be ignored.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "scene_file/affine.h"
#include "scene_file/pbrt/tokenizer.h"
#include "scene_file/problems.h"

namespace metrofarm::scene_file::pbrt {

enum class ParameterType {
  kBool,
  kInteger,
  kFloat,
  kPoint2,
  kVector2,
  kPoint3,
  kVector3,
  kNormal,
  kRgb,
  kSpectrum,
  kBlackbody,
  kString,
  kTexture,
};

// The primaries in which the rgb values of a list are given.
enum class ColourSpace { kSrgb, kDciP3, kRec2020 };

struct Parameter {
  ParameterType type = ParameterType::kFloat;
  std::string name;
  SourceLocation where;
  std::vector<double> numbers;       // truth values are 0 and 1
  std::vector<std::string> strings;  // kString, kTexture, and kSpectrum by name
  bool asked = false;
};

class Parameters {
 public:
  Parameters() = default;
  Parameters(std::vector<Parameter> list, SourceLocation where, ColourSpace space)
      : list_(std::move(list)), where_(std::move(where)), space_(space) {}

  // Of the directive that the list belongs to.
  const SourceLocation& where() const { return where_; }
  ColourSpace colour_space() const { return space_; }

  // Adds those whose names are not in the list; nobody has to ask for them.
  void add_defaults(const std::vector<Parameter>& defaults);

  // The parameter with this name, whatever its type, or nullptr. Asks for it.
  Parameter* find(std::string_view name);
  // The same if its type is one of these; another type is a problem.
  Parameter* find(std::string_view name, std::initializer_list<ParameterType> types,
                  Problems& problems);

  // Each asks for one value; `fallback` if the file doesn't have it or after a problem.
  double number(std::string_view name, double fallback, Problems& problems);
  double positive(std::string_view name, double fallback, Problems& problems);
  int integer_in(std::string_view name, int fallback, int lowest, Problems& problems);
  bool boolean(std::string_view name, bool fallback, Problems& problems);
  std::string text(std::string_view name, std::string_view fallback, Problems& problems);
  Point point(std::string_view name, const Point& fallback, Problems& problems);

  // All numbers of a parameter of this type; empty if the file doesn't have it. The list is moved
  // out: ask once.
  std::vector<double> take_numbers(std::string_view name, ParameterType type, Problems& problems);

  // Accepts parameters that have no effect here.
  void ignore(std::initializer_list<std::string_view> names);

  // Reports every parameter that nothing asked for; `owner` says whose they are.
  void finish(std::string_view owner, Problems& problems);

 private:
  Parameter* find_single(std::string_view name, ParameterType type, Problems& problems);

  std::vector<Parameter> list_;
  SourceLocation where_;
  ColourSpace space_ = ColourSpace::kSrgb;
  std::vector<std::string> known_;
};

// A directive's plugin with its parameters: Shape "sphere" "float radius" 2.
struct Entity {
  std::string type;
  Parameters parameters;

  const SourceLocation& where() const { return parameters.where(); }
};

// Reads parameters up to the next word. Problems name the file.
std::vector<Parameter> read_parameters(Tokenizer& tokens, const std::string& file,
                                       Problems& problems);

}  // namespace metrofarm::scene_file::pbrt
