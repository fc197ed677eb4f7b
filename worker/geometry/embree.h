// The one place that knows which major version of Embree the build found (3 or 4).
#pragma once

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <array>

#include "motion/pose_table.h"

namespace metrofarm::embree {

// Of a motion with arcs: M = T R S with S = (scale_x skew_xy skew_xz; 0 scale_y skew_yz; 0 0
// scale_z).
inline RTCQuaternionDecomposition quaternion_decomposition(const motion::StepPose& s) {
  RTCQuaternionDecomposition q;
  rtcInitQuaternionDecomposition(&q);
  const float* f = s.form;
  rtcQuaternionDecompositionSetScale(&q, f[0], f[1], f[2]);
  rtcQuaternionDecompositionSetSkew(&q, f[3], f[4], f[5]);
  rtcQuaternionDecompositionSetQuaternion(&q, f[9], f[6], f[7], f[8]);
  rtcQuaternionDecompositionSetTranslation(&q, s.offset[0], s.offset[1], s.offset[2]);
  return q;
}

// Of a straight motion.
inline std::array<float, 12> matrix_columns(const motion::StepPose& s) {
  std::array<float, 12> m;
  for (int i = 0; i < 9; ++i) m[i] = s.form[i];
  for (int i = 0; i < 3; ++i) m[9 + i] = s.offset[i];
  return m;
}

inline void intersect8(const int* valid, RTCScene scene, RTCRayHit8* rays) {
#if RTC_VERSION_MAJOR >= 4
  rtcIntersect8(valid, scene, rays, nullptr);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect8(valid, scene, &context, rays);
#endif
}

inline void occluded8(const int* valid, RTCScene scene, RTCRay8* rays) {
#if RTC_VERSION_MAJOR >= 4
  rtcOccluded8(valid, scene, rays, nullptr);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded8(valid, scene, &context, rays);
#endif
}

}  // namespace metrofarm::embree
