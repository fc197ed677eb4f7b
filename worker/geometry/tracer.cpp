#include "geometry/tracer.h"

#include <algorithm>
#include <atomic>
#include <deque>
#include <limits>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "base/check.h"
#include "geometry/analytic.h"
#include "geometry/embree.h"
#include "geometry/moving_instance.h"

namespace metrofarm::geometry {
namespace {

// What the callbacks of one scene's analytic shapes know.
struct AnalyticRange {
  const Primitives& primitives;
  uint32_t first;
  uint32_t count;

  uint32_t index_of(unsigned primitive) const { return std::min(primitive, count - 1); }
};

const AnalyticRange& range_of(void* user_pointer) {
  return *static_cast<const AnalyticRange*>(user_pointer);
}

void analytic_bounds(const RTCBoundsFunctionArguments* args) {
  const AnalyticRange& range = range_of(args->geometryUserPtr);
  const Bounds b = bounds_of_analytic(range.primitives, range.first + range.index_of(args->primID));
  const float* upper = args->primID < range.count ? b.upper : b.lower;
  *args->bounds_o = {b.lower[0], b.lower[1], b.lower[2], 0, upper[0], upper[1], upper[2], 0};
}

RaySegment segment_of(RTCRayN* rays, unsigned n, unsigned i) {
  return {{RTCRayN_org_x(rays, n, i), RTCRayN_org_y(rays, n, i), RTCRayN_org_z(rays, n, i)},
          {RTCRayN_dir_x(rays, n, i), RTCRayN_dir_y(rays, n, i), RTCRayN_dir_z(rays, n, i)},
          RTCRayN_tnear(rays, n, i),
          RTCRayN_tfar(rays, n, i)};
}

void analytic_intersect(const RTCIntersectFunctionNArguments* args) {
  const AnalyticRange& range = range_of(args->geometryUserPtr);
  const uint32_t index = range.index_of(args->primID);
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, args->N);
  RTCHitN* hits = RTCRayHitN_HitN(args->rayhit, args->N);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    const double t =
        intersect_analytic(range.primitives, range.first + index, segment_of(rays, args->N, i));
    if (t < 0) continue;
    RTCRayN_tfar(rays, args->N, i) = static_cast<float>(t);
    RTCHitN_u(hits, args->N, i) = 0;
    RTCHitN_v(hits, args->N, i) = 0;
    RTCHitN_primID(hits, args->N, i) = index;
    RTCHitN_geomID(hits, args->N, i) = args->geomID;
    RTCHitN_instID(hits, args->N, i, 0) = args->context->instID[0];
  }
}

void analytic_occluded(const RTCOccludedFunctionNArguments* args) {
  const AnalyticRange& range = range_of(args->geometryUserPtr);
  const uint32_t index = range.first + range.index_of(args->primID);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    const double t = intersect_analytic(range.primitives, index, segment_of(args->ray, args->N, i));
    if (t >= 0) RTCRayN_tfar(args->ray, args->N, i) = -std::numeric_limits<float>::infinity();
  }
}

struct Memory {
  std::atomic<int64_t> bytes{0};
  int64_t limit = 0;
};

// What is refused is not counted; Embree then gives up, with RTC_ERROR_OUT_OF_MEMORY.
bool count_memory(void* counter, ssize_t bytes, bool /*post*/) {
  auto& memory = *static_cast<Memory*>(counter);
  const int64_t before = memory.bytes.fetch_add(bytes, std::memory_order_relaxed);
  if (bytes <= 0 || before + bytes <= memory.limit) return true;
  memory.bytes.fetch_sub(bytes, std::memory_order_relaxed);
  return false;
}

void store(float* out, Float value) {
  value.store_aligned(out);
}

template <class Ray>
void store_ray(Ray& ray, const Vec3& origin, const Vec3& direction, Float t_max, Float time) {
  store(ray.org_x, origin.x);
  store(ray.org_y, origin.y);
  store(ray.org_z, origin.z);
  store(ray.dir_x, direction.x);
  store(ray.dir_y, direction.y);
  store(ray.dir_z, direction.z);
  store(ray.tnear, Float(0.F));
  store(ray.tfar, t_max);
  store(ray.time, time);
  const __m256i all = _mm256_set1_epi32(-1);
  _mm256_store_si256(reinterpret_cast<__m256i*>(ray.mask), all);
  _mm256_store_si256(reinterpret_cast<__m256i*>(ray.flags), _mm256_setzero_si256());
}

void store_valid(int* valid, Mask active) {
  _mm256_store_si256(reinterpret_cast<__m256i*>(valid), _mm256_castps_si256(active));
}

}  // namespace

struct Tracer::Impl {
  const Primitives& primitives;
  const Placements& placements;
  Memory memory = {};
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<RTCScene> groups;           // null where no instance shows the group
  std::deque<AnalyticRange> ranges = {};  // Embree keeps pointers to them, and to these:
  std::deque<MovingInstance> moving = {};
  Int analytic_offset = Int(0);
  // Number of the first triangle and of the first analytic shape that each instance shows.
  std::vector<int32_t> first_triangle = {}, first_analytic = {};

  Impl(const Primitives& p, const Placements& where, std::string_view isa, uint64_t max_bytes)
      : primitives(p), placements(where) {
    // One build thread: the order of triangles in the tree, which decides ties, must not depend on
    // the number of cores.
    const std::string config = "threads=1,isa=" + std::string(isa);
    device = rtcNewDevice(config.c_str());
    METROFARM_CHECK(device != nullptr);
    // Else callbacks may get packets of other sizes.
    METROFARM_CHECK(rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) != 0);
    memory.limit = static_cast<int64_t>(std::min(max_bytes, uint64_t{1} << 62));
    rtcSetDeviceMemoryMonitorFunction(device, count_memory, &memory);
    analytic_offset = Int(p.triangle_count);
  }

  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  ~Impl() {
    if (scene != nullptr) rtcReleaseScene(scene);
    for (RTCScene group : groups)
      if (group != nullptr) rtcReleaseScene(group);
    rtcReleaseDevice(device);
  }

  // Apart from the constructor, so that what was built is released if memory does not suffice.
  void build() {
    scene = rtcNewScene(device);
    add_range(scene, primitives.world);
    add_instances();
    commit(scene);
    for (MovingInstance& instance : moving) {
      count_memory(&memory, -static_cast<ssize_t>(instance.bytes_of_boxes()), true);
      instance.forget_boxes();
    }
  }

  // What Embree does not count itself.
  void take(size_t bytes) {
    if (!count_memory(&memory, static_cast<ssize_t>(bytes), false)) throw std::bad_alloc();
  }

  void commit(RTCScene built) const {
    rtcCommitScene(built);
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    METROFARM_CHECK(error == RTC_ERROR_NONE);
  }

  void add_range(RTCScene to, const PrimitiveRange& range) {
    if (range.deforming >= 0) {
      add_deforming(to, static_cast<size_t>(range.deforming), kTriangleGeometry);
    } else if (range.triangle_count > 0) {
      add_triangles(to, range);
    }
    if (range.analytic_count > 0) add_analytic(to, range);
  }

  // The tables of vertices and indices are shared with Embree, by all groups.
  void add_triangles(RTCScene to, const PrimitiveRange& range) {
    const Primitives& p = primitives;
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    constexpr size_t kStride = 3 * sizeof(int32_t);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               p.positions.data(), 0, 3 * sizeof(float), p.vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               p.indices.data(),
                               kStride * static_cast<size_t>(range.first_triangle), kStride,
                               static_cast<size_t>(range.triangle_count));
    attach(to, geometry, kTriangleGeometry);
  }

  void add_deforming(RTCScene to, size_t number, unsigned id) {
    const Deformations& deformations = placements.deformations();
    const DeformingMesh& mesh = primitives.deforming[number];
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    const int steps = deformations.step_count(number);
    rtcSetGeometryTimeStepCount(geometry, static_cast<unsigned>(steps));
    for (int i = 0; i < steps; ++i) {
      rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, static_cast<unsigned>(i),
                                 RTC_FORMAT_FLOAT3, deformations.positions(number, i), 0,
                                 3 * sizeof(float), mesh.keys[0].positions.size() / 3);
    }
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               mesh.indices.data(), 0, 3 * sizeof(int32_t),
                               mesh.indices.size() / 3);
    attach(to, geometry, id);
  }

  void add_analytic(RTCScene to, const PrimitiveRange& range) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    const auto count = static_cast<unsigned>(range.analytic_count);
    // What a group shows is met through the box of its instance.
    const bool alone = count == 1 && to == scene;
    rtcSetGeometryUserPrimitiveCount(geometry, alone ? kWithCorner : count);
    ranges.push_back({primitives, static_cast<uint32_t>(range.first_analytic), count});
    rtcSetGeometryUserData(geometry, &ranges.back());
    rtcSetGeometryBoundsFunction(
        geometry, [](const RTCBoundsFunctionArguments* a) { analytic_bounds(a); }, nullptr);
    rtcSetGeometryIntersectFunction(geometry, analytic_intersect);
    rtcSetGeometryOccludedFunction(geometry, analytic_occluded);
    attach(to, geometry, kAnalyticGeometry);
  }

  void add_instances() {
    const Primitives& p = primitives;
    groups.resize(p.groups.size(), nullptr);
    std::vector<std::optional<Hull>> hulls(p.groups.size());
    const bool alone = count_moving() == 1;
    for (size_t i = 0; i < p.instances.size(); ++i) {
      const auto group = static_cast<size_t>(p.instances[i].group);
      const PrimitiveRange& range = p.groups[group];
      first_triangle.push_back(range.first_triangle);
      first_analytic.push_back(p.triangle_count + range.first_analytic);
      if (range.empty()) continue;
      if (placements.moves(i)) {
        if (!hulls[group]) hulls[group].emplace(p, range);
        add_moving(i, group, *hulls[group], alone);
      } else if (range.deforming >= 0 && placements.stays(i)) {
        add_deforming(scene, static_cast<size_t>(range.deforming), id_of(i));
      } else {
        add_still(i, group);
      }
    }
  }

  size_t count_moving() const {
    size_t count = 0;
    for (size_t i = 0; i < primitives.instances.size(); ++i) {
      const auto group = static_cast<size_t>(primitives.instances[i].group);
      if (placements.moves(i) && !primitives.groups[group].empty()) ++count;
    }
    return count;
  }

  RTCScene scene_of(size_t group) {
    if (groups[group] == nullptr) {
      groups[group] = rtcNewScene(device);
      add_range(groups[group], primitives.groups[group]);
      commit(groups[group]);
    }
    return groups[group];
  }

  void add_moving(size_t instance, size_t group, const Hull& hull, bool alone) {
    const bool needs_scene = !primitives.groups[group].is_single_analytic();
    take(sizeof(MovingInstance));
    MovingInstance& added = moving.emplace_back(primitives, placements, instance, id_of(instance),
                                                needs_scene ? scene_of(group) : nullptr, hull);
    take(added.bytes_of_boxes());
    RTCGeometry geometry = added.geometry(device, alone);
    attach(scene, geometry, id_of(instance));
  }

  void add_still(size_t instance, size_t group) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(geometry, scene_of(group));
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR,
                            placements.matrix(instance));
    attach(scene, geometry, id_of(instance));
  }

  static unsigned id_of(size_t instance) {
    return kFirstInstance + static_cast<unsigned>(instance);
  }

  static void attach(RTCScene to, RTCGeometry geometry, unsigned id) {
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(to, geometry, id);
    rtcReleaseGeometry(geometry);
  }

  // From numbers within what an instance shows to numbers of primitives. What deforms in its place
  // has an instance's id as geometry.
  void resolve_instances(Int reported, Int geometry, Mask analytic, RayHits& hits) const {
    const Int first(static_cast<int32_t>(kFirstInstance));
    reported = select(hits.hit & ~less(geometry, first), geometry, reported);
    const Mask instanced = hits.hit & ~equal(reported, Int(-1));
    if (none(instanced)) return;
    hits.instance = select(instanced, reported - first, hits.instance);
    // The numbers that the world's scene has for them are off by the difference of the starts.
    const Int triangles = gather(first_triangle.data(), hits.instance, instanced & ~analytic);
    const Int shapes = gather(first_analytic.data(), hits.instance, instanced & analytic);
    const Int world_start = select(instanced & analytic, analytic_offset, Int(0));
    hits.primitive = hits.primitive - world_start + triangles + shapes;
  }
};

Tracer::Tracer(const Primitives& primitives, const Placements& placements, std::string_view isa,
               uint64_t max_bytes)
    : impl_(std::make_unique<Impl>(primitives, placements, isa, max_bytes)) {
  impl_->build();
}

Tracer::~Tracer() = default;

RayHits Tracer::intersect(Mask active, const Vec3& origin, const Vec3& direction,
                          Float time) const {
  alignas(32) RTCRayHit8 rays;
  alignas(32) int valid[kLanes];
  store_valid(valid, active);
  store_ray(rays.ray, origin, direction, Float(std::numeric_limits<float>::infinity()), time);
  const auto at = [](unsigned* words) { return reinterpret_cast<__m256i*>(words); };
  const __m256i invalid = _mm256_set1_epi32(-1);
  _mm256_store_si256(at(rays.hit.geomID), invalid);
  _mm256_store_si256(at(rays.hit.instID[0]), invalid);
  embree::intersect8(valid, impl_->scene, &rays);

  const Int geometry = Int(_mm256_load_si256(at(rays.hit.geomID)));
  const Int primitive = Int(_mm256_load_si256(at(rays.hit.primID)));
  const Mask analytic = equal(geometry, Int(static_cast<int32_t>(kAnalyticGeometry)));
  RayHits hits;
  hits.hit = active & ~equal(geometry, Int(-1));
  hits.t = Float::load_aligned(rays.ray.tfar);
  hits.u = Float::load_aligned(rays.hit.u);
  hits.v = Float::load_aligned(rays.hit.v);
  hits.primitive = select(analytic, primitive + impl_->analytic_offset, primitive);
  hits.instance = Int(-1);
  hits.time = time;
  if (!impl_->first_triangle.empty())
    impl_->resolve_instances(Int(_mm256_load_si256(at(rays.hit.instID[0]))), geometry, analytic,
                             hits);
  return hits;
}

Mask Tracer::occluded(Mask active, const Vec3& origin, const Vec3& direction, Float t_max,
                      Float time) const {
  alignas(32) RTCRay8 rays;
  alignas(32) int valid[kLanes];
  store_valid(valid, active);
  store_ray(rays, origin, direction, t_max, time);
  embree::occluded8(valid, impl_->scene, &rays);
  return active & (Float::load_aligned(rays.tfar) < Float(0.F));
}

uint64_t Tracer::bytes() const {
  return static_cast<uint64_t>(impl_->memory.bytes.load(std::memory_order_relaxed));
}

}  // namespace metrofarm::geometry
