#include "motion/track.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/check.h"

namespace metrofarm::motion {
namespace {

using scene::Keyframe;
using scene::MotionPath;

double mix(double a, double b, double t) {
  return (1 - t) * a + t * b;
}

struct Arc {
  Point axis = {0, 0, 1};
  double angle = 0;  // radians
};

// Along the shorter way.
Arc shorter_arc(const Quaternion& from, const Quaternion& to) {
  const Quaternion q = multiply(to, conjugate(from));
  const double sine = std::hypot(q[0], q[1], q[2]);
  if (!(sine > 0)) return {};
  const double side = q[3] < 0 ? -1 : 1;
  return {{side * q[0] / sine, side * q[1] / sine, side * q[2] / sine},
          2 * std::atan2(sine, std::fabs(q[3]))};
}

// The arc by which the only angle that differs goes from key to key, if there is such an angle and
// the keys' poses agree that it is what turns them.
std::optional<Arc> told_arc(const Keyframe& a, const Keyframe& b, const Quaternion& from,
                            const Quaternion& to) {
  if (a.turns.empty() || a.turns.size() != b.turns.size()) return std::nullopt;
  const size_t none = a.turns.size();
  size_t differs = none;
  for (size_t i = 0; i < a.turns.size(); ++i) {
    if (a.turns[i].axis != b.turns[i].axis) return std::nullopt;
    if (a.turns[i].degrees == b.turns[i].degrees) continue;
    if (differs != none) return std::nullopt;
    differs = i;
  }
  if (differs == none) return std::nullopt;
  constexpr double kRadians = std::numbers::pi / 180;
  Quaternion after = {0, 0, 0, 1};
  for (size_t i = differs + 1; i < a.turns.size(); ++i)
    after = multiply(rotation_about(a.turns[i].axis, a.turns[i].degrees * kRadians), after);
  const Arc arc = {rotated(after, a.turns[differs].axis),
                   (b.turns[differs].degrees - a.turns[differs].degrees) * kRadians};
  const Quaternion end = multiply(rotation_about(arc.axis, arc.angle), from);
  double cosine = 0;
  for (int i = 0; i < 4; ++i) cosine += end[i] * to[i];
  constexpr double kAgreement = 1 - 1e-9;
  return std::fabs(cosine) > kAgreement ? std::optional(arc) : std::nullopt;
}

Point offset_of(const Keyframe& key) {
  return {key.to_world[3], key.to_world[7], key.to_world[11]};
}

// Slope of the path at key i, per second.
Point slope_at(const std::vector<Keyframe>& keys, size_t i) {
  const auto between = [&](size_t j) {
    const Point a = offset_of(keys[j]), b = offset_of(keys[j + 1]);
    const double h = keys[j + 1].time - keys[j].time;
    return Point{(b[0] - a[0]) / h, (b[1] - a[1]) / h, (b[2] - a[2]) / h};
  };
  if (i == 0) return between(0);
  if (i + 1 == keys.size()) return between(i - 1);
  const Point before = between(i - 1), after = between(i);
  const double h0 = keys[i].time - keys[i - 1].time, h1 = keys[i + 1].time - keys[i].time;
  Point slope;
  for (int k = 0; k < 3; ++k) slope[k] = mix(before[k], after[k], h0 / (h0 + h1));
  return slope;
}

bool mirrors(const Keyframe& key) {
  return scene::determinant(scene::linear_part(key.to_world)) < 0;
}

double bezier(double p0, double p1, double p2, double p3, double t) {
  const double s = 1 - t;
  return s * s * s * p0 + 3 * s * s * t * p1 + 3 * s * t * t * p2 + t * t * t * p3;
}

}  // namespace

bool mirrors(const scene::Motion& motion) {
  return !motion.empty() && mirrors(motion.keys[0]);
}

std::optional<std::string> Track::problem_with(const scene::Motion& motion) {
  for (const Keyframe& key : motion.keys)
    if (!decompose(key.to_world)) return "the transforms of what moves must not flatten it";
  for (const Keyframe& key : motion.keys)
    if (mirrors(key) != mirrors(motion.keys[0]))
      return "what moves must not be mirrored from one key to the next";
  return std::nullopt;
}

bool Track::loses_turns(const scene::Motion& motion) {
  const auto rotation = [](const Keyframe& key) { return decompose(key.to_world)->rotation; };
  for (size_t i = 0; i + 1 < motion.keys.size(); ++i) {
    const Keyframe &a = motion.keys[i], &b = motion.keys[i + 1];
    const auto degrees = [](const Keyframe& key, size_t k) {
      return k < key.turns.size() ? key.turns[k].degrees : 0;
    };
    bool large = false;
    for (size_t k = 0; k < std::max(a.turns.size(), b.turns.size()); ++k)
      large = large || std::fabs(degrees(a, k) - degrees(b, k)) > 180;
    if (large && !told_arc(a, b, rotation(a), rotation(b))) return true;
  }
  return false;
}

Track::Track(const scene::Motion& motion) {
  METROFARM_CHECK(!motion.keys.empty());
  for (const Keyframe& key : motion.keys) {
    const std::optional<Parts> parts = decompose(key.to_world);
    METROFARM_CHECK(parts.has_value());
    keys_.push_back({key.time, key.to_world, *parts});
    times_.push_back(key.time);
  }
  segments_.resize(keys_.size() - 1);
  turn(motion);
  if (motion.path != MotionPath::kLinear) bend(motion);
  for (size_t i = 0; i < segments_.size(); ++i) {
    Segment& s = segments_[i];
    s.still = s.angle == 0 && s.straight && keys_[i].to_world == keys_[i + 1].to_world;
  }
}

void Track::turn(const scene::Motion& motion) {
  for (size_t i = 0; i < segments_.size(); ++i) {
    // Equal numbers are no turn at all, whatever their quaternions have been rounded to.
    const bool alike =
        scene::linear_part(keys_[i].to_world) == scene::linear_part(keys_[i + 1].to_world);
    const Quaternion& from = keys_[i].parts.rotation;
    const Quaternion& to = keys_[i + 1].parts.rotation;
    const Arc shorter = alike ? Arc{} : shorter_arc(from, to);
    const Arc arc = told_arc(motion.keys[i], motion.keys[i + 1], from, to).value_or(shorter);
    segments_[i].axis = arc.axis;
    segments_[i].angle = arc.angle;
  }
}

void Track::bend(const scene::Motion& motion) {
  for (size_t i = 0; i < segments_.size(); ++i) {
    Segment& s = segments_[i];
    const Keyframe& a = motion.keys[i];
    const Keyframe& b = motion.keys[i + 1];
    s.first_control = a.out;
    s.second_control = b.in;
    if (motion.path == MotionPath::kCatmullRom) {
      const Point from = slope_at(motion.keys, i), to = slope_at(motion.keys, i + 1);
      const double third = (b.time - a.time) / 3;
      for (int k = 0; k < 3; ++k) {
        s.first_control[k] = offset_of(a)[k] + third * from[k];
        s.second_control[k] = offset_of(b)[k] - third * to[k];
      }
    }
    s.straight = offset_of(a) == offset_of(b) && s.first_control == offset_of(a) &&
                 s.second_control == offset_of(a);
  }
}

Matrix Track::at(double time) const {
  const auto after = std::upper_bound(keys_.begin(), keys_.end(), time,
                                      [](double t, const Key& key) { return t < key.time; });
  if (after == keys_.begin()) return after->to_world;
  const auto before = std::prev(after);
  if (after == keys_.end() || before->time == time) return before->to_world;
  const Segment& s = segments_[static_cast<size_t>(before - keys_.begin())];
  if (s.still) return before->to_world;
  const double t = (time - before->time) / (after->time - before->time);
  const Parts &a = before->parts, &b = after->parts;
  Parts pose = a;
  if (s.angle != 0) pose.rotation = multiply(rotation_about(s.axis, t * s.angle), a.rotation);
  for (size_t i = 0; i < 9; ++i) pose.stretch[i] = mix(a.stretch[i], b.stretch[i], t);
  for (size_t k = 0; k < 3; ++k) {
    pose.offset[k] =
        s.straight ? mix(a.offset[k], b.offset[k], t)
                   : bezier(a.offset[k], s.first_control[k], s.second_control[k], b.offset[k], t);
  }
  return compose(pose);
}

std::vector<Interval> Track::moving() const {
  std::vector<Interval> spans;
  for (size_t i = 0; i < segments_.size(); ++i) {
    if (segments_[i].still) continue;
    if (!spans.empty() && spans.back().end == keys_[i].time) {
      spans.back().end = keys_[i + 1].time;
    } else {
      spans.push_back({keys_[i].time, keys_[i + 1].time});
    }
  }
  return spans;
}

bool Track::moves_during(const Interval& interval) const {
  if (!(interval.length() > 0)) return false;
  const std::vector<Interval> spans = moving();
  return std::any_of(spans.begin(), spans.end(), [&](const Interval& span) {
    return span.begin < interval.end && span.end > interval.begin;
  });
}

std::vector<Point> Track::control_points() const {
  std::vector<Point> points;
  for (const Segment& s : segments_) {
    if (s.straight) continue;
    points.push_back(s.first_control);
    points.push_back(s.second_control);
  }
  return points;
}

double Track::turning_during(const Interval& interval) const {
  double sum = 0;
  for (size_t i = 0; i < segments_.size(); ++i) {
    const double begin = std::max(interval.begin, keys_[i].time);
    const double end = std::min(interval.end, keys_[i + 1].time);
    const double share = (end - begin) / (keys_[i + 1].time - keys_[i].time);
    if (share > 0) sum += share * std::fabs(segments_[i].angle);
  }
  return sum;
}

}  // namespace metrofarm::motion
