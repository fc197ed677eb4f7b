// A scene ready to be traced.
#pragma once

#include <memory>
#include <string_view>

#include "bsdf/materials.h"
#include "emitter/light_table.h"
#include "geometry/primitives.h"
#include "geometry/tracer.h"
#include "scene/description.h"
#include "sensor/perspective.h"

namespace metrofarm::transport {

// Owns all that rays meet; immutable and shared by all threads. The camera is not part of it: its
// film size belongs to the job.
class Scene {
 public:
  // Mesh data is moved out of the description.
  Scene(scene::SceneDescription description, std::string_view isa)
      : description_(std::move(description)),
        primitives_(geometry::build_primitives(description_)),
        tracer_(primitives_, isa),
        materials_(description_.bsdfs),
        lights_(description_, primitives_) {}

  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  const scene::SceneDescription& description() const { return description_; }
  const geometry::Primitives& primitives() const { return primitives_; }
  const geometry::Tracer& tracer() const { return tracer_; }
  const bsdf::Materials& materials() const { return materials_; }
  const emitter::LightTable& lights() const { return lights_; }

  uint64_t bytes() const { return primitives_.bytes() + tracer_.bytes() + lights_.bytes(); }

 private:
  scene::SceneDescription description_;
  geometry::Primitives primitives_;
  geometry::Tracer tracer_;
  bsdf::Materials materials_;
  emitter::LightTable lights_;
};

}  // namespace metrofarm::transport
