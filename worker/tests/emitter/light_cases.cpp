#include "tests/emitter/light_cases.h"

#include <cmath>
#include <utility>

#include "tests/emitter/lights.h"
#include "tests/support/scenes.h"

namespace metrofarm::test {
namespace {

LightCase make(std::string name, SceneBuilder& builder, Double3 reference) {
  return {std::move(name), builder.take(), reference};
}

LightCase narrow(LightCase c, Double3 axis, double one_minus_cos) {
  c.axis = normalize(axis);
  c.one_minus_cos = one_minus_cos;
  return c;
}

LightCase mesh_case(bool flip) {
  SceneBuilder b;
  b.shape(box({-1, -0.5, 1}, {1.5, 0.5, 2}), b.diffuse(0.5F), b.area_light(3), flip);
  return make(flip ? "inside_a_box" : "outside_a_box", b,
              flip ? Double3{0.3, 0.1, 1.7} : Double3{-1.5, 1.2, 0.2});
}

LightCase sphere_case(std::string name, Double3 reference, bool flip) {
  SceneBuilder b;
  b.shape(scene::Sphere{{0.2, -0.1, 0.3}, 1.5}, b.diffuse(0.5F), b.area_light(2), flip);
  return make(std::move(name), b, reference);
}

LightCase disk_case() {
  SceneBuilder b;
  const double s = std::sqrt(0.5);
  // An ellipse, tilted about x.
  scene::Disk tilted{{1.5, 0, 0, 0.5, 0, 0.4 * s, -s, 0, 0, 0.4 * s, s, -0.5, 0, 0, 0, 1}};
  b.shape(tilted, b.diffuse(0.5F), b.area_light(1));
  return narrow(make("disk", b, {0.1, -1.2, 0.6}), {0.4, 1.7, -1.1}, 0.4);
}

LightCase constant_case() {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{1, 2, 3}});
  b.shape(scene::Sphere{{2, 0, 0}, 1}, b.diffuse(0.5F));
  return make("environment_partly_hidden", b, {0, 0, 0});
}

LightCase not_grazing(LightCase c) {
  c.least_cosine = 0.25;
  return c;
}

LightCase cylinder_case(std::string name, Double3 reference, bool flip) {
  SceneBuilder b;
  const double s = std::sqrt(0.5);
  // Radius 0.5, length 2, its axis between y and z.
  scene::Cylinder c{{0.5, 0, 0, 0.1, 0, 0.5 * s, -2 * s, 0.7, 0, 0.5 * s, 2 * s, -0.5, 0, 0, 0, 1}};
  b.shape(c, b.diffuse(0.5F), b.area_light(1.5F), flip);
  return not_grazing(make(std::move(name), b, reference));
}

// Radiance of a checkerboard, one side of which is black.
scene::Index checkered_light(SceneBuilder& b, float columns, float rows) {
  const scene::UvMatrix to_uv = {columns, 0, 0.13F, 0, rows, 0.2F};
  std::vector<scene::Texture>& textures = b.description().textures;
  textures.push_back({scene::CheckerboardTexture{{0.9F, 0.3F, 0.1F}, {0, 0, 0}, to_uv}, "", {}});
  const auto texture = static_cast<scene::Index>(textures.size() - 1);
  return b.emitter(scene::AreaEmitter{{{1, 2, 3}, texture}});
}

LightCase textured_case() {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  scene::TriangleMesh wall = quad({-1, -1, -2}, {2, 0, 0}, {0, 2, 0});
  wall.texcoords = {0, 0, 1, 0, 1, 1, 0, 1};
  b.shape(wall, grey, checkered_light(b, 1, 1));
  b.shape(scene::Sphere{{2, 0, 0.5}, 0.9}, grey, checkered_light(b, 2, 2));
  b.shape(disk({0, 0, 2}, 1.5, true), grey, checkered_light(b, 1, 2));
  b.shape(scene::Cylinder{{0.7, 0, 0, -2, 0, 0.7, 0, 0, 0, 0, 0.7, -1.2, 0, 0, 0, 1}}, grey,
          checkered_light(b, 2, 1));
  return not_grazing(make("textured", b, {0, 0, 0.1}));
}

// Vertex normals that lean far to one side: what is in front is for them to say.
LightCase leaning_normals_case() {
  SceneBuilder b;
  scene::TriangleMesh wall = quad({-1, -1, -1}, {2, 0, 0}, {0, 2, 0});
  for (int i = 0; i < 4; ++i) wall.normals.insert(wall.normals.end(), {0.8F, 0, 0.6F});
  b.shape(wall, b.diffuse(0.5F), b.area_light(1));
  return make("leaning_normals", b, {0.4, 0, -0.6});
}

// A map of this size, turned, mirrored and scaled.
template <class Brightness>
LightCase map_case(std::string name, int width, int height, Brightness&& brightness) {
  SceneBuilder b;
  b.description().images.push_back(map_image(width, height, brightness));
  b.emitter(
      scene::EnvironmentEmitter{0, 2, {-1.6, 0, 1.2, 5, 0, 2, 0, 6, 1.2, 0, 1.6, 7, 0, 0, 0, 1}});
  return make(std::move(name), b, {0, 0, 0});
}

std::vector<LightCase> map_cases() {
  const auto one = [](int, int) { return 1.F; };
  const auto ramp = [](int x, int y) {
    return 0.1F + 0.01F * static_cast<float>((7 * x + 3 * y) % 11);
  };
  std::vector<LightCase> cases = {
      map_case("map_of_one_pixel", 1, 1, one), map_case("map_of_two_pixels", 2, 1, ramp),
      map_case("map_of_one_column", 1, 7, ramp), map_case("map_13_x_7", 13, 7, ramp)};
  cases.push_back(map_case("map_with_black_parts", 12, 9, [](int x, int y) {
    return x / 3 % 2 == 0 && y > 2 ? static_cast<float>(1 + y) : 0.F;
  }));
  const auto sun = [](int column, int row) {
    return [=](int x, int y) { return x == column && y == row ? 5000.F : 1.F; };
  };
  cases.push_back(map_case("map_with_a_bright_pixel", 31, 17, sun(8, 6)));
  cases.push_back(map_case("map_with_a_bright_pixel_at_the_seam", 24, 17, sun(0, 9)));
  cases.push_back(map_case("map_with_bright_poles", 24, 17, [](int x, int y) {
    return y == 0 || y == 16 ? 100.F + static_cast<float>(x) : 0.2F;
  }));
  return cases;
}

LightCase map_and_constant_case() {
  LightCase c = map_case("map_and_constant", 6, 5, [](int x, int) { return x == 2 ? 3.F : 0.F; });
  c.scene.emitters.push_back({scene::ConstantEmitter{{0.2F, 0.3F, 0.4F}}, {}});
  c.scene.bsdfs.push_back({scene::Diffuse{}, "", {}});
  c.scene.shapes.push_back({scene::Sphere{{2, 0, 0}, 1}, 0, scene::kNone, false, "", {}});
  return c;
}

LightCase several_case() {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.emitter(scene::ConstantEmitter{{0.3F, 0.3F, 0.3F}});
  b.shape(scene::Sphere{{2, 0, 0.5}, 0.7}, grey, b.area_light(4));
  b.shape(quad({-1, -1, -2}, {2, 0, 0}, {0, 2, 0}), grey, b.area_light(2));
  b.shape(disk({0, 0, 3}, 0.8, true), grey, b.area_light(5));
  b.shape(scene::Sphere{{1, 0, 0.2}, 0.2}, grey);
  return make("several_partly_hidden", b, {0, 0, 0.1});
}

}  // namespace

std::vector<LightCase> light_cases() {
  std::vector<LightCase> cases = {mesh_case(false),
                                  mesh_case(true),
                                  sphere_case("sphere_from_outside", {2.5, 1, 0.4}, false),
                                  sphere_case("sphere_from_inside", {0.9, 0.3, -0.4}, true),
                                  disk_case(),
                                  constant_case(),
                                  cylinder_case("cylinder_from_outside", {1.2, -0.4, 0.3}, false),
                                  cylinder_case("cylinder_from_inside", {0.2, 0.2, 0.1}, true),
                                  textured_case(),
                                  leaning_normals_case(),
                                  map_and_constant_case(),
                                  several_case()};
  for (LightCase& c : map_cases()) cases.push_back(std::move(c));
  cases.push_back(
      narrow(sphere_case("sphere_from_afar", {300.2, -0.1, 0.3}, false), {-1, 0, 0}, 1.4e-5));
  cases.push_back(
      narrow(sphere_case("sphere_from_very_near", {1.7008, -0.1, 0.3}, false), {-1, 0, 0}, 1));
  return cases;
}

}  // namespace metrofarm::test
