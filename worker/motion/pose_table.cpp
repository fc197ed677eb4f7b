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
  Matrix whole = {};  // M
  Linear upper = {};  // S
  Quaternion rotation = {0, 0, 0, 1};
  Point offset = {0, 0, 0};
};

Point column(const Linear& m, size_t i) {
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
  for (size_t i = 0; i < 3; ++i) {
    q[i] = column(linear, i);
    for (size_t j = 0; j < i; ++j) {
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
  step.whole = m;
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

Matrix mixed(const Matrix& a, const Matrix& b, double t) {
  Matrix m;
  for (size_t i = 0; i < m.size(); ++i) m[i] = (1 - t) * a[i] + t * b[i];
  return m;
}

// What a motion is made steps of.
class Sampled {
 public:
  // size: 0 of viewpoints.
  Sampled(const Track& track, const Matrix& inner, const Interval& interval, double reach,
          double size)
      : track_(track), inner_(inner), interval_(interval), reach_(reach) {
    // Keys, and times at no regular distance: those of a motion that repeats itself must not hit
    // the same phase each time.
    for (double time : track.key_times()) {
      const double share = (time - interval.begin) / interval.length();
      if (share > 0 && share < 1) shares_.push_back(share);
    }
    constexpr int kLooks = 96;
    constexpr double kGolden = 0.6180339887498949;
    for (int i = 1; i <= kLooks; ++i) shares_.push_back(std::fmod(i * kGolden, 1.0));
    const double own = size > 0 ? std::max(size, 1e-3 * reach) : reach;
    turned_size_ = positive_or_one(largest_entry(at(0)) * own);
    moved_size_ = size > 0 ? turned_size_ : positive_or_one(length_of_way());
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

  // Largest deviation of points within reach, relative; gives up beyond `most`.
  double deviation(const std::vector<Step>& steps, bool arcs, double most) const {
    double worst = 0;
    for (size_t i = 0; i < shares_.size() && worst <= most; ++i)
      worst = std::max(worst, deviation_at(steps, arcs, shares_[i]));
    // In the middle of steps, where it is largest between keys.
    const auto segments = static_cast<int>(steps.size()) - 1;
    for (int i = 0; i < segments && worst <= most; ++i)
      worst = std::max(worst, deviation_at(steps, arcs, (i + 0.5) / segments));
    return worst;
  }

  double turning() const { return track_.turning_during(interval_); }

 private:
  static double positive_or_one(double v) { return v > 0 ? v : 1; }

  static double largest_entry(const Matrix& m) {
    double largest = 0;
    for (int i = 0; i < 12; ++i)
      if (i % 4 != 3) largest = std::max(largest, std::fabs(m[i]));
    return largest;
  }

  // How far it gets from where it begins.
  double length_of_way() const {
    const Matrix begin = at(0);
    double longest = 0;
    for (double share : shares_) {
      const Matrix m = at(share);
      longest = std::max(longest, std::hypot(m[3] - begin[3], m[7] - begin[7], m[11] - begin[11]));
    }
    return longest;
  }

  Matrix at(double share) const {
    return multiply(track_.at(interval_.begin + share * interval_.length()), inner_);
  }

  double deviation_at(const std::vector<Step>& steps, bool arcs, double share) const {
    const auto segments = static_cast<double>(steps.size() - 1);
    const auto i = static_cast<size_t>(std::min(share * segments, segments - 1));
    const double t = share * segments - static_cast<double>(i);
    const Matrix found =
        arcs ? between(steps[i], steps[i + 1], t) : mixed(steps[i].whole, steps[i + 1].whole, t);
    const double far = deviation_between(at(share), found);
    return std::isnan(far) ? std::numeric_limits<double>::infinity() : far;
  }

  double deviation_between(const Matrix& a, const Matrix& b) const {
    double turned = 0, moved = 0;
    for (int i = 0; i < 12; ++i) (i % 4 == 3 ? moved : turned) += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(turned) * reach_ / turned_size_ + std::sqrt(moved) / moved_size_;
  }

  const Track& track_;
  const Matrix& inner_;
  const Interval& interval_;
  double reach_;
  double turned_size_, moved_size_;  // what deviations are relative to
  std::vector<double> shares_;       // of the interval, at which deviations are looked at
};

// Few enough to try them all, with as many divisors as there is room for: keys at equal distances
// then lie on steps. Embree has 129 steps at most.
constexpr int kSegments[] = {1,  2,  3,  4,  5,  6,  7,   8,   9,   10,  11,  12,  13,  14, 15,
                             16, 17, 18, 19, 20, 21, 22,  23,  24,  25,  26,  27,  28,  29, 30,
                             31, 32, 35, 36, 40, 42, 45,  48,  50,  54,  56,  60,  63,  64, 70,
                             72, 80, 84, 90, 96, 99, 100, 108, 112, 120, 125, 126, 127, 128};

// Rays meet linear matrices in less time, up to about this many.
constexpr int kMostStraight = 32;
// Embree goes along arcs faster than accurately where a step turns by much.
constexpr double kLargestHalfAngle = 0.06;  // 7 degrees
constexpr double kTolerance = 1e-4;

double largest_half_angle(const std::vector<Step>& steps) {
  double largest = 0;
  for (size_t i = 1; i < steps.size(); ++i)
    largest = std::max(largest, half_angle_between(steps[i - 1].rotation, steps[i].rotation));
  return largest;
}

struct Steps {
  std::vector<Step> steps;
  bool arcs = false;
  double deviation = 0;
};

// A step of more than half a turn would go the other way round: those of much less are tried first.
constexpr double kMostTurning = std::numbers::pi / 4;

// The fewest steps that follow the motion, or those that follow it best.
Steps fewest_steps(const Sampled& motion) {
  const double fewest =
      std::min(motion.turning() / kMostTurning, double(kSegments[std::size(kSegments) - 1]));
  for (int segments : kSegments) {
    if (segments > kMostStraight) break;
    if (segments < fewest) continue;
    std::vector<Step> steps = motion.steps(segments);
    const double deviation = motion.deviation(steps, false, kTolerance);
    if (deviation <= kTolerance) return {std::move(steps), false, deviation};
  }
  std::vector<Step> best;
  double least = std::numeric_limits<double>::infinity();
  for (int segments : kSegments) {
    if (segments < fewest) continue;
    std::vector<Step> steps = motion.steps(segments);
    const double deviation = motion.deviation(steps, true, std::max(least, kTolerance));
    if (deviation >= least && deviation > kTolerance && !best.empty()) continue;
    least = std::min(least, deviation);
    const bool smooth = largest_half_angle(steps) <= kLargestHalfAngle;
    best = std::move(steps);
    if (deviation <= kTolerance && smooth) break;
  }
  return {std::move(best), true, least};
}

StepPose rounded(const Step& s, const Step& next, bool arcs) {
  StepPose p{};
  const auto set = [](float& to, double value) { to = static_cast<float>(value); };
  for (int k = 0; k < 3; ++k) set(p.offset[k], s.offset[k]);
  if (!arcs) {
    for (int k = 0; k < 9; ++k) set(p.form[k], s.whole[4 * (k % 3) + k / 3]);
    return p;
  }
  for (size_t k = 0; k < 3; ++k) set(p.form[k], s.upper[4 * k]);
  set(p.form[3], s.upper[1]);
  set(p.form[4], s.upper[2]);
  set(p.form[5], s.upper[5]);
  for (int k = 0; k < 4; ++k) set(p.form[6 + k], s.rotation[k]);
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

// A row and the next, and how far lanes are from the one to the other.
struct RowPair {
  const float* table;
  Int base;
  Float s, t;  // 1 - t
  Mask lanes;

  Float here(int k) const { return gather(table + k, base, lanes); }
  Float next(int k) const { return gather(table + kStepStride + k, base, lanes); }
  Float mixed(int k) const { return here(k) * s + next(k) * t; }
  Vec3 mixed3(int k) const { return {mixed(k), mixed(k + 1), mixed(k + 2)}; }
};

constexpr int kOffset = 10, kHalfAngle = 13, kPerSine = 14;  // columns of a row

void set_linear(const RowPair& row, LanePose& pose) {
  for (int k = 0; k < 3; ++k) pose.column[k] = row.mixed3(3 * k);
}

void set_turned(const RowPair& row, LanePose& pose) {
  const Float per_sine = row.here(kPerSine), angle = row.here(kHalfAngle);
  const Mask turns = per_sine != Float(0.F);
  const Float ws = select(turns, sine(row.s * angle) * per_sine, row.s);
  const Float wt = select(turns, sine(row.t * angle) * per_sine, row.t);
  const auto turned = [&](int k) { return row.here(k) * ws + row.next(k) * wt; };
  const Float x = turned(6), y = turned(7), z = turned(8), w = turned(9);
  const Float two = Float(2.F) / (x * x + y * y + z * z + w * w);
  const Float one(1.F);
  const Vec3 r0 = {one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)};
  const Vec3 r1 = {two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)};
  const Vec3 r2 = {two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)};
  pose.column[0] = r0 * row.mixed(0);
  pose.column[1] = r0 * row.mixed(3) + r1 * row.mixed(1);
  pose.column[2] = r0 * row.mixed(4) + r1 * row.mixed(5) + r2 * row.mixed(2);
}

}  // namespace

int32_t PoseTable::add(const Track& track, const Matrix& inner, double reach, double size) {
  const double least = 1e-30;  // a single point has a place, but is no viewpoint
  return append(track, inner, reach, std::max(size, least));
}

int32_t PoseTable::add_viewpoint(const Track& track, const Matrix& inner, double radius) {
  return append(track, inner, radius, 0);
}

int32_t PoseTable::append(const Track& track, const Matrix& inner, double reach, double size) {
  const auto [steps, arcs, deviation] = fewest_steps({track, inner, interval_, reach, size});
  const auto number = static_cast<int32_t>(count());
  first_.push_back(static_cast<int32_t>(rows_.size()));
  for (size_t i = 0; i < steps.size(); ++i)
    rows_.push_back(rounded(steps[i], steps[std::min(i + 1, steps.size() - 1)], arcs));
  last_.push_back(static_cast<int32_t>(rows_.size()) - 1);
  arcs_.push_back(arcs ? 1 : 0);
  deviation_.push_back(deviation);
  any_arcs_ = any_arcs_ || arcs;
  any_straight_ = any_straight_ || !arcs;
  return number;
}

LanePose PoseTable::at(Int number, Float time, Mask lanes) const {
  const Int first = gather(first_.data(), number, lanes);
  const Int segments = gather(last_.data(), number, lanes) - first;
  const Float place = time * to_float(segments);
  const Int segment = xsimd::min(truncate(place), segments - Int(1));
  const Float t = place - to_float(segment);
  const RowPair row = {reinterpret_cast<const float*>(rows_.data()),
                       (first + segment) * Int(kStepStride), Float(1.F) - t, t, lanes};
  LanePose pose;
  pose.offset = row.mixed3(kOffset);
  if (!any_arcs_) {
    set_linear(row, pose);
  } else if (!any_straight_) {
    set_turned(row, pose);
  } else {
    const Mask arcs = equal(gather(arcs_.data(), number, lanes), Int(1));
    LanePose turned;
    set_linear(row, pose);
    set_turned(row, turned);
    for (int k = 0; k < 3; ++k) pose.column[k] = select(arcs, turned.column[k], pose.column[k]);
  }
  return pose;
}

LaneInverse inverse_of(const LanePose& pose) {
  const Vec3 x = cross(pose.column[1], pose.column[2]);
  const Vec3 y = cross(pose.column[2], pose.column[0]);
  const Vec3 z = cross(pose.column[0], pose.column[1]);
  const Float inverse = Float(1.F) / dot(pose.column[0], x);
  return {{x * inverse, y * inverse, z * inverse}};
}

}  // namespace metrofarm::motion
