// Scenes built in code, for tests of everything that traces rays.
#pragma once

#include <initializer_list>
#include <utility>

#include "scene/description.h"

namespace metrofarm::test {

// A scene under construction; every call returns what later calls name it by.
class SceneBuilder {
 public:
  SceneBuilder() {
    scene_.film.width = scene_.film.height = 16;
    scene_.film.filter = scene::ReconstructionFilter::kBox;
    scene_.film.filter_radius = 0.5;
  }

  template <class Model>
  scene::Index material(const Model& model) {
    scene_.bsdfs.push_back({model, "", {}});
    return static_cast<scene::Index>(scene_.bsdfs.size() - 1);
  }
  scene::Index diffuse(float reflectance) {
    return material(scene::Diffuse{{reflectance, reflectance, reflectance}});
  }
  template <class Model>
  scene::Index emitter(const Model& model) {
    scene_.emitters.push_back({model, {}});
    return static_cast<scene::Index>(scene_.emitters.size() - 1);
  }
  scene::Index area_light(float radiance) {
    return emitter(scene::AreaEmitter{{radiance, radiance, radiance}});
  }

  template <class Geometry>
  SceneBuilder& shape(Geometry geometry, scene::Index bsdf, scene::Index light = scene::kNone,
                      bool flip = false) {
    scene_.shapes.push_back({std::move(geometry), bsdf, light, flip, "", {}});
    return *this;
  }

  // Camera at a position, looking along +z with +y up.
  SceneBuilder& camera(scene::Point at, double fov_degrees) {
    scene_.sensor.to_world = {1, 0, 0, at[0], 0, 1, 0, at[1], 0, 0, 1, at[2], 0, 0, 0, 1};
    scene_.sensor.fov_x_degrees = fov_degrees;
    return *this;
  }

  scene::SceneDescription& description() { return scene_; }
  scene::SceneDescription take() { return std::move(scene_); }

 private:
  scene::SceneDescription scene_;
};

// A parallelogram with corner and edges; its normal is edge_u x edge_v.
inline scene::TriangleMesh quad(scene::Point corner, scene::Point edge_u, scene::Point edge_v) {
  scene::TriangleMesh mesh;
  for (auto [a, b] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
    for (int k = 0; k < 3; ++k)
      mesh.positions.push_back(static_cast<float>(corner[k] + a * edge_u[k] + b * edge_v[k]));
  }
  mesh.indices = {0, 1, 2, 0, 2, 3};
  return mesh;
}

// The axis-aligned box [low, high]^3, normals outwards.
inline scene::TriangleMesh box(scene::Point low, scene::Point high) {
  scene::TriangleMesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    for (int k = 0; k < 3; ++k)
      mesh.positions.push_back(static_cast<float>((corner >> k & 1) != 0 ? high[k] : low[k]));
  }
  mesh.indices = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                  2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
  return mesh;
}

// The disk of a radius around a center, its normal (0, 0, 1) or, turned, (0, 0, -1).
inline scene::Disk disk(scene::Point center, double radius, bool turned = false) {
  const double r = radius, flip = turned ? -radius : radius;
  return {{r, 0, 0, center[0], 0, flip, 0, center[1], 0, 0, flip, center[2], 0, 0, 0, 1}};
}

// The same scene in a unit `factor` times smaller: lengths and positions grow, radiance stays.
inline void scale(scene::SceneDescription& scene, double factor) {
  for (scene::Shape& shape : scene.shapes) {
    if (auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry)) {
      for (float& p : mesh->positions) p = static_cast<float>(p * factor);
    } else if (auto* sphere = std::get_if<scene::Sphere>(&shape.geometry)) {
      for (double& c : sphere->center) c *= factor;
      sphere->radius *= factor;
    } else {
      const auto grow = [&](scene::Matrix& m) {
        for (int i = 0; i < 12; ++i) m[i] *= factor;
      };
      if (auto* flat = std::get_if<scene::Disk>(&shape.geometry)) grow(flat->to_world);
      if (auto* round = std::get_if<scene::Cylinder>(&shape.geometry)) grow(round->to_world);
    }
  }
  scene.sensor.near_clip *= factor;
  scene.sensor.far_clip *= factor;
  for (int i : {3, 7, 11}) scene.sensor.to_world[i] *= factor;
  for (scene::Emitter& emitter : scene.emitters) {
    auto* point = std::get_if<scene::PointEmitter>(&emitter.model);
    if (point == nullptr) continue;
    for (double& p : point->position) p *= factor;
    for (float& i : point->intensity) i = static_cast<float>(i * factor * factor);
  }
}

}  // namespace metrofarm::test
