// Instances that move, as user geometry of Embree.
//
// Embree's own instances that move have the box of the group's box under each pose, which is up to
// three times as large as that of what is in it, and turn whole packets for the one ray of it that
// gets there: they took 1.2 times the time per ray (worker/doc/decisions/0007-motion.md).
#pragma once

#include <memory>
#include <vector>

#include "geometry/embree.h"
#include "geometry/hull.h"

namespace metrofarm::geometry {

// Ids of geometries in every scene; in the world's scene, instances follow.
inline constexpr unsigned kTriangleGeometry = 0;
inline constexpr unsigned kAnalyticGeometry = 1;
inline constexpr unsigned kFirstInstance = 2;

// Embree keeps a pointer to it; what it is made of outlives it.
class MovingInstance {
 public:
  // instance: its number, of one that moves. id: what its hits are reported with as instance.
  // group: the scene that it shows, committed.
  MovingInstance(const Primitives& primitives, const Placements& placements, size_t instance,
                 unsigned id, RTCScene group)
      : primitives_(primitives),
        placements_(placements),
        instance_(instance),
        id_(id),
        group_(group) {
    const PrimitiveRange& range =
        primitives.groups[static_cast<size_t>(primitives.instances[instance].group)];
    if (range.triangle_count == 0 && range.analytic_count == 1)
      only_analytic_ = range.first_analytic;
  }
  MovingInstance(const MovingInstance&) = delete;
  MovingInstance& operator=(const MovingInstance&) = delete;

  // Committed; the caller's to attach and release. hull: of the group. alone: whether nothing else
  // of its scene moves.
  RTCGeometry geometry(RTCDevice device, const Hull& hull, bool alone);
  // What only building its scene takes.
  void forget_boxes() { boxes_ = {}; }

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
