// Rays against the scene's primitives, eight at a time.
//
// A packet's result depends on its eight rays only, but where two surfaces coincide it may depend
// on which rays travel together. Callers that promise reproducible bits keep packets composed
// alike.
#pragma once

#include <functional>
#include <memory>
#include <string_view>

#include "geometry/primitives.h"

namespace metrofarm::geometry {

struct RayHits {
  Mask hit;
  Float t;        // distance along the (not necessarily unit) direction
  Float u, v;     // barycentric coordinates b1, b2 on triangles
  Int primitive;  // valid where hit
  Int instance;   // index into the description's instances, -1 outside groups; valid where hit
};

class Tracer {
 public:
  static constexpr uint64_t kAnyBytes = ~uint64_t{0};

  // isa: Embree's instruction set, part of what decides the bits ("avx2").
  // Throws std::bad_alloc if Embree needs more than max_bytes or there is no memory.
  Tracer(const Primitives& primitives, std::string_view isa, uint64_t max_bytes = kAnyBytes);
  ~Tracer();
  Tracer(const Tracer&) = delete;
  Tracer& operator=(const Tracer&) = delete;

  // Nearest hit with t > 0 in each active lane. Thread-safe.
  RayHits intersect(Mask active, const Vec3& origin, const Vec3& direction) const;
  // Lanes in which something is hit with 0 < t < t_max. Thread-safe.
  Mask occluded(Mask active, const Vec3& origin, const Vec3& direction, Float t_max) const;

  // Bytes that Embree holds.
  uint64_t bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace metrofarm::geometry
