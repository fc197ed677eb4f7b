// Where the groups' instances stand while a shutter is open: what the renderer keeps of their
// transforms, and surfaces carried by them from the group's space to the world.
#pragma once

#include <vector>

#include "geometry/deformation.h"
#include "geometry/primitives.h"
#include "motion/pose_table.h"

namespace metrofarm::geometry {

// How an instance maps its group to the world, in each lane.
struct Carrier {
  motion::LanePose pose;
  motion::LaneInverse inverse;
  // By which an offset o of the group becomes factor * o + shift in the world (see
  // Surface::offset).
  Float offset_factor, offset_shift;
};

// Immutable; thread-safe. Times of lanes are in [0, 1], from the interval's begin to its end.
class Placements {
 public:
  // Requires: primitives were built from the description; matrices are not singular.
  // Throws std::bad_alloc if the meshes that deform need more than max_bytes, see Deformations.
  Placements(const scene::SceneDescription& description, const Primitives& primitives,
             const motion::Interval& interval, uint64_t max_bytes = kAnyBytes);

  const motion::Interval& interval() const { return poses_.interval(); }
  bool empty() const { return fixed_.empty(); }
  size_t count() const { return moving_.size(); }
  // Whether time matters: something is not the same all the time.
  bool anything_moves() const { return poses_.count() > 0 || deformations_.anything_moves(); }
  const Deformations& deformations() const { return deformations_; }

  // Requires: the lanes have an instance.
  Carrier at(Int instance, Float time, Mask lanes) const;

  // ---- of one instance ----
  bool moves(size_t instance) const { return moving_[instance] >= 0; }
  // Whether the group's space is the world's.
  bool stays(size_t instance) const;
  // Requires: it moves. time: in [0, 1].
  motion::Pose pose(size_t instance, float time) const {
    return poses_.pose(static_cast<size_t>(moving_[instance]), time);
  }
  // Requires: it does not move. 3 x 4, row major.
  const float* matrix(size_t instance) const { return &fixed_[instance * kStride]; }
  int step_count(size_t instance) const {
    return poses_.step_count(static_cast<size_t>(moving_[instance]));
  }
  // See motion::PoseTable. Requires: it moves.
  int parts(size_t instance) const { return poses_.parts(static_cast<size_t>(moving_[instance])); }
  double bulge(size_t instance, int segment, int parts, double reach) const {
    return poses_.bulge(static_cast<size_t>(moving_[instance]), segment, parts, reach);
  }
  // How far from its track the steps take it at worst, relative to its size.
  double deviation(size_t instance) const {
    return poses_.deviation(static_cast<size_t>(moving_[instance]));
  }
  // The matrix, 3 x 4, at one time in [0, 1].
  std::array<float, 12> matrix_at(size_t instance, float time) const;
  // Whether it turns, moves and scales alike along all axes only, at all times.
  bool keeps_angles(size_t instance) const { return keeps_angles_[instance] != 0; }

  uint64_t bytes() const;

 private:
  // Floats of an instance that does not move: to_world (3 x 4, row major), the inverse transpose of
  // its linear part (3 x 3, row major), offset factor and shift. Of one that moves the last two
  // only.
  static constexpr int kStride = 24;

  void add(const scene::Matrix& inner, const scene::Motion& motion, const Bounds& group);
  void add_fixed(const scene::Matrix& to_world);
  void add_moving(const scene::Matrix& inner, const motion::Track& track, const Bounds& group);

  Deformations deformations_;
  motion::PoseTable poses_;
  std::vector<float> fixed_;
  std::vector<int32_t> moving_;  // by instance: its number in poses_, -1 where it does not move
  std::vector<int32_t> keeps_angles_;
};

// The box around everything that rays can meet, instances wherever they get to included;
// lower > upper if there is nothing.
Bounds bounds_of(const Primitives& primitives, const Placements& placements);

}  // namespace metrofarm::geometry
