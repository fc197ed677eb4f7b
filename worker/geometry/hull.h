// Where what a group shows is under any map: closer than the box around the group's box.
#pragma once

#include <vector>

#include "geometry/placements.h"
#include "geometry/primitives.h"

namespace metrofarm::geometry {

// Boxes and analytic shapes that together hold a group.
class Hull {
 public:
  // primitives: outlive this.
  Hull(const Primitives& primitives, const PrimitiveRange& range);
  // A single box: less close, but made in no time.
  explicit Hull(const Bounds& box) : reach_(reach_of(box)), cells_{box} {}

  // to_world: 3 x 4, row major. lower > upper if there is nothing.
  Bounds under(const float* to_world) const;
  // How far the farthest corner is from the origin.
  double reach() const { return reach_; }

 private:
  const Primitives* primitives_ = nullptr;
  int32_t first_analytic_ = 0, analytic_count_ = 0;
  double reach_;
  std::vector<Bounds> cells_;  // of triangles
};

// Where an instance that moves is: boxes at equal distances in time from the interval's begin to
// its end, which hold it when they are interpolated linearly.

// At its steps and, where it turns, between them.
std::vector<Bounds> boxes_of_steps(const Hull& hull, const Placements& placements, size_t instance);
// Two where that is not much more than it takes up, as of what goes straight ahead; never more than
// Embree has steps.
std::vector<Bounds> boxes_over_time(const Hull& hull, const Placements& placements,
                                    size_t instance);

}  // namespace metrofarm::geometry
