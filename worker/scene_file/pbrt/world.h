// Collects shapes, lights and instances; materials are attached when all of the file is known.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "scene_file/pbrt/context.h"
#include "scene_file/pbrt/graphics_state.h"
#include "scene_file/pbrt/materials.h"
#include "scene_file/pbrt/textures.h"

namespace metrofarm::scene_file::pbrt {

class World {
 public:
  explicit World(Context& context)
      : context_(context), textures_(context), materials_(context, textures_) {}

  Textures& textures() { return textures_; }
  Materials& materials() { return materials_; }

  void add_shape(Entity entity, const GraphicsState& state);
  void add_light(Entity entity, const GraphicsState& state);

  // Shapes between these two go to the object instead of the world.
  void begin_object(const std::string& name, const SourceLocation& where);
  void end_object() { object_ = nullptr; }
  bool in_object() const { return object_ != nullptr; }

  // The object may be defined later.
  void add_instance(const std::string& name, const GraphicsState& state,
                    const SourceLocation& where);

  // Requires: the whole file was read.
  void finish();

 private:
  struct Object {
    scene::Index group = scene::kNone;  // until it has a shape
    SourceLocation where;
  };
  // What the shape with the same index waits for.
  struct Pending {
    Materials::Use material = 0;
    UvMatrix uv = scene::kIdentityUv;
    std::optional<Parameter> alpha;
  };
  struct NamedInstance {
    std::string name;
    scene::Instance instance;
  };

  Matrix pose_in_object(const scene::Motion& motion, const SourceLocation& where);
  void add(scene::Shape shape, Pending pending);
  void make_light(const AreaLight& light, scene::Shape shape, const Pending& pending);
  void attach_materials();
  void attach_instances();

  Context& context_;
  Textures textures_;
  Materials materials_;
  std::vector<Pending> pending_;
  std::map<std::string, Object> objects_;
  Object* object_ = nullptr;
  scene::Index group_count_ = 0;
  std::vector<NamedInstance> instances_;
};

}  // namespace metrofarm::scene_file::pbrt
