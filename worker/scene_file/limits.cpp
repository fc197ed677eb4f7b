#include "scene_file/limits.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "motion/track.h"
#include "scene_file/affine.h"

namespace metrofarm::scene_file {
namespace {

// Tables are gathered with 32-bit signed indices, three numbers per vertex or triangle.
constexpr uint64_t kMostRows = std::numeric_limits<int32_t>::max() / 3 - 4;
// An instance has 24 numbers.
constexpr uint64_t kMostInstances = std::numeric_limits<int32_t>::max() / 24;
// The choice among lights has 2^24 steps, and each light gets one at least.
constexpr uint64_t kMostLights = (uint64_t{1} << 22) - 1;

class Counter {
 public:
  Counter(const char* what, uint64_t most) : what_(what), most_(most) {}

  std::optional<Error> add(uint64_t count, const SourceLocation& where) {
    sum_ += count;
    if (sum_ <= most_) return std::nullopt;
    return Error{"with this the scene has " + std::to_string(sum_) + " " + what_ + "; at most " +
                     std::to_string(most_) + " can be rendered",
                 where};
  }

 private:
  const char* what_;
  uint64_t most_;
  uint64_t sum_ = 0;
};

struct Box {
  Point lower = {HUGE_VAL, HUGE_VAL, HUGE_VAL};
  Point upper = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};

  void add(const Point& p) {
    for (size_t k = 0; k < 3; ++k) {
      lower[k] = std::min(lower[k], p[k]);
      upper[k] = std::max(upper[k], p[k]);
    }
  }
  void add(const Box& box) {
    if (!(box.lower[0] <= box.upper[0])) return;
    add(box.lower);
    add(box.upper);
  }
  Box under(const Matrix& m) const {
    Box image;
    if (!(lower[0] <= upper[0])) return image;
    for (int corner = 0; corner < 8; ++corner) {
      Point p = lower;
      for (size_t k = 0; k < 3; ++k)
        if ((corner >> k & 1) != 0) p[k] = upper[k];
      image.add(transform_point(m, p));
    }
    return image;
  }
  double largest() const {
    double most = 0;
    for (size_t k = 0; k < 3; ++k) most = std::max({most, std::abs(lower[k]), std::abs(upper[k])});
    return most;
  }
};

Box box_of(const scene::Shape& shape) {
  Box box;
  const Box square{{-1, -1, 0}, {1, 1, 0}}, column{{-1, -1, 0}, {1, 1, 1}};
  if (const auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry)) {
    for (size_t i = 0; i + 2 < mesh->positions.size(); i += 3) {
      box.add(Point{mesh->positions[i], mesh->positions[i + 1], mesh->positions[i + 2]});
    }
    for (const scene::VertexKey& key : mesh->keys) {
      for (size_t i = 0; i + 2 < key.positions.size(); i += 3)
        box.add(Point{key.positions[i], key.positions[i + 1], key.positions[i + 2]});
    }
  } else if (const auto* sphere = std::get_if<scene::Sphere>(&shape.geometry)) {
    for (double r : {-sphere->radius, sphere->radius}) {
      box.add(Point{sphere->center[0] + r, sphere->center[1] + r, sphere->center[2] + r});
    }
  } else if (const auto* disk = std::get_if<scene::Disk>(&shape.geometry)) {
    box = square.under(disk->to_world);
  } else {
    box = column.under(std::get<scene::Cylinder>(shape.geometry).to_world);
  }
  return box;
}

std::optional<Error> check_extent(const Box& box, const char* what, const SourceLocation& where) {
  if (!(box.lower[0] <= box.upper[0]) || box.largest() <= kLargestCoordinate) return std::nullopt;
  return Error{std::string(what) + " reaches beyond 1.8e18 from the origin, where nothing can be " +
                   "rendered; use a smaller unit of length",
               where};
}

std::optional<Error> check_motion(const Box& box, const scene::Motion& motion, const char* what,
                                  const SourceLocation& where) {
  if (motion.empty()) return std::nullopt;
  Box way;
  for (const scene::Keyframe& key : motion.keys) way.add(box.under(key.to_world));
  for (const Point& p : motion::Track(motion).control_points()) {
    // Numbers that are none are not seen by min() and max().
    for (double v : p) way.add(std::isfinite(v) ? p : Point{HUGE_VAL, HUGE_VAL, HUGE_VAL});
  }
  return check_extent(way, what, where);
}

// What has a place but no extent.
std::optional<Error> check_viewpoints(const scene::SceneDescription& scene) {
  Box origin;
  origin.add(Point{0, 0, 0});
  for (const scene::Emitter& emitter : scene.emitters)
    if (auto error = check_motion(origin, emitter.motion, "the light", emitter.where)) return error;
  return check_motion(origin, scene.sensor.motion, "the way of the sensor", scene.sensor.where);
}

std::optional<Error> check_extents(const scene::SceneDescription& scene) {
  std::vector<Box> groups;
  for (const scene::Shape& shape : scene.shapes) {
    const Box box = box_of(shape);
    if (auto error = check_extent(box, "the shape", shape.where)) return error;
    if (auto error = check_motion(box, shape.motion, "the shape", shape.where)) return error;
    if (shape.group == scene::kNone) continue;
    const auto group = static_cast<size_t>(shape.group);
    if (group >= groups.size()) groups.resize(group + 1);
    groups[group].add(box);
  }
  for (const scene::Instance& instance : scene.instances) {
    const auto group = static_cast<size_t>(instance.group);
    if (group >= groups.size()) continue;
    const Box box = groups[group].under(instance.to_world);
    if (auto error = check_extent(box, "the instance", instance.where)) return error;
    if (auto error = check_motion(box, instance.motion, "the instance", instance.where))
      return error;
  }
  return check_viewpoints(scene);
}

std::optional<Error> check_counts(const scene::SceneDescription& scene) {
  Counter vertices("vertices", kMostRows), primitives("triangles and other surfaces", kMostRows);
  Counter lights("lights (a mesh counts by its triangles)", kMostLights);
  for (const scene::Shape& shape : scene.shapes) {
    const auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry);
    const uint64_t surfaces = mesh ? mesh->indices.size() / 3 : 1;
    const bool lit = shape.area_emitter != scene::kNone;
    auto error = vertices.add(mesh ? mesh->positions.size() / 3 : 0, shape.where);
    if (!error) error = primitives.add(surfaces, shape.where);
    if (!error) error = lights.add(lit ? surfaces : 0, shape.where);
    if (error) return error;
  }
  for (const scene::Emitter& emitter : scene.emitters) {
    if (std::holds_alternative<scene::AreaEmitter>(emitter.model)) continue;
    if (auto error = lights.add(1, emitter.where)) return error;
  }
  Counter instances("instances", kMostInstances);
  for (const scene::Instance& instance : scene.instances) {
    if (auto error = instances.add(1, instance.where)) return error;
  }
  return std::nullopt;
}

}  // namespace

std::optional<Error> check_limits(const scene::SceneDescription& scene) {
  if (auto error = check_counts(scene)) return error;
  return check_extents(scene);
}

}  // namespace metrofarm::scene_file
