// Instances that move, as user geometry of Embree.
//
// Embree's own instances that move have the box of the group's box under each pose, which is up to
// three times as large as that of what is in it, and turn whole packets for the one ray of it that
// gets there: they took 1.2 times the time per ray (worker/doc/decisions/0007-motion.md).
#pragma once

#include <vector>

#include "geometry/embree.h"
#include "geometry/hull.h"

namespace metrofarm::geometry {

// Ids of geometries in every scene; in the world's scene, instances follow.
inline constexpr unsigned kTriangleGeometry = 0;
inline constexpr unsigned kAnalyticGeometry = 1;
inline constexpr unsigned kFirstInstance = 2;
// Embree looks at no box of a root that is a leaf: every ray would be tested against the only shape
// of a tree. Where that costs, such a tree has this one more, a corner of the shape's box.
inline constexpr unsigned kWithCorner = 2;

// Embree keeps a pointer to it; what it is made of outlives it.
class MovingInstance {
 public:
  // instance: its number, of one that moves. id: what its hits are reported with as instance.
  // group: the scene that it shows, committed; null if that is a single analytic shape. hull: of
  // the group.
  MovingInstance(const Primitives& primitives, const Placements& placements, size_t instance,
                 unsigned id, RTCScene group, const Hull& hull)
      : primitives_(primitives),
        placements_(placements),
        instance_(instance),
        id_(id),
        group_(group),
        boxes_(boxes_over_time(hull, placements, instance)) {
    const PrimitiveRange& range =
        primitives.groups[static_cast<size_t>(primitives.instances[instance].group)];
    if (range.is_single_analytic()) only_analytic_ = range.first_analytic;
  }
  MovingInstance(const MovingInstance&) = delete;
  MovingInstance& operator=(const MovingInstance&) = delete;

  // The caller's to commit, attach and release. alone: whether nothing else of its scene moves.
  RTCGeometry geometry(RTCDevice device, bool alone);
  // What only building its scene takes.
  uint64_t bytes_of_boxes() const { return boxes_.size() * sizeof(Bounds); }
  void forget_boxes() { std::vector<Bounds>().swap(boxes_); }

 private:
  // A ray in the group's space, with the distances of the world's.
  void carry(RTCRayN* rays, unsigned i, RTCRay& ray) const;
  // Requires: only_analytic_. A distance, negative where there is none.
  double meet_analytic(const RTCRay& ray) const;
  void intersect(const RTCIntersectFunctionNArguments* args, unsigned i) const;
  void occluded(const RTCOccludedFunctionNArguments* args, unsigned i) const;

  static void bounds(const RTCBoundsFunctionArguments* args);
  static void intersect_all(const RTCIntersectFunctionNArguments* args);
  static void occluded_all(const RTCOccludedFunctionNArguments* args);

  const Primitives& primitives_;
  const Placements& placements_;
  size_t instance_;
  unsigned id_;
  RTCScene group_;
  int32_t only_analytic_ = -1;  // the only shape of the group, which needs no scene
  std::vector<Bounds> boxes_;
};

}  // namespace metrofarm::geometry
