#include "motion/pose_table.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace metrofarm::motion {
namespace {

using scene::determinant;

// A step in double precision: M = T R S.
struct Step {
  Linear upper = {};  // S
  Quaternion rotation = {0, 0, 0, 1};
  Point offset = {0, 0, 0};
};

Point column(const Linear& m, int i) {
  return {m[i], m[3 + i], m[6 + i]};
}

double dot(const Point& a, const Point& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Gram and Schmidt's orthogonalization; a mirror becomes part of S. Requires: m does not flatten.
Step take_apart(const Matrix& m) {
  const Linear linear = scene::linear_part(m);
  Point q[3];
  Step step;
  for (int i = 0; i < 3; ++i) {
    q[i] = column(linear, i);
    for (int j = 0; j < i; ++j) {
      const double along = dot(q[j], column(linear, i));
      step.upper[3 * j + i] = along;
      for (int k = 0; k < 3; ++k) q[i][k] -= along * q[j][k];
    }
    const double length = std::sqrt(dot(q[i], q[i]));
    step.upper[4 * i] = length;
    for (double& v : q[i]) v /= length;
  }
  if (determinant(linear) < 0) {
    step.upper[8] = -step.upper[8];
    for (double& v : q[2]) v = -v;
  }
  step.rotation = to_quaternion(
      {q[0][0], q[1][0], q[2][0], q[0][1], q[1][1], q[2][1], q[0][2], q[1][2], q[2][2]});
  step.offset = {m[3], m[7], m[11]};
  return step;
}

double half_angle_between(const Quaternion& a, const Quaternion& b) {
  double difference = 0, sum = 0;
  for (int i = 0; i < 4; ++i) {
    difference += (a[i] - b[i]) * (a[i] - b[i]);
    sum += (a[i] + b[i]) * (a[i] + b[i]);
  }
  return 2 * std::atan2(std::sqrt(difference), std::sqrt(sum));
}

Matrix between(const Step& a, const Step& b, double t) {
  const double angle = half_angle_between(a.rotation, b.rotation);
  const bool turns = angle > 1e-9;
  const double wa = turns ? std::sin((1 - t) * angle) / std::sin(angle) : 1 - t;
  const double wb = turns ? std::sin(t * angle) / std::sin(angle) : t;
  Step s;
  for (int i = 0; i < 4; ++i) s.rotation[i] = wa * a.rotation[i] + wb * b.rotation[i];
  for (int i = 0; i < 9; ++i) s.upper[i] = (1 - t) * a.upper[i] + t * b.upper[i];
  for (int i = 0; i < 3; ++i) s.offset[i] = (1 - t) * a.offset[i] + t * b.offset[i];
  return affine(multiply(to_linear(s.rotation), s.upper), s.offset);
}

// What a motion is made steps of.
class Sampled {
 public:
  Sampled(const Track& track, const Matrix& inner, const Interval& interval, double reach,
          double size)
      : track_(track), inner_(inner), interval_(interval), reach_(reach), size_(size) {
    double largest = 0;
    const Matrix m = at(0);
    for (int i = 0; i < 12; ++i) {
      if (i % 4 != 3) largest = std::max(largest, std::fabs(m[i]));
    }
    size_ = largest * std::max(size, 1e-3 * reach);
  }

  std::vector<Step> steps(int segments) const {
    std::vector<Step> out;
    for (int i = 0; i <= segments; ++i) {
      Step step = take_apart(at(static_cast<double>(i) / segments));
      if (i > 0 && half_angle_between(out.back().rotation, step.rotation) > std::numbers::pi / 2) {
        for (double& v : step.rotation) v = -v;
      }
      out.push_back(step);
    }
    return out;
  }

  // Largest deviation of points within reach, in sizes of what is moved; gives up beyond `most`.
  double deviation(const std::vector<Step>& steps, double most) const {
    const auto segments = static_cast<int>(steps.size()) - 1;
    double worst = 0;
    for (int i = 0; i < segments && worst < most; ++i) {
      for (double t : {0.25, 0.5, 0.75}) {
        const Matrix exact = at((i + t) / segments);
        worst = std::max(worst, distance(exact, between(steps[i], steps[i + 1], t)) / size_);
      }
    }
    return worst;
  }

 private:
  Matrix at(double share) const {
    return multiply(track_.at(interval_.begin + share * interval_.length()), inner_);
  }

  double distance(const Matrix& a, const Matrix& b) const {
    double turned = 0, moved = 0;
    for (int i = 0; i < 12; ++i) (i % 4 == 3 ? moved : turned) += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(turned) * reach_ + std::sqrt(moved);
  }

  const Track& track_;
  const Matrix& inner_;
  const Interval& interval_;
  double reach_;
  double size_;
};

// Few enough to try them all, with as many divisors as there is room for: keys at equal distances
// then lie on steps.
constexpr int kSegments[] = {1,  2,  3,  4,  5,  6,  7,  8,   9,   10,  11,  12, 13,
                             14, 15, 16, 18, 20, 24, 28, 30,  32,  36,  40,  48, 56,
                             60, 64, 72, 80, 84, 90, 96, 100, 108, 112, 120, 128};

// Embree interpolates faster than accurately where a step turns by much.
constexpr double kLargestHalfAngle = 0.06;  // 7 degrees
constexpr double kTolerance = 1e-5;

double largest_half_angle(const std::vector<Step>& steps) {
  double largest = 0;
  for (size_t i = 1; i < steps.size(); ++i)
    largest = std::max(largest, half_angle_between(steps[i - 1].rotation, steps[i].rotation));
  return largest;
}

// The fewest steps that follow the track, or those that follow it best.
std::vector<Step> fewest_steps(const Sampled& motion) {
  std::vector<Step> best;
  double least = std::numeric_limits<double>::infinity();
  for (int segments : kSegments) {
    std::vector<Step> steps = motion.steps(segments);
    const double deviation = motion.deviation(steps, least);
    if (deviation >= least && !(deviation <= kTolerance)) continue;
    least = deviation;
    const bool smooth = largest_half_angle(steps) <= kLargestHalfAngle;
    best = std::move(steps);
    if (deviation <= kTolerance && smooth) break;
  }
  return best;
}

StepPose rounded(const Step& s, const Step& next) {
  StepPose p{};
  const auto set = [](float& to, double value) { to = static_cast<float>(value); };
  for (int k = 0; k < 3; ++k) {
    set(p.scale[k], s.upper[4 * k]);
    set(p.offset[k], s.offset[k]);
  }
  set(p.skew[0], s.upper[1]);
  set(p.skew[1], s.upper[2]);
  set(p.skew[2], s.upper[5]);
  for (int k = 0; k < 4; ++k) set(p.rotation[k], s.rotation[k]);
  const double angle = half_angle_between(s.rotation, next.rotation);
  if (angle > 1e-6) {
    set(p.half_angle, angle);
    set(p.per_sine, 1 / std::sin(angle));
  }
  return p;
}

// sin x for 0 <= x <= pi / 2, by its series.
Float sine(Float x) {
  const Float x2 = x * x;
  Float sum(-1.F / 39916800);
  for (float c : {1.F / 362880, -1.F / 5040, 1.F / 120, -1.F / 6, 1.F}) sum = sum * x2 + Float(c);
  return sum * x;
}

}  // namespace

int32_t PoseTable::add(const Track& track, const Matrix& inner, double reach, double size) {
  const Sampled motion(track, inner, interval_, reach, size);
  const std::vector<Step> steps = fewest_steps(motion);
  const auto number = static_cast<int32_t>(count());
  first_.push_back(static_cast<int32_t>(rows_.size()));
  for (size_t i = 0; i < steps.size(); ++i)
    rows_.push_back(rounded(steps[i], steps[std::min(i + 1, steps.size() - 1)]));
  last_.push_back(static_cast<int32_t>(rows_.size()) - 1);
  return number;
}

LanePose PoseTable::at(Int number, Float time, Mask lanes) const {
  const Int first = gather(first_.data(), number, lanes);
  const Int segments = gather(last_.data(), number, lanes) - first;
  const Float place = time * to_float(segments);
  const Int segment = xsimd::min(truncate(place), segments - Int(1));
  const Float t = place - to_float(segment), s = Float(1.F) - t;
  const Int base = (first + segment) * Int(kStepStride);
  const auto* table = reinterpret_cast<const float*>(rows_.data());
  const auto here = [&](int k) { return gather(table + k, base, lanes); };
  const auto next = [&](int k) { return gather(table + kStepStride + k, base, lanes); };
  const auto mixed = [&](int k) { return here(k) * s + next(k) * t; };
  const Float per_sine = here(14);
  const Mask turns = per_sine != Float(0.F);
  const Float angle = here(13);
  const Float ws = select(turns, sine(s * angle) * per_sine, s);
  const Float wt = select(turns, sine(t * angle) * per_sine, t);
  const auto turned = [&](int k) { return here(k) * ws + next(k) * wt; };
  const Float x = turned(6), y = turned(7), z = turned(8), w = turned(9);
  const Float two = Float(2.F) / (x * x + y * y + z * z + w * w);
  const Float one(1.F);
  const Vec3 r0 = {one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)};
  const Vec3 r1 = {two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)};
  const Vec3 r2 = {two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)};
  return {
      {r0 * mixed(0), r0 * mixed(3) + r1 * mixed(1), r0 * mixed(4) + r1 * mixed(5) + r2 * mixed(2)},
      {mixed(10), mixed(11), mixed(12)}};
}

LaneInverse inverse_of(const LanePose& pose) {
  const Vec3 x = cross(pose.column[1], pose.column[2]);
  const Vec3 y = cross(pose.column[2], pose.column[0]);
  const Vec3 z = cross(pose.column[0], pose.column[1]);
  const Float inverse = Float(1.F) / dot(pose.column[0], x);
  return {{x * inverse, y * inverse, z * inverse}};
}

}  // namespace metrofarm::motion
