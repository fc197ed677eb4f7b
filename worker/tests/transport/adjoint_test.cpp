// The same light transport from both ends, on a sphere of few triangles and smooth normals.
#include <gtest/gtest.h>

#include <numbers>

#include "math/warp.h"
#include "tests/support/trace.h"
#include "transport/adjoint.h"

namespace metrofarm::transport {
namespace {

using primary_space::Decision;
using primary_space::eye_slot;
using primary_space::Pair;
using test::Moments;
using test::SceneBuilder;

constexpr int kGrid = 8;
constexpr uint64_t kPaths = 1600000;
constexpr double kFieldOfView = 50;
const scene::Point kLight = {1.5, 2.5, -2};

// Latitudes and longitudes, coarse enough that shading and geometric normals differ by up to 30
// degrees.
scene::TriangleMesh coarse_sphere() {
  constexpr int kRings = 4, kSectors = 7;
  scene::TriangleMesh mesh;
  for (int ring = 0; ring <= kRings; ++ring) {
    for (int sector = 0; sector < kSectors; ++sector) {
      const double theta = std::numbers::pi * ring / kRings;
      const double phi = 2 * std::numbers::pi * sector / kSectors;
      for (double c :
           {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)}) {
        mesh.positions.push_back(static_cast<float>(c));
        mesh.normals.push_back(static_cast<float>(c));
      }
    }
  }
  for (uint32_t ring = 0; ring < kRings; ++ring) {
    for (uint32_t sector = 0; sector < kSectors; ++sector) {
      const uint32_t next = (sector + 1) % kSectors;
      const uint32_t a = ring * kSectors + sector, b = ring * kSectors + next;
      const uint32_t c = a + kSectors, d = b + kSectors;
      if (ring + 1 < kRings) mesh.indices.insert(mesh.indices.end(), {a, d, c});
      if (ring > 0) mesh.indices.insert(mesh.indices.end(), {a, b, d});
    }
  }
  return mesh;
}

scene::SceneDescription sphere_on_floor(const scene::Bsdf& sphere) {
  SceneBuilder b;
  b.emitter(scene::PointEmitter{kLight, {20, 20, 20}});
  b.description().bsdfs.push_back(sphere);
  const scene::Index floor = b.diffuse(0.6F);
  b.shape(coarse_sphere(), 0);
  b.shape(test::quad({-4, -1, 4}, {8, 0, 0}, {0, 0, -8}), floor);
  b.camera({0, 0.3, -5}, kFieldOfView);
  return b.take();
}

// Particles from the point light, connected to the pinhole at every vertex: radiance per tile.
class LightTracer {
 public:
  LightTracer(const Scene& scene, bool with_factor)
      : scene_(scene), with_factor_(with_factor), source_(rng_key(9, RngDomain::kTest)) {}

  std::vector<Moments> run(uint64_t particles, int max_edges) {
    for (uint64_t i = 0; i < particles; i += kLanes) {
      source_.begin(i);
      splats_.assign(size_t{kLanes} * kGrid * kGrid, 0.0);
      follow(max_edges);
      for (int lane = 0; lane < kLanes; ++lane)
        for (int t = 0; t < kGrid * kGrid; ++t) tiles_[t].add(splats_[lane * kGrid * kGrid + t]);
    }
    return tiles_;
  }

 private:
  struct Vertex {
    geometry::Surface surface;
    Frame frame;
    bsdf::ShownLobe lobe;
    Vec3 wo;
  };

  Vertex vertex_at(const geometry::RayHits& hits, const Vec3& origin, const Vec3& direction) {
    Vertex v;
    v.surface = geometry::surface_at(scene_.primitives(), scene_.placements(), hits, origin, direction, {});
    v.frame = frame_around(v.surface.shading_normal);
    v.wo = v.frame.to_local(-direction);
    const Int bsdf = gather(scene_.primitives().bsdf_of.data(), v.surface.shape, hits.hit);
    v.lobe = scene_.materials().show(bsdf, {v.surface.point, {}, {}, v.wo}, Float(0.F), hits.hit);
    return v;
  }

  Float factor(const Vertex& v, const Vec3& next) const {
    if (!with_factor_) return Float(1.F);
    return adjoint_factor(v.surface.geometric_normal, v.surface.shading_normal,
                          v.frame.to_world(v.wo), next);
  }

  void follow(int max_edges) {
    Vec3 origin = splat(static_cast<float>(kLight[0]), static_cast<float>(kLight[1]),
                        static_cast<float>(kLight[2]));
    const Pair emission = source_.pair(primary_space::kLensSlot, all_lanes());
    Vec3 direction = square_to_sphere({emission.first, emission.second});
    Spectrum power = splat(20.F * 4 * kPi);
    Mask active = all_lanes();
    // Path edges: one to the first surface, one to the camera from each vertex.
    for (int edges = 2; edges <= max_edges && any(active); ++edges) {
      const auto hits = scene_.tracer().intersect(active, origin, direction);
      active = hits.hit;
      if (none(active)) return;
      const Vertex v = vertex_at(hits, origin, direction);
      connect(v, power, active);
      const Pair lobe = source_.pair(eye_slot(edges, Decision::kLobe), active);
      const Pair u = source_.pair(eye_slot(edges, Decision::kDirection), active);
      const auto s = scene_.materials().sample(
          v.lobe, active, v.wo, {lobe.first, {u.first, u.second}}, bsdf::Transport::kImportance);
      active = active & s.valid;
      direction = normalize(v.frame.to_world(s.wi));
      const Float correction = factor(v, direction);
      active = active & (correction < Float(1e6F));
      power = keep(active, power * s.weight * correction);
      origin = geometry::offset_origin(v.surface.position, v.surface.geometric_normal,
                                       v.surface.offset, direction);
    }
  }

  // Splats what the vertex sends to the camera.
  void connect(const Vertex& v, const Spectrum& power, Mask lanes) {
    const Vec3 eye = splat(0.F, 0.3F, -5.F);
    const Vec3 to_eye = eye - v.surface.position;
    const Float distance = length(to_eye);
    const Vec3 direction = to_eye / distance;
    const auto e = scene_.materials().evaluate(v.lobe, lanes, v.wo, v.frame.to_local(direction),
                                               bsdf::Transport::kImportance);
    const Vec3 origin = geometry::offset_origin(v.surface.position, v.surface.geometric_normal,
                                                v.surface.offset, direction);
    const Mask lit = lanes & (e.pdf_solid_angle > Float(0.F)) & (direction.z < Float(0.F));
    const Mask seen =
        lit & ~scene_.tracer().occluded(lit, origin, direction, distance * Float(0.9999F));
    const Float correction = factor(v, direction);
    for (uint32_t rest = bits(seen); rest != 0; rest &= rest - 1) {
      const int lane = __builtin_ctz(rest);
      const double cosine = -lane_value(direction.z, lane);
      // Raster area per solid angle at a pinhole whose image plane is at distance 1.
      const double per_unit = kGrid / (2 * std::tan(kFieldOfView * std::numbers::pi / 360));
      const double x = 0.5 * kGrid + lane_value(direction.x, lane) / cosine * per_unit;
      const double y = 0.5 * kGrid + lane_value(direction.y, lane) / cosine * per_unit;
      if (!(x >= 0 && x < kGrid && y >= 0 && y < kGrid)) continue;
      const double d = lane_value(distance, lane);
      const double value = lane_value(luminance(power * e.value * correction), lane);
      splats_[size_t(lane) * kGrid * kGrid + int(y) * kGrid + int(x)] +=
          value / (d * d) * per_unit * per_unit / (cosine * cosine * cosine);
    }
  }

  const Scene& scene_;
  bool with_factor_;
  primary_space::IndependentSource source_;
  std::vector<double> splats_;
  std::vector<Moments> tiles_ = std::vector<Moments>(kGrid * kGrid);
};

int tiles_that_differ(const std::vector<Moments>& light, const std::vector<Moments>& eye,
                      double rate) {
  int differing = 0;
  for (size_t t = 0; t < eye.size(); ++t) {
    if (light[t].mean() == 0 && eye[t].mean() == 0) continue;
    if (!test::same_mean(light[t], eye[t], rate)) ++differing;
  }
  return differing;
}

// H0: every tile has the same mean from both ends. 1,600,000 paths and particles, 64 tiles, family
// rate 1e-5 per material. Without the factor the test must fail.
void expect_both_ends_agree(const scene::Bsdf& material) {
  PathSettings settings;
  settings.max_depth = 3;
  const auto eye = test::trace_paths(sphere_on_floor(material), settings, kPaths, 41, kGrid);
  const FlushDenormals flush;
  const Scene scene(sphere_on_floor(material), "avx2");
  const double rate = test::sidak(1e-5, kGrid * kGrid);
  const auto light = LightTracer(scene, true).run(kPaths, 3);
  EXPECT_EQ(tiles_that_differ(light, eye.tiles, rate), 0);
  const auto without = LightTracer(scene, false).run(kPaths, 3);
  EXPECT_GT(tiles_that_differ(without, eye.tiles, rate), 0);
}

TEST(Adjoint, ASmoothShadedCoarseDiffuseSphereLooksTheSameFromBothEnds) {
  expect_both_ends_agree({scene::Diffuse{{0.7F, 0.7F, 0.7F}}, "", {}});
}

TEST(Adjoint, ASmoothShadedCoarseGlossySphereLooksTheSameFromBothEnds) {
  scene::RoughConductor metal;
  metal.alpha_u = metal.alpha_v = 0.4F;
  expect_both_ends_agree({metal, "", {}});
}

TEST(Adjoint, WithoutShadingNormalsThereIsNothingToCorrect) {
  const Vec3 n = splat(0.F, 0.6F, 0.8F);
  const Float f = adjoint_factor(n, n, splat(0.3F, 0.9F, 0.2F), splat(-0.5F, 0.1F, 0.7F));
  EXPECT_NEAR(lane_value(f, 0), 1, 1e-6);
}

}  // namespace
}  // namespace metrofarm::transport
