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

#if RTC_VERSION_MAJOR >= 4
using Context = RTCRayQueryContext;
#else
using Context = RTCIntersectContext;
#endif

// ---- within the callbacks of user geometry that stands for another scene ----
// id: what is reported as the instance of its hits.

inline void intersect_instance(RTCScene scene, unsigned id, Context* context, RTCRayHit& ray) {
  context->instID[0] = id;
#if RTC_VERSION_MAJOR >= 4
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.context = context;
  rtcIntersect1(scene, &ray, &arguments);
#else
  rtcIntersect1(scene, context, &ray);
#endif
  context->instID[0] = RTC_INVALID_GEOMETRY_ID;
}

inline bool occluded_instance(RTCScene scene, unsigned id, Context* context, RTCRay& ray) {
  context->instID[0] = id;
#if RTC_VERSION_MAJOR >= 4
  RTCOccludedArguments arguments;
  rtcInitOccludedArguments(&arguments);
  arguments.context = context;
  rtcOccluded1(scene, &ray, &arguments);
#else
  rtcOccluded1(scene, context, &ray);
#endif
  context->instID[0] = RTC_INVALID_GEOMETRY_ID;
  return ray.tfar < 0;
}

}  // namespace metrofarm::embree
