#include "scene_file/pbrt/parameters.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "scene_file/names.h"

namespace metrofarm::scene_file::pbrt {
namespace {

std::string_view name_of(ParameterType type) {
  constexpr std::array<std::string_view, 13> kNames = {
      "bool",   "integer", "float",    "point2",    "vector2", "point3", "vector3",
      "normal", "rgb",     "spectrum", "blackbody", "string",  "texture"};
  return kNames[static_cast<size_t>(type)];
}

}  // namespace

void Parameters::add_defaults(const std::vector<Parameter>& defaults) {
  for (const Parameter& parameter : defaults) {
    const auto same = [&](const Parameter& own) { return own.name == parameter.name; };
    if (std::any_of(list_.begin(), list_.end(), same)) continue;
    list_.push_back(parameter);
    list_.back().asked = true;
  }
}

Parameter* Parameters::find(std::string_view name) {
  if (std::find(known_.begin(), known_.end(), name) == known_.end()) known_.emplace_back(name);
  for (Parameter& parameter : list_) {
    if (parameter.name != name) continue;
    parameter.asked = true;
    return &parameter;
  }
  return nullptr;
}

Parameter* Parameters::find(std::string_view name, std::initializer_list<ParameterType> types,
                            Problems& problems) {
  Parameter* parameter = find(name);
  if (!parameter) return nullptr;
  if (std::find(types.begin(), types.end(), parameter->type) != types.end()) return parameter;
  std::string wanted;
  for (ParameterType type : types) {
    wanted += (wanted.empty() ? "" : " or ") + std::string(name_of(type));
  }
  problems.fail("parameter \"" + parameter->name + "\" must be of type " + wanted + ", not " +
                    std::string(name_of(parameter->type)),
                parameter->where);
  return nullptr;
}

Parameter* Parameters::find_single(std::string_view name, ParameterType type, Problems& problems) {
  Parameter* parameter = find(name, {type}, problems);
  if (!parameter) return nullptr;
  const size_t wanted = type == ParameterType::kPoint3 || type == ParameterType::kVector3 ? 3 : 1;
  const bool holds_strings = type == ParameterType::kString || type == ParameterType::kTexture;
  const size_t given = holds_strings ? parameter->strings.size() : parameter->numbers.size();
  if (given == wanted) return parameter;
  problems.fail("parameter \"" + parameter->name + "\" must have " +
                    (wanted == 1 ? "one value" : "three numbers") + ", not " +
                    std::to_string(given),
                parameter->where);
  return nullptr;
}

double Parameters::number(std::string_view name, double fallback, Problems& problems) {
  const Parameter* parameter = find_single(name, ParameterType::kFloat, problems);
  return parameter ? parameter->numbers[0] : fallback;
}

double Parameters::positive(std::string_view name, double fallback, Problems& problems) {
  const double value = number(name, fallback, problems);
  if (value > 0) return value;
  problems.fail("parameter \"" + std::string(name) + "\" must be greater than 0",
                find(name)->where);
  return fallback;
}

int Parameters::integer_in(std::string_view name, int fallback, int lowest, Problems& problems) {
  const Parameter* parameter = find_single(name, ParameterType::kInteger, problems);
  if (!parameter) return fallback;
  const double value = parameter->numbers[0];
  if (value >= lowest && value <= std::numeric_limits<int>::max()) return static_cast<int>(value);
  problems.fail("parameter \"" + parameter->name + "\" must be at least " + std::to_string(lowest) +
                    " and fit 32 bits",
                parameter->where);
  return fallback;
}

bool Parameters::boolean(std::string_view name, bool fallback, Problems& problems) {
  const Parameter* parameter = find_single(name, ParameterType::kBool, problems);
  return parameter ? parameter->numbers[0] != 0 : fallback;
}

std::string Parameters::text(std::string_view name, std::string_view fallback, Problems& problems) {
  const Parameter* parameter = find_single(name, ParameterType::kString, problems);
  return parameter ? parameter->strings[0] : std::string(fallback);
}

Point Parameters::point(std::string_view name, const Point& fallback, Problems& problems) {
  const Parameter* parameter = find_single(name, ParameterType::kPoint3, problems);
  if (!parameter) return fallback;
  return {parameter->numbers[0], parameter->numbers[1], parameter->numbers[2]};
}

std::vector<double> Parameters::take_numbers(std::string_view name, ParameterType type,
                                             Problems& problems) {
  Parameter* parameter = find(name, {type}, problems);
  return parameter ? std::move(parameter->numbers) : std::vector<double>{};
}

void Parameters::ignore(std::initializer_list<std::string_view> names) {
  for (std::string_view name : names) find(name);
}

void Parameters::finish(std::string_view owner, Problems& problems) {
  const std::vector<std::string_view> known(known_.begin(), known_.end());
  for (const Parameter& parameter : list_) {
    if (parameter.asked) continue;
    problems.unsupported(std::string(owner) + " has no parameter \"" + parameter.name + "\"" +
                             suggestion(parameter.name, known),
                         parameter.where);
  }
}

}  // namespace metrofarm::scene_file::pbrt
