// A scene ready to be traced.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "bsdf/materials.h"
#include "emitter/light_table.h"
#include "geometry/placements.h"
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

// What of a scene no shutter changes.
struct SceneStock {
  SceneStock(scene::SceneDescription of, std::string_view instructions)
      : description(std::move(of)),
        isa(instructions),
        primitives(geometry::build_primitives(description)),
        images(std::move(description.images)),
        textures(description.textures, images, primitives),
        materials(description.bsdfs, textures),
        stands_still(!scene::has_motion(description)) {}

  scene::SceneDescription description;
  std::string isa;
  geometry::Primitives primitives;
  texture::Images images;
  texture::Textures textures;
  bsdf::Materials materials;
  bool stands_still;
};

// Owns all that rays meet; immutable and shared by all threads. The camera is not part of it: its
// film size belongs to the job.
class Scene {
 public:
  // While the sensor's own shutter is open. Mesh data and images are moved out of the description.
  // Throws std::bad_alloc if geometry and acceleration structure take more than max_bytes.
  Scene(scene::SceneDescription description, std::string_view isa,
        uint64_t max_bytes = geometry::kAnyBytes)
      : Scene(std::make_shared<SceneStock>(std::move(description), isa), max_bytes) {}

  // The same scene, whose stock is shared, at another time. Throws std::bad_alloc if acceleration
  // structure and what moves, which are its own, take more than max_bytes.
  Scene(const Scene& other, const motion::Interval& interval,
        uint64_t max_bytes = geometry::kAnyBytes)
      : Scene(other.stock_, interval, max_bytes) {}

  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  const scene::SceneDescription& description() const { return stock_->description; }
  const geometry::Primitives& primitives() const { return stock_->primitives; }
  const geometry::Placements& placements() const { return placements_; }
  const geometry::Tracer& tracer() const { return tracer_; }
  const bsdf::Materials& materials() const { return stock_->materials; }
  const emitter::LightTable& lights() const { return lights_; }

  // From the begin of which to the end of which times go from 0 to 1.
  const motion::Interval& interval() const { return placements_.interval(); }
  bool anything_moves() const { return placements_.anything_moves() || lights_.anything_moves(); }
  // Whether the scene is also what it is at another time: nothing ever moves.
  bool stands_still() const { return stock_->stands_still; }

  // What of a surface some material or light asks for; the rest is not computed.
  geometry::SurfaceNeeds surface_needs() const { return needs_; }

  SceneBytes bytes() const {
    return {stock_->primitives.bytes() + placements_.bytes(), tracer_.bytes(),
            stock_->images.bytes() + stock_->textures.bytes(), lights_.bytes()};
  }
  // Those that it does not share with the same scene at other times.
  uint64_t own_bytes() const { return placements_.bytes() + tracer_.bytes() + lights_.bytes(); }

 private:
  Scene(const std::shared_ptr<const SceneStock>& stock, uint64_t max_bytes)
      : Scene(stock,
              {stock->description.sensor.shutter_open, stock->description.sensor.shutter_close},
              rest_of(max_bytes, stock->primitives.bytes())) {}

  // max_bytes: of what is its own, but for the lights.
  Scene(std::shared_ptr<const SceneStock> stock, const motion::Interval& interval,
        uint64_t max_bytes)
      : stock_(std::move(stock)),
        placements_(stock_->description, stock_->primitives, interval, max_bytes),
        tracer_(stock_->primitives, placements_, stock_->isa,
                rest_of(max_bytes, placements_.bytes())),
        lights_(stock_->description, stock_->primitives, placements_, stock_->images,
                stock_->textures) {
    needs_ = stock_->materials.needs();
    needs_.uv = needs_.uv || lights_.wants_uv();
  }

  static uint64_t rest_of(uint64_t bytes, uint64_t taken) { return bytes - std::min(bytes, taken); }

  std::shared_ptr<const SceneStock> stock_;
  geometry::Placements placements_;
  geometry::Tracer tracer_;
  emitter::LightTable lights_;
  geometry::SurfaceNeeds needs_;
};

}  // namespace metrofarm::transport
