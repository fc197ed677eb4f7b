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

  // to_world: 3 x 4, row major. lower > upper if there is nothing.
  Bounds under(const float* to_world) const;
  // How far the farthest corner is from the origin.
  double reach() const;

 private:
  const Primitives& primitives_;
  PrimitiveRange range_;
  std::vector<Bounds> cells_;  // of triangles
};

// Where an instance that moves is: boxes at equal distances in time from the interval's begin to
// its end, which hold it when they are interpolated linearly. Two where that is not much more than
// it takes up, as of what goes straight ahead; never more than Embree has steps.
std::vector<Bounds> boxes_over_time(const Hull& hull, const Placements& placements,
                                    size_t instance);

}  // namespace metrofarm::geometry
