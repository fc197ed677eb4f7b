#include "geometry/tracer.h"

#include <atomic>
#include <limits>
#include <string>

#include "base/check.h"
#include "geometry/analytic.h"
#include "geometry/embree.h"

namespace metrofarm::geometry {
namespace {

constexpr unsigned kTriangleGeometry = 0;
constexpr unsigned kAnalyticGeometry = 1;

void analytic_bounds(const RTCBoundsFunctionArguments* args) {
  const auto& primitives = *static_cast<const Primitives*>(args->geometryUserPtr);
  const Bounds b = bounds_of_analytic(primitives, args->primID);
  *args->bounds_o = {b.lower[0], b.lower[1], b.lower[2], 0, b.upper[0], b.upper[1], b.upper[2], 0};
}

RaySegment segment_of(RTCRayN* rays, unsigned n, unsigned i) {
  return {{RTCRayN_org_x(rays, n, i), RTCRayN_org_y(rays, n, i), RTCRayN_org_z(rays, n, i)},
          {RTCRayN_dir_x(rays, n, i), RTCRayN_dir_y(rays, n, i), RTCRayN_dir_z(rays, n, i)},
          RTCRayN_tnear(rays, n, i),
          RTCRayN_tfar(rays, n, i)};
}

void analytic_intersect(const RTCIntersectFunctionNArguments* args) {
  const auto& primitives = *static_cast<const Primitives*>(args->geometryUserPtr);
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, args->N);
  RTCHitN* hits = RTCRayHitN_HitN(args->rayhit, args->N);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    const double t = intersect_analytic(primitives, args->primID, segment_of(rays, args->N, i));
    if (t < 0) continue;
    RTCRayN_tfar(rays, args->N, i) = static_cast<float>(t);
    RTCHitN_u(hits, args->N, i) = 0;
    RTCHitN_v(hits, args->N, i) = 0;
    RTCHitN_primID(hits, args->N, i) = args->primID;
    RTCHitN_geomID(hits, args->N, i) = args->geomID;
  }
}

void analytic_occluded(const RTCOccludedFunctionNArguments* args) {
  const auto& primitives = *static_cast<const Primitives*>(args->geometryUserPtr);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    const double t =
        intersect_analytic(primitives, args->primID, segment_of(args->ray, args->N, i));
    if (t >= 0) RTCRayN_tfar(args->ray, args->N, i) = -std::numeric_limits<float>::infinity();
  }
}

bool count_memory(void* counter, ssize_t bytes, bool /*post*/) {
  static_cast<std::atomic<int64_t>*>(counter)->fetch_add(bytes, std::memory_order_relaxed);
  return true;
}

void store(float* out, Float value) {
  value.store_aligned(out);
}

template <class Ray>
void store_ray(Ray& ray, const Vec3& origin, const Vec3& direction, Float t_max) {
  store(ray.org_x, origin.x);
  store(ray.org_y, origin.y);
  store(ray.org_z, origin.z);
  store(ray.dir_x, direction.x);
  store(ray.dir_y, direction.y);
  store(ray.dir_z, direction.z);
  store(ray.tnear, Float(0.F));
  store(ray.tfar, t_max);
  store(ray.time, Float(0.F));
  const __m256i all = _mm256_set1_epi32(-1);
  _mm256_store_si256(reinterpret_cast<__m256i*>(ray.mask), all);
  _mm256_store_si256(reinterpret_cast<__m256i*>(ray.flags), _mm256_setzero_si256());
}

void store_valid(int* valid, Mask active) {
  _mm256_store_si256(reinterpret_cast<__m256i*>(valid), _mm256_castps_si256(active));
}

}  // namespace

struct Tracer::Impl {
  std::atomic<int64_t> memory{0};
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  Int analytic_offset = Int(0);

  ~Impl() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  void add_triangles(const Primitives& p) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               p.positions.data(), 0, 3 * sizeof(float), p.vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               p.indices.data(), 0, 3 * sizeof(int32_t), p.indices.size() / 3);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene, geometry, kTriangleGeometry);
    rtcReleaseGeometry(geometry);
  }

  void add_analytic(const Primitives& p) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(p.analytic_kind.size()));
    // Embree hands the pointer back to the callbacks, which only read.
    rtcSetGeometryUserData(geometry, const_cast<Primitives*>(&p));
    rtcSetGeometryBoundsFunction(
        geometry, [](const RTCBoundsFunctionArguments* a) { analytic_bounds(a); }, nullptr);
    rtcSetGeometryIntersectFunction(geometry, analytic_intersect);
    rtcSetGeometryOccludedFunction(geometry, analytic_occluded);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene, geometry, kAnalyticGeometry);
    rtcReleaseGeometry(geometry);
  }
};

Tracer::Tracer(const Primitives& primitives, std::string_view isa)
    : impl_(std::make_unique<Impl>()) {
  // One build thread: the order of triangles in the tree, which decides ties, must not depend on
  // the number of cores.
  const std::string config = "threads=1,isa=" + std::string(isa);
  impl_->device = rtcNewDevice(config.c_str());
  METROFARM_CHECK(impl_->device != nullptr);
  rtcSetDeviceMemoryMonitorFunction(impl_->device, count_memory, &impl_->memory);
  impl_->scene = rtcNewScene(impl_->device);
  impl_->analytic_offset = Int(primitives.triangle_count);
  if (primitives.triangle_count > 0) impl_->add_triangles(primitives);
  if (!primitives.analytic_kind.empty()) impl_->add_analytic(primitives);
  rtcCommitScene(impl_->scene);
  METROFARM_CHECK(rtcGetDeviceError(impl_->device) == RTC_ERROR_NONE);
}

Tracer::~Tracer() = default;

RayHits Tracer::intersect(Mask active, const Vec3& origin, const Vec3& direction) const {
  alignas(32) RTCRayHit8 rays;
  alignas(32) int valid[kLanes];
  store_valid(valid, active);
  store_ray(rays.ray, origin, direction, Float(std::numeric_limits<float>::infinity()));
  const __m256i invalid = _mm256_set1_epi32(-1);
  _mm256_store_si256(reinterpret_cast<__m256i*>(rays.hit.geomID), invalid);
  embree::intersect8(valid, impl_->scene, &rays);

  const Int geometry = Int(_mm256_load_si256(reinterpret_cast<__m256i*>(rays.hit.geomID)));
  const Int primitive = Int(_mm256_load_si256(reinterpret_cast<__m256i*>(rays.hit.primID)));
  const Mask analytic = equal(geometry, Int(static_cast<int32_t>(kAnalyticGeometry)));
  RayHits hits;
  hits.hit = active & ~equal(geometry, Int(-1));
  hits.t = Float::load_aligned(rays.ray.tfar);
  hits.u = Float::load_aligned(rays.hit.u);
  hits.v = Float::load_aligned(rays.hit.v);
  hits.primitive = select(analytic, primitive + impl_->analytic_offset, primitive);
  return hits;
}

Mask Tracer::occluded(Mask active, const Vec3& origin, const Vec3& direction, Float t_max) const {
  alignas(32) RTCRay8 rays;
  alignas(32) int valid[kLanes];
  store_valid(valid, active);
  store_ray(rays, origin, direction, t_max);
  embree::occluded8(valid, impl_->scene, &rays);
  return active & (Float::load_aligned(rays.tfar) < Float(0.F));
}

uint64_t Tracer::bytes() const {
  return static_cast<uint64_t>(impl_->memory.load(std::memory_order_relaxed));
}

}  // namespace metrofarm::geometry
