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
// then lie on steps. Beyond these a step of each motion would outweigh most of what moves.
constexpr int kSegments[] = {1,  2,  3,  4,  5,  6,  7,   8,   9,   10,  11,  12,  13,  14, 15,
                             16, 17, 18, 19, 20, 21, 22,  23,  24,  25,  26,  27,  28,  29, 30,
                             31, 32, 35, 36, 40, 42, 45,  48,  50,  54,  56,  60,  63,  64, 70,
                             72, 80, 84, 90, 96, 99, 100, 108, 112, 120, 125, 126, 127, 128};

// Matrices take less time than arcs; beyond this many they are not worth their memory.
constexpr int kMostStraight = 32;
constexpr double kTolerance = 1e-4;
// A half angle that rounding may leave.
constexpr double kNoTurn = 1e-6;

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
    best = std::move(steps);
    if (deviation <= kTolerance) break;
  }
  // What does not turn is linear in between in both forms.
  const bool arcs = largest_half_angle(best) > kNoTurn;
  return {std::move(best), arcs, least};
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
  if (angle > kNoTurn) {
    set(p.half_angle, angle);
    set(p.per_sine, 1 / std::sin(angle));
  }
  return p;
}

float select(bool which, float a, float b) {
  return which ? a : b;
}

// Numbers are floats or Floats, a row is a table's row and the next one.

// sin x for 0 <= x <= pi / 2, by its series.
template <class Number>
Number sine(Number x) {
  const Number x2 = x * x;
  Number sum(-1.F / 39916800);
  for (float c : {1.F / 362880, -1.F / 5040, 1.F / 120, -1.F / 6, 1.F}) sum = sum * x2 + Number(c);
  return sum * x;
}

// In lanes.
struct LaneRows {
  const float* table;
  Int base;
  Mask lanes;

  Float here(int k) const { return gather(table + k, base, lanes); }
  Float next(int k) const { return gather(table + kStepStride + k, base, lanes); }
};

struct OneRow {
  const float* row;

  float here(int k) const { return row[k]; }
  float next(int k) const { return row[kStepStride + k]; }
};

// How far it is from the row to the next.
template <class Number>
struct Share {
  Number s, t;  // 1 - t
};

constexpr int kOffset = 10, kHalfAngle = 13, kPerSine = 14;  // columns of a row

// Values one after the other in rows, linear in between.
template <class Number, class Row>
void mix(const Row& row, Share<Number> at, int first, int count, Number* out) {
  for (int k = 0; k < count; ++k) out[k] = row.here(first + k) * at.s + row.next(first + k) * at.t;
}

// The columns of T R S's linear part.
template <class Number, class Row>
void turn(const Row& row, Share<Number> at, Number linear[9]) {
  const Number per_sine = row.here(kPerSine), angle = row.here(kHalfAngle);
  const auto turns = per_sine != Number(0.F);
  const Number ws = select(turns, sine(at.s * angle) * per_sine, at.s);
  const Number wt = select(turns, sine(at.t * angle) * per_sine, at.t);
  Number q[4], upper[6];
  for (int k = 0; k < 4; ++k) q[k] = row.here(6 + k) * ws + row.next(6 + k) * wt;
  mix(row, at, 0, 6, upper);
  const auto& [x, y, z, w] = q;
  const Number two = Number(2.F) / (x * x + y * y + z * z + w * w);
  const Number one(1.F);
  const Number r[3][3] = {
      {one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)},
      {two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)},
      {two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)}};
  for (int k = 0; k < 3; ++k) {
    linear[k] = r[0][k] * upper[0];
    linear[3 + k] = r[0][k] * upper[3] + r[1][k] * upper[1];
    linear[6 + k] = r[0][k] * upper[4] + r[1][k] * upper[5] + r[2][k] * upper[2];
  }
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
  const Share<Float> share = {Float(1.F) - t, t};
  const LaneRows row = {reinterpret_cast<const float*>(rows_.data()),
                        (first + segment) * Int(kStepStride), lanes};
  Float linear[9], offset[3];
  mix(row, share, kOffset, 3, offset);
  if (!any_arcs_) {
    mix(row, share, 0, 9, linear);
  } else {
    turn(row, share, linear);
    if (any_straight_) {
      const Mask arcs = equal(gather(arcs_.data(), number, lanes), Int(1));
      Float straight[9];
      mix(row, share, 0, 9, straight);
      for (int k = 0; k < 9; ++k) linear[k] = select(arcs, linear[k], straight[k]);
    }
  }
  const auto vector = [](const Float v[3]) { return Vec3{v[0], v[1], v[2]}; };
  return {{vector(linear), vector(linear + 3), vector(linear + 6)}, vector(offset)};
}

Pose PoseTable::pose(size_t number, float time) const {
  const int first = first_[number];
  const int segments = last_[number] - first;
  const float place = time * static_cast<float>(segments);
  const int segment = std::min(static_cast<int>(place), segments - 1);
  const float t = place - static_cast<float>(segment);
  const Share<float> share = {1 - t, t};
  const OneRow row = {rows_[static_cast<size_t>(first) + static_cast<size_t>(segment)].form};
  Pose pose;
  if (arcs_[number] != 0) {
    turn(row, share, pose.linear);
  } else {
    mix(row, share, 0, 9, pose.linear);
  }
  mix(row, share, kOffset, 3, pose.offset);
  return pose;
}

int PoseTable::parts(size_t number) const {
  constexpr double kLargest = 0.06;  // 7 degrees of rotation
  double largest = 0;
  for (int i = first_[number]; i < last_[number]; ++i)
    largest = std::max(largest, double(rows_[static_cast<size_t>(i)].half_angle));
  return std::max(1, static_cast<int>(std::ceil(largest / kLargest)));
}

// Half of the largest acceleration over a quarter of the time: of R q, where R turns at constant
// speed and q is linear, that is at most w^2 |q| + 2 w |q'|.
double PoseTable::bulge(size_t number, int segment, int parts, double reach) const {
  const StepPose* step = &rows_[static_cast<size_t>(first_[number]) + static_cast<size_t>(segment)];
  if (arcs_[number] == 0) return 0;
  double stretch = 0, change = 0;
  for (int k = 0; k < 6; ++k) {
    const double here = step[0].form[k], next = step[1].form[k];
    stretch = std::hypot(stretch, std::max(std::fabs(here), std::fabs(next)));
    change = std::hypot(change, next - here);
  }
  const double angle = 2 * static_cast<double>(step[0].half_angle);
  return (angle * angle * stretch + 2 * angle * change) * reach / (8.0 * parts * parts);
}

LaneInverse inverse_of(const LanePose& pose) {
  const Vec3 x = cross(pose.column[1], pose.column[2]);
  const Vec3 y = cross(pose.column[2], pose.column[0]);
  const Vec3 z = cross(pose.column[0], pose.column[1]);
  const Float inverse = Float(1.F) / dot(pose.column[0], x);
  return {{x * inverse, y * inverse, z * inverse}};
}

}  // namespace metrofarm::motion
