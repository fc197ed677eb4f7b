#include "scene_file/mitsuba/transforms.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "scene/linear.h"
#include "scene_file/mitsuba/properties.h"
#include "scene_file/names.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

Matrix read_matrix(const Element& step, Problems& problems) {
  const auto values = parse_doubles(step.get("value"));
  if (!values || (values->size() != 9 && values->size() != 16)) {
    problems.fail("<matrix> needs 16 (or 9) numbers, row by row", step.where);
    return kIdentity;
  }
  Matrix m = kIdentity;
  const size_t width = values->size() == 16 ? 4 : 3;
  for (size_t row = 0; row < width; ++row) {
    for (size_t col = 0; col < width; ++col) m[4 * row + col] = (*values)[width * row + col];
  }
  constexpr double kTolerance = 1e-6;
  if (std::abs(m[12]) + std::abs(m[13]) + std::abs(m[14]) + std::abs(m[15] - 1) > kTolerance) {
    problems.fail("the last row of <matrix> must be 0 0 0 1", step.where);
  }
  return m;
}

Matrix read_rotate(const Element& step, Problems& problems) {
  const Point axis = read_components(step, 0, problems);
  const auto angle = parse_double(step.get("angle"));
  if (!angle) {
    problems.fail("<rotate> needs angle=\"DEGREES\"", step.where);
    return kIdentity;
  }
  if (length(axis) == 0) {
    problems.fail("the axis of <rotate> must not be zero; give x=, y= or z=", step.where);
    return kIdentity;
  }
  constexpr double kUnitTolerance = 1e-4;
  if (step.legacy || std::abs(length(axis) - 1) < kUnitTolerance) return rotation(axis, *angle);
  problems.warn(
      "the axis of <rotate> is not of unit length: as in Mitsuba 3, the result is no rotation",
      step.where);
  return rotation_formula(axis, *angle);
}

Point read_point_attribute(const Element& step, std::string_view name, Problems& problems) {
  const auto values = parse_doubles(step.get(name));
  if (values && values->size() == 3) return {(*values)[0], (*values)[1], (*values)[2]};
  problems.fail("<lookat> needs " + std::string(name) + "=\"x, y, z\"", step.where);
  return {0, 0, 0};
}

Matrix read_lookat(const Element& step, Problems& problems) {
  const Point origin = read_point_attribute(step, "origin", problems);
  const Point target = read_point_attribute(step, "target", problems);
  if (problems.failed()) return kIdentity;
  // Without an up direction (or with a zero one) any will do.
  Point up = step.find("up") ? read_point_attribute(step, "up", problems) : Point{0, 0, 0};
  if (length(up) == 0) up = any_perpendicular(normalized(subtract(target, origin)));
  const std::optional<Matrix> m = look_at(origin, target, up);
  if (!m && !problems.failed()) {
    problems.fail(
        "<lookat> is degenerate: origin and target must differ, and up must not be "
        "parallel to the line of sight",
        step.where);
  }
  return m.value_or(kIdentity);
}

Matrix read_step(const Element& step, Problems& problems) {
  if (step.tag == "matrix") return read_matrix(step, problems);
  if (step.tag == "translate") return translation(read_components(step, 0, problems));
  if (step.tag == "scale") return scaling(read_components(step, 1, problems));
  if (step.tag == "rotate") return read_rotate(step, problems);
  if (step.tag == "lookat") return read_lookat(step, problems);
  problems.unsupported(
      "<" + step.tag + "> is not a step of a <transform>" +
          suggestion(step.tag, {"matrix", "translate", "scale", "rotate", "lookat"}),
      step.where);
  return kIdentity;
}

scene::MotionPath read_path(const Element& animation, Problems& problems) {
  const std::string* path = animation.find("interpolation");
  if (!path || *path == "linear") return scene::MotionPath::kLinear;
  if (*path == "catmullrom") return scene::MotionPath::kCatmullRom;
  if (*path == "bezier") return scene::MotionPath::kBezier;
  problems.fail("unknown interpolation \"" + *path + "\" of an <animation>" +
                    suggestion(*path, {"linear", "catmullrom", "bezier"}),
                animation.where);
  return scene::MotionPath::kLinear;
}

// A point of a Bezier path beside a key; where the key itself is unless the file says otherwise.
Point read_control(const Element& key, std::string_view name, const Matrix& to_world,
                   scene::MotionPath path, Problems& problems) {
  const Point origin = {to_world[3], to_world[7], to_world[11]};
  const std::string* text = key.find(name);
  if (!text) return origin;
  const auto values = parse_doubles(*text);
  if (path != scene::MotionPath::kBezier) {
    problems.fail("in= and out= of a <transform> need <animation interpolation=\"bezier\">",
                  key.where);
  } else if (!values || values->size() != 3) {
    problems.fail(std::string(name) + "= of a <transform> must be three numbers, as in \"1, 2, 3\"",
                  key.where);
  } else {
    return {(*values)[0], (*values)[1], (*values)[2]};
  }
  return origin;
}

// Where a step takes the axes of turns before it; nothing if it makes turns something else.
// A mirror -Q keeps a turn's angle, about the axis that Q gives.
std::optional<scene::Linear> carries_axes(const Matrix& step) {
  scene::Linear m = scene::linear_part(step);
  const double scale = std::cbrt(scene::determinant(m));
  if (!std::isfinite(scale) || scale == 0) return std::nullopt;
  for (double& v : m) v /= scale;
  constexpr double kTolerance = 1e-6;  // as files print numbers
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      double product = 0;
      for (int k = 0; k < 3; ++k) product += m[3 * i + k] * m[3 * j + k];
      if (std::abs(product - (i == j ? 1 : 0)) > kTolerance) return std::nullopt;
    }
  }
  return m;
}

// What turns is told as it stands in the file: a matrix does not know of whole turns. Those before
// a step that is neither a translation nor, but for an equal scale, a rotation, are left out.
std::vector<scene::Turn> read_turns(const Element& key, Problems& problems) {
  std::vector<scene::Turn> turns;
  for (const Element& step : key.children) {
    const auto angle = parse_double(step.get("angle"));
    if (step.tag == "rotate" && angle) {
      turns.push_back({read_components(step, 0, problems), *angle});
    } else if (!turns.empty() && step.tag != "translate") {
      const auto carried = carries_axes(read_step(step, problems));
      if (!carried) {
        const auto whole = [](const scene::Turn& turn) { return std::abs(turn.degrees) >= 360; };
        if (std::any_of(turns.begin(), turns.end(), whole))
          problems.warn("whole turns before a step that stretches are not followed", step.where);
        turns.clear();
        continue;
      }
      const scene::Linear& m = *carried;
      for (scene::Turn& turn : turns) {
        const Point a = turn.axis;
        for (size_t i = 0; i < 3; ++i)
          turn.axis[i] = m[3 * i] * a[0] + m[3 * i + 1] * a[1] + m[3 * i + 2] * a[2];
      }
    }
  }
  return turns;
}

scene::Keyframe read_key(const Element& key, double time, scene::MotionPath path,
                         Problems& problems) {
  scene::Keyframe frame;
  frame.time = time;
  frame.to_world = read_transform(key, problems);
  frame.turns = read_turns(key, problems);
  frame.in = read_control(key, "in", frame.to_world, path, problems);
  frame.out = read_control(key, "out", frame.to_world, path, problems);
  return frame;
}

}  // namespace

Matrix read_transform(const Element& transform, Problems& problems) {
  Matrix m = kIdentity;
  for (const Element& step : transform.children) m = multiply(read_step(step, problems), m);
  const bool finite = std::all_of(m.begin(), m.end(), [](double v) { return std::isfinite(v); });
  if (!finite) problems.fail("the transform's numbers are too large", transform.where);
  return m;
}

scene::Motion read_animation(const Element& animation, Problems& problems) {
  scene::Motion motion;
  motion.path = read_path(animation, problems);
  for (const Element& child : animation.children) {
    const auto time = parse_double(child.get("time"));
    if (child.tag != "transform" || !time) {
      problems.fail("<animation> takes <transform time=\"SECONDS\"> only", child.where);
      return {};
    }
    motion.keys.push_back(read_key(child, *time, motion.path, problems));
  }
  if (motion.empty()) {
    problems.fail("<animation> needs at least one <transform time=\"SECONDS\">", animation.where);
  }
  const auto by_time = [](const auto& a, const auto& b) { return a.time < b.time; };
  std::stable_sort(motion.keys.begin(), motion.keys.end(), by_time);
  const auto same_time = [](const auto& a, const auto& b) { return a.time == b.time; };
  if (std::adjacent_find(motion.keys.begin(), motion.keys.end(), same_time) != motion.keys.end()) {
    problems.fail("two <transform> of an <animation> have the same time", animation.where);
    return {};
  }
  return motion;
}

}  // namespace metrofarm::scene_file::mitsuba
