// The one place that knows which major version of Embree the build found (3 or 4).
#pragma once

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace metrofarm::embree {

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
