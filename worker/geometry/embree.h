// The one place that knows which major version of Embree the build found (3 or 4).
#pragma once

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include "motion/pose_table.h"

namespace metrofarm::embree {

// M = T R S with S = (scale_x skew_xy skew_xz; 0 scale_y skew_yz; 0 0 scale_z).
inline RTCQuaternionDecomposition quaternion_decomposition(const motion::StepPose& s) {
  RTCQuaternionDecomposition q;
  rtcInitQuaternionDecomposition(&q);
  rtcQuaternionDecompositionSetScale(&q, s.scale[0], s.scale[1], s.scale[2]);
  rtcQuaternionDecompositionSetSkew(&q, s.skew[0], s.skew[1], s.skew[2]);
  rtcQuaternionDecompositionSetQuaternion(&q, s.rotation[3], s.rotation[0], s.rotation[1],
                                          s.rotation[2]);
  rtcQuaternionDecompositionSetTranslation(&q, s.offset[0], s.offset[1], s.offset[2]);
  return q;
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
