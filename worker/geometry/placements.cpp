#include "geometry/placements.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "scene/linear.h"

namespace metrofarm::geometry {
namespace {

constexpr int kNormalMatrix = 12;  // columns of a row of Placements::fixed_
constexpr int kOffsetFactor = 21;
constexpr int kOffsetShift = 22;

double largest_row(const scene::Linear& m) {
  double largest = 0;
  for (size_t r = 0; r < 3; ++r)
    largest =
        std::max(largest, std::fabs(m[3 * r]) + std::fabs(m[3 * r + 1]) + std::fabs(m[3 * r + 2]));
  return largest;
}

// By how much going to the group's space and back can spread rounding errors: the row norm of
// |M| |M^-1| (Skeel's condition number), which is up to 3 for rotations and covered by
// kOffsetScale that far.
double error_spread(const scene::Linear& m, const scene::Linear& normals) {
  scene::Linear product = {};
  for (int i = 0; i < 9; ++i) {
    for (int k = 0; k < 3; ++k)
      product[i] += std::fabs(m[3 * (i / 3) + k]) * std::fabs(normals[3 * (i % 3) + k]);
  }
  return std::max(1.0, largest_row(product) / 3);
}

// See Carrier.
struct OffsetTerms {
  double factor = 0, shift = 0;
};

OffsetTerms offset_terms(const scene::Matrix& m) {
  const scene::Linear linear = scene::linear_part(m);
  const double spread = error_spread(linear, scene::inverse_transpose(linear));
  const double far = std::max({std::fabs(m[3]), std::fabs(m[7]), std::fabs(m[11])});
  return {largest_row(linear) * spread, kOffsetScale * far * spread};
}

bool keeps_angles(const scene::Linear& m) {
  constexpr double kTolerance = 1e-5;
  const double size = std::pow(std::fabs(scene::determinant(m)), 2.0 / 3);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j <= i; ++j) {
      const double product = m[i] * m[j] + m[3 + i] * m[3 + j] + m[6 + i] * m[6 + j];
      if (std::fabs(product - (i == j ? size : 0)) > kTolerance * size) return false;
    }
  }
  return true;
}

scene::Matrix matrix_of(const motion::Pose& pose) {
  scene::Matrix m = {};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) m[4 * r + c] = pose.linear[3 * c + r];
    m[4 * r + 3] = pose.offset[r];
  }
  m[15] = 1;
  return m;
}

// From the origin, and across.
struct Extent {
  double reach = 0, size = 0;
};

Extent extent_of(const Bounds& box) {
  Extent e;
  if (!(box.upper[0] >= box.lower[0])) return {1, 1};
  for (int k = 0; k < 3; ++k) {
    e.reach = std::hypot(e.reach, std::max(std::fabs(box.lower[k]), std::fabs(box.upper[k])));
    e.size = std::hypot(e.size, double(box.upper[k]) - box.lower[k]);
  }
  return e;
}

}  // namespace

Placements::Placements(const scene::SceneDescription& description, const Primitives& primitives,
                       const motion::Interval& interval, uint64_t max_bytes)
    : deformations_(description.shapes, primitives, interval, max_bytes), poses_(interval) {
  std::vector<Bounds> groups;
  for (const PrimitiveRange& group : primitives.groups)
    groups.push_back(bounds_of(primitives, group));
  constexpr scene::Matrix kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (const InstanceRecord& record : primitives.instances) {
    const bool of_shape = record.shape != scene::kNone;
    const Bounds& box = groups[static_cast<size_t>(record.group)];
    if (of_shape) {
      add(kIdentity, description.shapes[record.shape].motion, box);
    } else {
      const scene::Instance& instance = description.instances[record.instance];
      add(instance.to_world, instance.motion, box);
    }
  }
}

void Placements::add(const scene::Matrix& inner, const scene::Motion& motion, const Bounds& group) {
  if (motion.empty()) return add_fixed(inner);
  const motion::Track track(motion);
  if (track.moves_during(poses_.interval())) return add_moving(inner, track, group);
  add_fixed(motion::multiply(track.at(poses_.interval().begin), inner));
}

void Placements::add_fixed(const scene::Matrix& m) {
  const size_t end = fixed_.size() + kStride;
  const scene::Linear linear = scene::linear_part(m);
  METROFARM_CHECK(scene::determinant(linear) != 0);
  const OffsetTerms offset = offset_terms(m);
  for (int i = 0; i < kNormalMatrix; ++i) fixed_.push_back(static_cast<float>(m[i]));
  for (double v : scene::inverse_transpose(linear)) fixed_.push_back(static_cast<float>(v));
  fixed_.push_back(static_cast<float>(offset.factor));
  fixed_.push_back(static_cast<float>(offset.shift));
  fixed_.resize(end, 0.F);
  moving_.push_back(-1);
  keeps_angles_.push_back(geometry::keeps_angles(linear) ? 1 : 0);
}

void Placements::add_moving(const scene::Matrix& inner, const motion::Track& track,
                            const Bounds& group) {
  const Extent extent = extent_of(group);
  const int32_t number = poses_.add(track, inner, extent.reach, extent.size);
  fixed_.resize(fixed_.size() + kStride, 0.F);
  moving_.push_back(number);
  // Between steps too: a shear may be at its worst there.
  OffsetTerms most;
  bool keeps = true;
  const int segments = poses_.step_count(static_cast<size_t>(number)) - 1;
  const int samples = 4 * segments * poses_.parts(static_cast<size_t>(number));
  for (int i = 0; i <= samples; ++i) {
    const float time = static_cast<float>(i) / static_cast<float>(samples);
    const scene::Matrix m = matrix_of(poses_.pose(static_cast<size_t>(number), time));
    const OffsetTerms offset = offset_terms(m);
    most.factor = std::max(most.factor, offset.factor);
    most.shift = std::max(most.shift, offset.shift);
    keeps = keeps && geometry::keeps_angles(scene::linear_part(m));
  }
  float* row = &fixed_[fixed_.size() - kStride];
  row[kOffsetFactor] = static_cast<float>(most.factor);
  row[kOffsetShift] = static_cast<float>(most.shift);
  keeps_angles_.push_back(keeps ? 1 : 0);
}

Carrier Placements::at(Int instance, Float time, Mask lanes) const {
  const Int base = instance * Int(kStride);
  const auto c = [&](int k) { return gather(fixed_.data() + k, base, lanes); };
  Carrier carrier;
  carrier.offset_factor = c(kOffsetFactor);
  carrier.offset_shift = c(kOffsetShift);
  const auto column = [&](int k, int stride) {
    return Vec3{c(k), c(k + stride), c(k + 2 * stride)};
  };
  for (int k = 0; k < 3; ++k) {
    carrier.pose.column[k] = column(k, 4);
    carrier.inverse.row[k] = column(kNormalMatrix + k, 3);
  }
  carrier.pose.offset = column(3, 4);
  if (poses_.count() == 0) return carrier;
  const Int number = gather(moving_.data(), instance, lanes);
  const Mask moving = lanes & less(Int(-1), number);
  if (none(moving)) return carrier;
  const motion::LanePose pose = poses_.at(number, time, moving);
  const motion::LaneInverse inverse = motion::inverse_of(pose);
  for (int k = 0; k < 3; ++k) {
    carrier.pose.column[k] = select(moving, pose.column[k], carrier.pose.column[k]);
    carrier.inverse.row[k] = select(moving, inverse.row[k], carrier.inverse.row[k]);
  }
  carrier.pose.offset = select(moving, pose.offset, carrier.pose.offset);
  return carrier;
}

bool Placements::stays(size_t instance) const {
  constexpr float kIdentity[] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  return !moves(instance) &&
         std::equal(std::begin(kIdentity), std::end(kIdentity), matrix(instance));
}

std::array<float, 12> Placements::matrix_at(size_t instance, float time) const {
  std::array<float, 12> out;
  if (moves(instance)) {
    const scene::Matrix m = matrix_of(pose(instance, time));
    for (size_t i = 0; i < out.size(); ++i) out[i] = static_cast<float>(m[i]);
  } else {
    std::copy_n(matrix(instance), out.size(), out.begin());
  }
  return out;
}

uint64_t Placements::bytes() const {
  return deformations_.bytes() + poses_.bytes() + fixed_.capacity() * sizeof(float) +
         (moving_.capacity() + keeps_angles_.capacity()) * sizeof(int32_t);
}

}  // namespace metrofarm::geometry
