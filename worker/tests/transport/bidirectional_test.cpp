// Bidirectional and multiplexed path tracing against path tracing, one kind of light, material or
// camera at a time.
#include <gtest/gtest.h>

#include <functional>

#include "tests/emitter/lights.h"
#include "tests/support/room.h"
#include "tests/support/trace.h"
#include "transport/multiplexed.h"

namespace metrofarm::transport {
namespace {

using test::SceneBuilder;
using test::Traced;

constexpr int kGrid = 4;
constexpr int kMaxDepth = 5;

struct Case {
  const char* name;
  std::function<scene::SceneDescription()> scene;
};

// A closed grey box around (0, 0, 1) with a block in it; the camera looks along +z.
SceneBuilder grey_box(float reflectance = 0.5F) {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(reflectance);
  b.shape(test::box({-2, -1.5, -2}, {2, 1.5, 3}), grey, scene::kNone, true);
  b.shape(test::box({-1.2, -1.5, 0.6}, {-0.3, -0.4, 1.5}), grey);
  b.camera({0, 0, -1.9}, 70);
  return b;
}

// The same without walls: what is beside the block and the floor is open.
SceneBuilder open_block() {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.6F);
  b.shape(test::box({-0.8, -1, 0.6}, {0.3, 0.4, 1.5}), grey);
  b.shape(test::quad({-3, -1, 4}, {6, 0, 0}, {0, 0, -6}), grey);
  b.camera({0, 0, -1.9}, 70);
  return b;
}

scene::Matrix looking_down(double x, double y, double z) {
  return {1, 0, 0, x, 0, 0, -1, y, 0, 1, 0, z, 0, 0, 0, 1};
}

template <class Emitter>
scene::SceneDescription box_lit_by(const Emitter& emitter) {
  SceneBuilder b = grey_box();
  b.emitter(emitter);
  return b.take();
}

template <class Emitter>
scene::SceneDescription block_lit_by(const Emitter& emitter) {
  SceneBuilder b = open_block();
  b.emitter(emitter);
  return b.take();
}

template <class Model>
scene::SceneDescription ball_of(const Model& model) {
  SceneBuilder b = grey_box();
  b.shape(scene::Sphere{{0.6, -0.5, 1}, 0.7}, b.material(model));
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(test::quad({-0.5, 1.4, 0.5}, {1, 0, 0}, {0, 0, 1}), grey, b.area_light(6));
  return b.take();
}

scene::SceneDescription through(scene::Projection projection) {
  scene::SceneDescription d = test::room();
  d.sensor.projection = projection;
  d.sensor.aperture_radius = 0.15;
  d.sensor.focus_distance = 2.5;
  d.sensor.near_clip = 0.05;
  return d;
}

// Shading normals that differ much from the geometric ones.
scene::SceneDescription smooth_tetrahedron() {
  SceneBuilder b = grey_box();
  scene::TriangleMesh mesh;
  for (auto [x, y, z] : {std::tuple{0.F, 0.9F, 0.F},
                         {0.8F, -0.4F, 0.5F},
                         {-0.8F, -0.4F, 0.5F},
                         {0.F, -0.4F, -0.9F}}) {
    const float length = std::sqrt(x * x + y * y + z * z);
    for (float c : {0.6F + x, -0.5F + y, 1.F + z}) mesh.positions.push_back(c);
    for (float c : {x, y, z}) mesh.normals.push_back(c / length);
  }
  mesh.indices = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
  const scene::Index grey = b.diffuse(0.7F);
  b.shape(mesh, b.material(scene::TwoSided{grey, grey}));
  b.shape(test::quad({-0.5, 1.4, 0.5}, {1, 0, 0}, {0, 0, 1}), grey, b.area_light(6));
  return b.take();
}

scene::SceneDescription under_a_map() {
  SceneBuilder b = open_block();
  b.description().images.push_back(test::map_image(
      16, 8, [](int x, int y) { return x == 3 && y == 2 ? 40.F : 0.2F + 0.1F * y; }));
  scene::EnvironmentEmitter map;
  map.image = 0;
  b.emitter(map);
  b.emitter(scene::ConstantEmitter{{0.1F, 0.1F, 0.1F}});
  b.emitter(scene::PointEmitter{{0.5, 1, -0.5}, {1, 1, 1}});
  return b.take();
}

scene::Index checkerboard(SceneBuilder& b) {
  scene::CheckerboardTexture board;
  board.colour0 = {1, 0.9F, 0.2F};
  board.colour1 = {0.1F, 0.1F, 0.5F};
  b.description().textures.push_back({board, "", {}});
  return static_cast<scene::Index>(b.description().textures.size() - 1);
}

scene::SceneDescription under_a_textured_light() {
  SceneBuilder b = grey_box();
  scene::TriangleMesh panel = test::quad({-0.5, 1.4, 0.5}, {1, 0, 0}, {0, 0, 1});
  panel.texcoords = {0, 0, 2, 0, 2, 2, 0, 2};
  const scene::Colour radiance({6, 6, 6}, checkerboard(b));
  b.shape(panel, b.diffuse(0.5F), b.emitter(scene::AreaEmitter{radiance}));
  return b.take();
}

scene::SceneDescription masked_blend() {
  scene::SceneDescription d = ball_of(scene::Diffuse{});
  const auto add = [&](const auto& model) {
    d.bsdfs.push_back({model, "", {}});
    return static_cast<scene::Index>(d.bsdfs.size() - 1);
  };
  scene::RoughConductor metal;
  metal.alpha_u = metal.alpha_v = 0.25F;
  const scene::Index glossy = add(metal), dull = add(scene::Diffuse{});
  const scene::Index both = add(scene::Blend{0.4F, glossy, dull});
  const scene::Index seen = add(scene::TwoSided{both, both});
  const scene::Index masked = add(scene::Mask{0.6F, seen});
  for (scene::Shape& shape : d.shapes)
    if (std::holds_alternative<scene::Sphere>(shape.geometry)) shape.bsdf = masked;
  return d;
}

scene::SceneDescription normal_mapped() {
  SceneBuilder b = grey_box();
  b.description().images.push_back({2, 2, 3,
                                    std::vector<float>{0.8F, 0.5F, 0.9F, 0.3F, 0.6F, 0.9F,  //
                                                       0.5F, 0.2F, 0.9F, 0.6F, 0.7F, 0.9F},
                                    false});
  scene::BitmapTexture normals;
  normals.image = 0;
  b.description().textures.push_back({normals, "", {}});
  const scene::Index grey = b.diffuse(0.6F);
  const scene::Index bent = b.material(scene::NormalMap{0, grey});
  scene::TriangleMesh panel = test::quad({-1, -1, 2.5}, {0, 2, 0}, {2, 0, -0.6});
  panel.texcoords = {0, 0, 1, 0, 1, 1, 0, 1};
  b.shape(panel, b.material(scene::TwoSided{bent, bent}));
  b.shape(test::quad({-0.5, 1.4, 0.5}, {1, 0, 0}, {0, 0, 1}), grey, b.area_light(6));
  return b.take();
}

std::vector<Case> cases() {
  scene::Principled principled;
  principled.roughness = 0.3F;
  principled.metallic = 0.3F;
  principled.clearcoat = 0.7F;
  principled.spec_trans = 0.4F;
  scene::SpotEmitter spot;
  spot.to_world = looking_down(0.3, 1.2, 1);
  spot.intensity.value = {9, 8, 7};
  spot.cutoff_degrees = 50;
  spot.beam_width_degrees = 35;
  scene::ProjectorEmitter projector;
  projector.to_world = looking_down(0.3, 1.2, 1);
  projector.irradiance.value = {4, 4, 4};
  projector.fov_x_degrees = 80;
  scene::RoughConductor metal;
  metal.alpha_u = 0.3F;
  metal.alpha_v = 0.12F;
  metal.distribution = scene::Microfacet::kGgx;
  scene::RoughDielectric frosted;
  frosted.alpha_u = frosted.alpha_v = 0.3F;
  return {
      {"Room", test::room},
      {"PointLight", [] { return box_lit_by(scene::PointEmitter{{0.5, 1, 0.5}, {3, 3, 2}}); }},
      {"Spot", [=] { return box_lit_by(spot); }},
      {"Projector", [=] { return box_lit_by(projector); }},
      {"Directional",
       [] { return block_lit_by(scene::DirectionalEmitter{{0.3, -1, 0.5}, {2, 2, 2}}); }},
      {"Constant", [] { return block_lit_by(scene::ConstantEmitter{{1, 1, 1}}); }},
      {"DiskAndSphere",
       [] {
         SceneBuilder b = grey_box();
         const scene::Index grey = b.diffuse(0.5F);
         b.shape(scene::Sphere{{1, 0.8, 1.5}, 0.3}, grey, b.area_light(5));
         b.shape(test::disk({-1, 0.5, 2.9}, 0.4, true), grey, b.area_light(4));
         return b.take();
       }},
      {"RoughConductor", [=] { return ball_of(metal); }},
      {"Dielectric", [] { return ball_of(scene::Dielectric{}); }},
      {"RoughDielectric", [=] { return ball_of(frosted); }},
      {"ThinLens", [] { return through(scene::Projection::kThinLens); }},
      {"Orthographic", [] { return through(scene::Projection::kOrthographic); }},
      {"SmoothTetrahedron", smooth_tetrahedron},
      {"EnvironmentMap", under_a_map},
      {"TexturedLight", under_a_textured_light},
      {"CylinderLight",
       [] {
         SceneBuilder b = grey_box();
         b.shape(scene::Cylinder{{0.2, 0, 0, 0.8, 0, 0.2, 0, 0.6, 0, 0, 1, 0.5, 0, 0, 0, 1}},
                 b.diffuse(0.5F), b.area_light(4));
         return b.take();
       }},
      {"Plastic", [] { return ball_of(scene::Plastic{}); }},
      {"RoughPlastic", [] { return ball_of(scene::RoughPlastic{}); }},
      {"Principled", [=] { return ball_of(principled); }},
      {"ThinDielectric", [] { return ball_of(scene::ThinDielectric{}); }},
      {"DiffuseTransmitter", [] { return ball_of(scene::DiffuseTransmitter{}); }},
      {"MaskedBlend", masked_blend},
      {"NormalMap", normal_mapped},
  };
}

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

class Bidirectional : public testing::TestWithParam<Case> {};

BidirectionalSettings settings() {
  BidirectionalSettings s;
  s.max_depth = kMaxDepth;
  s.rr_depth = 3;
  return s;
}

Traced traced_by_paths(const Case& c, uint64_t samples) {
  PathSettings s;
  s.max_depth = kMaxDepth;
  return test::trace_paths(c.scene(), s, samples, 41, kGrid);
}

void expect_same(const Traced& a, const Traced& b) {
  EXPECT_EQ(a.bad + b.bad, 0U);
  for (uint64_t n : a.anomalies) EXPECT_EQ(n, 0U);
  for (uint64_t n : b.anomalies) EXPECT_EQ(n, 0U);
  const double rate = test::sidak(1e-5, kGrid * kGrid + 1);
  EXPECT_TRUE(test::same_mean(a.all, b.all, rate));
  for (int t = 0; t < kGrid * kGrid; ++t)
    EXPECT_TRUE(test::same_mean(a.tiles[t], b.tiles[t], rate)) << "tile " << t;
}

// H0: both have the same mean in every tile and over the image. Welch tests, 240,000 samples each,
// family rate 1e-5 per scene. Clean scenes report nothing.
TEST_P(Bidirectional, AgreesWithPathTracing) {
  const auto make = [](const Scene& scene, const sensor::Camera& camera,
                       const RasterWindow& raster) {
    return std::make_unique<BidirectionalTracer>(scene, camera, settings(), raster);
  };
  expect_same(traced_by_paths(GetParam(), 240000),
              test::trace_with(GetParam().scene(), make, 240000, 42, kGrid));
}

// The same for one technique at a time, 480,000 samples.
TEST_P(Bidirectional, MultiplexedAgreesWithPathTracing) {
  const auto make = [](const Scene& scene, const sensor::Camera& camera,
                       const RasterWindow& raster) {
    return std::make_unique<MultiplexedTracer>(scene, camera, settings(), raster,
                                               std::vector<double>{1, 2, 3, 3, 3});
  };
  expect_same(traced_by_paths(GetParam(), 240000),
              test::trace_with(GetParam().scene(), make, 480000, 43, kGrid));
}

INSTANTIATE_TEST_SUITE_P(Scenes, Bidirectional, testing::ValuesIn(cases()),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace metrofarm::transport
