#include "geometry/hull.h"

#include <algorithm>
#include <cmath>

#include "geometry/analytic.h"

namespace metrofarm::geometry {
namespace {

// Cells along each axis: enough that corners of boxes do not reach far beyond what is in them.
constexpr int kAcross = 8;

int cell_along(float value, float low, float high) {
  const float share = high > low ? (value - low) / (high - low) : 0.F;
  return std::clamp(static_cast<int>(share * kAcross), 0, kAcross - 1);
}

// Vertices sorted into cells, and the box of each cell's.
class Cells {
 public:
  explicit Cells(const Bounds& all)
      : all_(all), cells_(size_t{kAcross} * kAcross * kAcross, no_bounds()) {}

  void add(const float* vertex) {
    int number = 0;
    for (int k = 0; k < 3; ++k)
      number = number * kAcross + cell_along(vertex[k], all_.lower[k], all_.upper[k]);
    Bounds& cell = cells_[static_cast<size_t>(number)];
    for (int k = 0; k < 3; ++k) include(cell, k, vertex[k], vertex[k]);
  }

  std::vector<Bounds> filled() const {
    std::vector<Bounds> out;
    for (const Bounds& cell : cells_)
      if (cell.lower[0] <= cell.upper[0]) out.push_back(cell);
    return out;
  }

 private:
  const Bounds& all_;
  std::vector<Bounds> cells_;
};

std::vector<Bounds> cells_of(const Primitives& p, const PrimitiveRange& range, const Bounds& all) {
  Cells cells(all);
  if (range.deforming >= 0) {
    for (const scene::VertexKey& key : p.deforming[static_cast<size_t>(range.deforming)].keys)
      for (size_t i = 0; i < key.positions.size(); i += 3) cells.add(&key.positions[i]);
  } else {
    const int32_t* indices = p.indices.data() + 3 * static_cast<size_t>(range.first_triangle);
    for (size_t i = 0; i < 3 * static_cast<size_t>(range.triangle_count); ++i)
      cells.add(&p.positions[3 * static_cast<size_t>(indices[i])]);
  }
  return cells.filled();
}

// How much more area boxes may have for there to be fewer of them: Embree's trees ask for the time
// at each of their nodes, and of a motion in many segments have many.
constexpr double kRoom = 1.3;
// Embree takes one more step than that.
constexpr size_t kMostSegments = 128;

double area_of(const Bounds& b) {
  const double x = double(b.upper[0]) - b.lower[0], y = double(b.upper[1]) - b.lower[1],
               z = double(b.upper[2]) - b.lower[2];
  return x * y + y * z + z * x;
}

// Over time, as far as the boxes tell.
double mean_area(const std::vector<Bounds>& boxes) {
  double sum = -(area_of(boxes.front()) + area_of(boxes.back())) / 2;
  for (const Bounds& box : boxes) sum += area_of(box);
  return sum / static_cast<double>(boxes.size() - 1);
}

// At a share of the time.
Bounds between(const std::vector<Bounds>& boxes, double share) {
  const auto segments = static_cast<double>(boxes.size() - 1);
  const auto i = static_cast<size_t>(std::min(share * segments, segments - 1));
  const auto t = static_cast<float>(share * segments - static_cast<double>(i));
  const Bounds &a = boxes[i], &b = boxes[i + 1];
  Bounds out;
  for (int k = 0; k < 3; ++k) {
    out.lower[k] = (1 - t) * a.lower[k] + t * b.lower[k];
    out.upper[k] = (1 - t) * a.upper[k] + t * b.upper[k];
  }
  return out;
}

// Boxes for so many segments that hold the steps' boxes: theirs at these times, grown by what
// steps in between stand out.
std::vector<Bounds> fewer_boxes(const std::vector<Bounds>& steps, size_t segments) {
  std::vector<Bounds> boxes;
  for (size_t j = 0; j <= segments; ++j)
    boxes.push_back(between(steps, static_cast<double>(j) / static_cast<double>(segments)));
  std::vector<Bounds> grown = boxes;
  for (size_t i = 0; i < steps.size(); ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(steps.size() - 1);
    const Bounds here = between(boxes, share);
    const size_t j = std::min(i * segments / (steps.size() - 1), segments - 1);
    for (int k = 0; k < 3; ++k) {
      const float low = steps[i].lower[k] - here.lower[k];
      const float high = steps[i].upper[k] - here.upper[k];
      for (size_t end : {j, j + 1}) {
        grown[end].lower[k] = std::min(grown[end].lower[k], boxes[end].lower[k] + low);
        grown[end].upper[k] = std::max(grown[end].upper[k], boxes[end].upper[k] + high);
      }
    }
  }
  return grown;
}

}  // namespace

Hull::Hull(const Primitives& primitives, const PrimitiveRange& range)
    : primitives_(&primitives),
      first_analytic_(range.first_analytic),
      analytic_count_(range.analytic_count) {
  const Bounds all = bounds_of(primitives, range);
  reach_ = reach_of(all);
  if (range.triangle_count > 0) cells_ = cells_of(primitives, range, all);
}

Bounds Hull::under(const float* to_world) const {
  Bounds bounds = no_bounds();
  for (const Bounds& cell : cells_) include_mapped(bounds, cell, to_world);
  for (int32_t i = 0; i < analytic_count_; ++i) {
    const auto index = static_cast<uint32_t>(first_analytic_ + i);
    include(bounds, bounds_of_analytic(*primitives_, index, to_world));
  }
  return bounds;
}

std::vector<Bounds> boxes_of_steps(const Hull& hull, const Placements& placements,
                                   size_t instance) {
  const int parts = placements.parts(instance);
  const int count = parts * (placements.step_count(instance) - 1);
  const double reach = hull.reach();
  const auto bulge = [&](int part) {
    if (part < 0 || part == count) return 0.0;
    return placements.bulge(instance, part / parts, parts, reach);
  };
  std::vector<Bounds> boxes;
  for (int i = 0; i <= count; ++i) {
    const float time = static_cast<float>(i) / static_cast<float>(count);
    Bounds box = hull.under(placements.matrix_at(instance, time).data());
    const auto slack = static_cast<float>(std::max(bulge(i - 1), bulge(i)));
    for (int k = 0; k < 3; ++k) {
      box.lower[k] -= slack;
      box.upper[k] += slack;
    }
    boxes.push_back(box);
  }
  return boxes;
}

std::vector<Bounds> boxes_over_time(const Hull& hull, const Placements& placements,
                                    size_t instance) {
  const std::vector<Bounds> steps = boxes_of_steps(hull, placements, instance);
  const double least = mean_area(steps);
  const size_t segments = steps.size() - 1;
  size_t fewer = 1;
  for (; fewer < segments && fewer < kMostSegments; fewer *= 2) {
    std::vector<Bounds> boxes = fewer_boxes(steps, fewer);
    if (mean_area(boxes) <= kRoom * least) return boxes;
  }
  return fewer_boxes(steps, std::min(fewer, segments));
}

}  // namespace metrofarm::geometry
