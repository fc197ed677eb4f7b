// Poses between the keys of a motion.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "motion/pose.h"

namespace metrofarm::motion {

// A time, in seconds, from `begin` to `end`.
struct Interval {
  double begin = 0;
  double end = 0;
  double length() const { return end - begin; }
  friend bool operator==(const Interval&, const Interval&) = default;
};

// Whether the poses turn left hands into right ones; all keys of a motion do or none does.
bool mirrors(const scene::Motion& motion);

// The pose at a time: exactly the first key's before the first, a key's at its time, the last key's
// after the last. In between, each key is a stretch S (symmetric), then a rotation R (perhaps with
// a mirror), then a translation T. S goes linearly from key to key. T goes linearly, or along a
// cubic: between the control points that the keys give, or by Catmull and Rom's rule for unequal
// times, where a key's velocity is that of the parabola through it and its neighbours and the ends'
// that of the straight way.
//
// R turns at constant speed. From a key to the next it takes the shorter arc, unless both tell the
// same turns about the same axes in the same order, with one angle alone that differs: then it
// turns by all of that difference, however often that goes round.
class Track {
 public:
  // What is wrong with a motion, if anything is.
  static std::optional<std::string> problem_with(const scene::Motion& motion);

  // Whether from some key to the next an angle is told to change by more than half a turn, but the
  // shorter arc is taken all the same.
  static bool loses_turns(const scene::Motion& motion);

  // Requires: problem_with() finds nothing and there are keys.
  explicit Track(const scene::Motion& motion);

  Matrix at(double time) const;

  // The times between keys in which it does not stand still, in order, none touching another.
  std::vector<Interval> moving() const;
  // Never in an interval without length.
  bool moves_during(const Interval& interval) const;
  // By how much it turns in the interval, all of it added up, either way; radians.
  double turning_during(const Interval& interval) const;
  const std::vector<double>& key_times() const { return times_; }
  // Of the ways that are curved; not finite where keys are too close in time for their distance.
  std::vector<Point> control_points() const;

 private:
  struct Key {
    double time;
    Matrix to_world;
    Parts parts;
  };
  // From one key to the next.
  struct Segment {
    bool still = true;
    Point axis = {0, 0, 1};
    double angle = 0;  // radians, of the rotation that comes after the first key's
    bool straight = true;
    Point first_control = {}, second_control = {};  // of the translation, unless straight
  };

  void turn(const scene::Motion& motion);
  void bend(const scene::Motion& motion);

  std::vector<Key> keys_;
  std::vector<double> times_;  // of the keys
  std::vector<Segment> segments_;
};

}  // namespace metrofarm::motion
