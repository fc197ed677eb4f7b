// Poses of what moves while a shutter is open, for eight lanes at times of their own.
//
// Each motion is kept as poses at equal distances in time, from the interval's begin to its end, in
// one of two forms: matrices, linear in between, where few of them follow the motion; else T R S
// with a quaternion R and an upper triangular S, where R goes along the arc and the rest is linear.
// Rays and shading know nothing but these, so that surfaces are shaded where rays have met them.
#pragma once

#include <cstdint>
#include <vector>

#include "math/vec.h"
#include "motion/track.h"

namespace metrofarm::motion {

// A map to the world in each lane.
struct LanePose {
  Vec3 column[3];  // of the linear part
  Vec3 offset;

  Vec3 vector(const Vec3& v) const { return column[0] * v.x + column[1] * v.y + column[2] * v.z; }
  Vec3 point(const Vec3& p) const { return vector(p) + offset; }
  Float determinant() const { return dot(column[0], cross(column[1], column[2])); }
};

// Its inverse and what maps normals.
struct LaneInverse {
  Vec3 row[3];  // of the inverse linear part; the columns of its transpose, which maps normals

  Vec3 vector(const Vec3& v) const { return {dot(row[0], v), dot(row[1], v), dot(row[2], v)}; }
  Vec3 normal(const Vec3& n) const { return row[0] * n.x + row[1] * n.y + row[2] * n.z; }
};
LaneInverse inverse_of(const LanePose& pose);

// A map to the world.
struct Pose {
  float linear[9];  // the columns of its linear part, one after the other
  float offset[3];
};

// A pose as the table has it.
struct StepPose {
  // Of straight motions: the columns of the linear part. Of those with arcs: three scales, the
  // skews of y on x, z on x, z on y, and the quaternion x y z w.
  float form[10];
  float offset[3];
  float half_angle;  // of the rotation to the next step, radians; 0 of straight motions
  float per_sine;    // 1 / sin of it, 0 where there is no rotation
  float unused;
};
inline constexpr int kStepStride = 16;
static_assert(sizeof(StepPose) == kStepStride * sizeof(float));

class PoseTable {
 public:
  explicit PoseTable(const Interval& interval) : interval_(interval) {}

  // Adds the pose track.at() * inner and returns its number. reach: how far from the origin of its
  // space there is something that moves; size: of that. Deviations from the track are kept small
  // relative to the size, as far as there can be steps enough.
  int32_t add(const Track& track, const Matrix& inner, double reach, double size);
  // The same for a camera or a light without extent in a scene of that radius: its way is followed
  // relative to what it is long, its turning to what it does at the radius.
  int32_t add_viewpoint(const Track& track, const Matrix& inner, double radius);

  size_t count() const { return first_.size(); }
  const Interval& interval() const { return interval_; }
  // time: in [0, 1], from the interval's begin to its end. Requires: number < count() in lanes.
  LanePose at(Int number, Float time, Mask lanes) const;
  // The same for one of them.
  Pose pose(size_t number, float time) const;
  // Into how many parts each way from step to step is cut so that all of them are nearly straight.
  int parts(size_t number) const;
  // How far a point gets from the straight line between where it is at both ends of such a part, at
  // most. segment: the first of the steps. reach: of the point, in the space of what moves.
  double bulge(size_t number, int segment, int parts, double reach) const;
  int step_count(size_t number) const { return last_[number] - first_[number] + 1; }
  // How far from the track the steps are at worst, as far as has been looked; relative, see add().
  double deviation(size_t number) const { return deviation_[number]; }

  uint64_t bytes() const {
    return rows_.capacity() * sizeof(StepPose) +
           (first_.capacity() + last_.capacity() + arcs_.capacity()) * sizeof(int32_t) +
           deviation_.capacity() * sizeof(double);
  }

 private:
  int32_t append(const Track& track, const Matrix& inner, double reach, double size);

  Interval interval_;
  std::vector<StepPose> rows_;
  std::vector<int32_t> first_, last_;  // rows of each motion
  std::vector<int32_t> arcs_;          // 1 of motions with arcs
  std::vector<double> deviation_;
  bool any_arcs_ = false, any_straight_ = false;
};

}  // namespace metrofarm::motion
