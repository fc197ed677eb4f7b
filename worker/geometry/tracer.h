// Rays against the scene's primitives, eight at a time.
//
// A packet's result depends on its eight rays only, but where two surfaces coincide it may depend
// on which rays travel together. Callers that promise reproducible bits keep packets composed
// alike.
#pragma once

#include <functional>
#include <memory>
#include <string_view>

#include "geometry/placements.h"
#include "geometry/primitives.h"

namespace metrofarm::geometry {

struct RayHits {
  Mask hit;
  Float t;                  // distance along the (not necessarily unit) direction
  Float u, v;               // barycentric coordinates b1, b2 on triangles
  Int primitive;            // valid where hit
  Int instance;             // index into Primitives::instances, -1 outside groups; valid where hit
  Float time = Float(0.F);  // of the ray, see Tracer
};

class Tracer {
 public:
  // isa: Embree's instruction set, part of what decides the bits ("avx2").
  // Throws std::bad_alloc if Embree needs more than max_bytes or there is no memory.
  // primitives, placements: outlive this.
  Tracer(const Primitives& primitives, const Placements& placements, std::string_view isa,
         uint64_t max_bytes = kAnyBytes);
  ~Tracer();
  Tracer(const Tracer&) = delete;
  Tracer& operator=(const Tracer&) = delete;

  // Times are in [0, 1], from the begin to the end of the interval of the placements.

  // Nearest hit with t > 0 in each active lane. Thread-safe.
  RayHits intersect(Mask active, const Vec3& origin, const Vec3& direction,
                    Float time = Float(0.F)) const;
  // Lanes in which something is hit with 0 < t < t_max. Thread-safe.
  Mask occluded(Mask active, const Vec3& origin, const Vec3& direction, Float t_max,
                Float time = Float(0.F)) const;

  // Bytes that Embree holds.
  uint64_t bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace metrofarm::geometry
