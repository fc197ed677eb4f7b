// A scene ready to be traced.
#pragma once

#include <algorithm>
#include <memory>
#include <string_view>

#include "bsdf/materials.h"
#include "emitter/light_table.h"
#include "geometry/primitives.h"
#include "geometry/tracer.h"
#include "scene/description.h"
#include "texture/images.h"
#include "texture/textures.h"

namespace metrofarm::transport {

// What a scene takes in memory, by what for.
struct SceneBytes {
  uint64_t geometry = 0;      // vertices, indices, shapes
  uint64_t acceleration = 0;  // Embree's own
  uint64_t images = 0;        // textures and environment maps
  uint64_t lights = 0;        // light sampling tables

  uint64_t total() const { return geometry + acceleration + images + lights; }
};

// Owns all that rays meet; immutable and shared by all threads. The camera is not part of it: its
// film size belongs to the job.
class Scene {
 public:
  // Mesh data and images are moved out of the description. Throws std::bad_alloc if geometry and
  // acceleration structure take more than max_bytes.
  Scene(scene::SceneDescription description, std::string_view isa,
        uint64_t max_bytes = geometry::Tracer::kAnyBytes)
      : description_(std::move(description)),
        primitives_(geometry::build_primitives(description_)),
        tracer_(primitives_, isa, max_bytes - std::min(max_bytes, primitives_.bytes())),
        images_(std::move(description_.images)),
        textures_(description_.textures, images_, primitives_),
        materials_(description_.bsdfs, textures_),
        lights_(description_, primitives_, images_, textures_) {
    needs_ = materials_.needs();
    needs_.uv = needs_.uv || lights_.wants_uv();
  }

  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  const scene::SceneDescription& description() const { return description_; }
  const geometry::Primitives& primitives() const { return primitives_; }
  const geometry::Tracer& tracer() const { return tracer_; }
  const bsdf::Materials& materials() const { return materials_; }
  const emitter::LightTable& lights() const { return lights_; }

  // What of a surface some material or light asks for; the rest is not computed.
  geometry::SurfaceNeeds surface_needs() const { return needs_; }

  SceneBytes bytes() const {
    return {primitives_.bytes(), tracer_.bytes(), images_.bytes() + textures_.bytes(),
            lights_.bytes()};
  }

 private:
  scene::SceneDescription description_;
  geometry::Primitives primitives_;
  geometry::Tracer tracer_;
  texture::Images images_;
  texture::Textures textures_;
  bsdf::Materials materials_;
  emitter::LightTable lights_;
  geometry::SurfaceNeeds needs_;
};

}  // namespace metrofarm::transport
