#include "geometry/moving_instance.h"

#include <limits>

#include "geometry/analytic.h"

namespace metrofarm::geometry {
namespace {

struct Float3 {
  float x, y, z;
};

Float3 cross(const float a[3], const float b[3]) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

float dot(const Float3& a, const Float3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

unsigned lanes_of(const int* valid) {
  return static_cast<unsigned>(_mm256_movemask_ps(
      _mm256_castsi256_ps(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(valid)))));
}

const MovingInstance& instance_of(void* user_pointer) {
  return *static_cast<const MovingInstance*>(user_pointer);
}

}  // namespace

RTCGeometry MovingInstance::geometry(RTCDevice device, bool alone) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, alone ? kWithCorner : 1);
  rtcSetGeometryTimeStepCount(geometry, static_cast<unsigned>(boxes_.size()));
  rtcSetGeometryUserData(geometry, this);
  rtcSetGeometryBoundsFunction(geometry, bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry, intersect_all);
  rtcSetGeometryOccludedFunction(geometry, occluded_all);
  return geometry;
}

void MovingInstance::bounds(const RTCBoundsFunctionArguments* args) {
  const Bounds& b = instance_of(args->geometryUserPtr).boxes_[args->timeStep];
  const float* upper = args->primID == 0 ? b.upper : b.lower;
  *args->bounds_o = {b.lower[0], b.lower[1], b.lower[2], 0, upper[0], upper[1], upper[2], 0};
}

void MovingInstance::carry(RTCRayN* rays, unsigned i, RTCRay& ray) const {
  const float time = RTCRayN_time(rays, kLanes, i);
  const motion::Pose pose = placements_.pose(instance_, time);
  const float* a = pose.linear;
  const float* b = a + 3;
  const float* c = a + 6;
  const Float3 rows[3] = {cross(b, c), cross(c, a), cross(a, b)};
  const float inverse = 1 / dot(rows[0], {a[0], a[1], a[2]});
  const Float3 origin = {RTCRayN_org_x(rays, kLanes, i) - pose.offset[0],
                         RTCRayN_org_y(rays, kLanes, i) - pose.offset[1],
                         RTCRayN_org_z(rays, kLanes, i) - pose.offset[2]};
  const Float3 direction = {RTCRayN_dir_x(rays, kLanes, i), RTCRayN_dir_y(rays, kLanes, i),
                            RTCRayN_dir_z(rays, kLanes, i)};
  ray.org_x = dot(rows[0], origin) * inverse;
  ray.org_y = dot(rows[1], origin) * inverse;
  ray.org_z = dot(rows[2], origin) * inverse;
  ray.dir_x = dot(rows[0], direction) * inverse;
  ray.dir_y = dot(rows[1], direction) * inverse;
  ray.dir_z = dot(rows[2], direction) * inverse;
  ray.tnear = RTCRayN_tnear(rays, kLanes, i);
  ray.tfar = RTCRayN_tfar(rays, kLanes, i);
  ray.time = time;
  ray.mask = RTCRayN_mask(rays, kLanes, i);
  ray.id = 0;
  ray.flags = 0;
}

double MovingInstance::meet_analytic(const RTCRay& ray) const {
  const RaySegment segment = {
      {ray.org_x, ray.org_y, ray.org_z}, {ray.dir_x, ray.dir_y, ray.dir_z}, ray.tnear, ray.tfar};
  return intersect_analytic(primitives_, static_cast<uint32_t>(only_analytic_), segment);
}

void MovingInstance::intersect(const RTCIntersectFunctionNArguments* args, unsigned i) const {
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, kLanes);
  RTCHitN* hits = RTCRayHitN_HitN(args->rayhit, kLanes);
  RTCRayHit inner;
  carry(rays, i, inner.ray);
  inner.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  if (only_analytic_ >= 0) {
    const double t = meet_analytic(inner.ray);
    if (t < 0) return;
    inner.ray.tfar = static_cast<float>(t);
    inner.hit = {};
    inner.hit.geomID = kAnalyticGeometry;
  } else {
    embree::intersect_instance(group_, id_, args->context, inner);
  }
  if (inner.hit.geomID == RTC_INVALID_GEOMETRY_ID) return;
  RTCRayN_tfar(rays, kLanes, i) = inner.ray.tfar;
  RTCHitN_u(hits, kLanes, i) = inner.hit.u;
  RTCHitN_v(hits, kLanes, i) = inner.hit.v;
  RTCHitN_primID(hits, kLanes, i) = inner.hit.primID;
  RTCHitN_geomID(hits, kLanes, i) = inner.hit.geomID;
  RTCHitN_instID(hits, kLanes, i, 0) = id_;
}

void MovingInstance::occluded(const RTCOccludedFunctionNArguments* args, unsigned i) const {
  RTCRay inner;
  carry(args->ray, i, inner);
  const bool met = only_analytic_ >= 0
                       ? meet_analytic(inner) >= 0
                       : embree::occluded_instance(group_, id_, args->context, inner);
  if (met) RTCRayN_tfar(args->ray, kLanes, i) = -std::numeric_limits<float>::infinity();
}

// Ray by ray: where packets have come apart, which is nearly always, that is what they take anyway.
void MovingInstance::intersect_all(const RTCIntersectFunctionNArguments* args) {
  const MovingInstance& instance = instance_of(args->geometryUserPtr);
  for (unsigned rest = lanes_of(args->valid); rest != 0; rest &= rest - 1)
    instance.intersect(args, static_cast<unsigned>(__builtin_ctz(rest)));
}

void MovingInstance::occluded_all(const RTCOccludedFunctionNArguments* args) {
  const MovingInstance& instance = instance_of(args->geometryUserPtr);
  for (unsigned rest = lanes_of(args->valid); rest != 0; rest &= rest - 1)
    instance.occluded(args, static_cast<unsigned>(__builtin_ctz(rest)));
}

}  // namespace metrofarm::geometry
