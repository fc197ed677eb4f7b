// Transforms and attributes.
#include <cmath>

#include "scene_file/names.h"
#include "scene_file/pbrt/affine_inverse.h"
#include "scene_file/pbrt/interpreter.h"

namespace metrofarm::scene_file::pbrt {

void Interpreter::apply(const Matrix& matrix) {
  for (size_t i = 0; i < 2; ++i) {
    if (state_.active[i]) state_.transform[i] = multiply(state_.transform[i], matrix);
  }
}

void Interpreter::set_transform(const TransformPair& pair) {
  for (size_t i = 0; i < 2; ++i) {
    if (state_.active[i]) state_.transform[i] = pair[i];
  }
}

void Interpreter::identity() {
  set_transform({kIdentity, kIdentity});
}

void Interpreter::translate() {
  const std::vector<double> v = read_numbers(3);
  if (!failed()) apply(translation({v[0], v[1], v[2]}));
}

void Interpreter::scale() {
  const std::vector<double> v = read_numbers(3);
  if (!failed()) apply(scaling({v[0], v[1], v[2]}));
}

void Interpreter::rotate() {
  const std::vector<double> v = read_numbers(4);
  if (failed()) return;
  const Point axis = {v[1], v[2], v[3]};
  if (length(axis) == 0) return fail("Rotate needs an axis that is not zero: angle x y z");
  apply(rotation(axis, v[0]));
}

void Interpreter::look_at_directive() {
  const std::vector<double> v = read_numbers(9);
  if (failed()) return;
  const auto placed = look_at({v[0], v[1], v[2]}, {v[3], v[4], v[5]}, {v[6], v[7], v[8]});
  if (!placed) {
    return fail(
        "LookAt needs an eye and a target that differ and an up vector across the line "
        "of sight");
  }
  apply(*affine_inverse(*placed));
}

// pbrt writes matrices column by column.
Matrix Interpreter::read_matrix() {
  const std::vector<double> v = read_numbers(16);
  if (failed()) return kIdentity;
  if (v[3] != 0 || v[7] != 0 || v[11] != 0 || v[15] == 0) {
    fail(
        "a transform must be affine: columns one after the other, the fourth number of each 0, "
        "of the last 1");
    return kIdentity;
  }
  Matrix m{};
  for (size_t row = 0; row < 4; ++row) {
    for (size_t col = 0; col < 4; ++col) m[4 * row + col] = v[4 * col + row] / v[15];
  }
  return m;
}

void Interpreter::transform() {
  const Matrix m = read_matrix();
  set_transform({m, m});
}

void Interpreter::concat_transform() {
  apply(read_matrix());
}

void Interpreter::coordinate_system() {
  coordinate_systems_[read_string("a name")] = state_.transform;
}

void Interpreter::coord_sys_transform() {
  const std::string name = read_string("the name of a coordinate system");
  const auto found = coordinate_systems_.find(name);
  if (found != coordinate_systems_.end()) return set_transform(found->second);
  std::vector<std::string_view> known;
  for (const auto& [other, unused] : coordinate_systems_) known.push_back(other);
  fail("no coordinate system is named \"" + name + "\"" + suggestion(name, known));
}

void Interpreter::active_transform() {
  const std::optional<Token> which = source_->tokens.next();
  const std::string_view text = which ? which->text : "";
  if (text == "All") {
    state_.active = {true, true};
  } else if (text == "StartTime") {
    state_.active = {true, false};
  } else if (text == "EndTime") {
    state_.active = {false, true};
  } else {
    fail("ActiveTransform must be StartTime, EndTime or All");
  }
}

void Interpreter::transform_times() {
  const std::vector<double> v = read_numbers(2);
  if (failed()) return;
  if (!(v[0] < v[1])) return fail("TransformTimes needs a start and a later end");
  context_.transform_times = {v[0], v[1]};
}

void Interpreter::push(std::string_view opened_by) {
  constexpr size_t kDeepest = 10000;
  if (saved_.size() >= kDeepest) return fail("blocks are nested too deeply");
  saved_.push_back({state_, std::string(opened_by), here()});
}

void Interpreter::pop(std::string_view opened_by, std::string_view closed_by) {
  if (saved_.empty()) {
    return fail(std::string(closed_by) + " without " + std::string(opened_by));
  }
  const SavedState& saved = saved_.back();
  if (saved.opened_by != opened_by) {
    return fail(std::string(closed_by) + " closes what " + saved.opened_by + " opened in line " +
                std::to_string(saved.where.line));
  }
  state_ = saved.state;
  saved_.pop_back();
}

void Interpreter::attribute_begin() {
  push("AttributeBegin");
}

void Interpreter::attribute_end() {
  pop("AttributeBegin", "AttributeEnd");
}

void Interpreter::transform_begin() {
  push("TransformBegin");
}

// Only the transforms are restored.
void Interpreter::transform_end() {
  GraphicsState attributes = state_;
  pop("TransformBegin", "TransformEnd");
  attributes.transform = state_.transform;
  attributes.active = state_.active;
  state_ = std::move(attributes);
}

void Interpreter::attribute() {
  const std::string target = read_string("a target such as \"shape\"");
  std::vector<Parameter> list = read_parameters(source_->tokens, source_->name, context_.problems);
  constexpr std::string_view kTargets[] = {"shape", "light", "material", "medium", "texture"};
  for (std::string_view known : kTargets) {
    if (known != target) continue;
    std::vector<Parameter>& defaults = state_.defaults[target];
    for (Parameter& parameter : list) {
      std::erase_if(defaults, [&](const Parameter& d) { return d.name == parameter.name; });
      defaults.push_back(std::move(parameter));
    }
    return;
  }
  fail("unknown target \"" + target + "\" of Attribute" +
       suggestion(target, {std::begin(kTargets), std::end(kTargets)}));
}

void Interpreter::reverse_orientation() {
  state_.reverse_orientation = !state_.reverse_orientation;
}

void Interpreter::colour_space() {
  const std::string name = lower_case(read_string("a name such as \"srgb\""));
  if (name == "srgb") {
    state_.colour_space = ColourSpace::kSrgb;
  } else if (name == "rec2020") {
    state_.colour_space = ColourSpace::kRec2020;
  } else if (name == "dci-p3") {
    state_.colour_space = ColourSpace::kDciP3;
  } else {
    context_.problems.unsupported("colour space \"" + name + "\" is not supported" +
                                      suggestion(name, {"srgb", "rec2020", "dci-p3"}),
                                  here());
  }
}

}  // namespace metrofarm::scene_file::pbrt
