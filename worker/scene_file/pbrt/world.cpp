#include "scene_file/pbrt/world.h"

#include "motion/track.h"
#include "scene_file/names.h"
#include "scene_file/pbrt/shapes.h"

namespace metrofarm::scene_file::pbrt {

// Shapes of objects can't move by themselves.
Matrix World::pose_in_object(const scene::Motion& motion, const SourceLocation& where) {
  context_.problems.warn(
      "a shape of an object moves with its instances only; this one stands where it is when the "
      "file's shutter opens",
      where);
  return motion::Track(motion).at(context_.scene.sensor.shutter_open);
}

void World::add_shape(Entity entity, const GraphicsState& state) {
  const SourceLocation where = entity.where();
  Pending pending;
  pending.material = state.material;
  if (const Parameter* alpha = entity.parameters.find("alpha")) pending.alpha = *alpha;
  scene::Motion motion = motion_between(state.transform, where, context_);
  Placement placement{state.transform[0], state.reverse_orientation};
  if (!motion.empty() && in_object()) {
    placement.to_world = pose_in_object(motion, where);
  } else if (!motion.empty()) {
    placement.to_world = kIdentity;
    placement.mirrored_later = motion::mirrors(motion);
  }
  std::optional<PlacedShape> placed = load_shape(entity, placement, context_);
  if (!placed) return;
  pending.uv = placed->uv;
  if (!in_object()) placed->shape.motion = std::move(motion);
  if (!state.area_light) return add(std::move(placed->shape), std::move(pending));
  if (in_object()) {
    context_.problems.warn("a shape of an object can't be a light: its AreaLightSource is ignored",
                           where);
    return add(std::move(placed->shape), std::move(pending));
  }
  make_light(*state.area_light, std::move(placed->shape), pending);
}

void World::make_light(const AreaLight& light, scene::Shape shape, const Pending& pending) {
  shape.area_emitter = add_area_emitter(light, shape, context_);
  if (light.two_sided) {
    context_.problems.warn(
        "a light that shines from both sides is made of two surfaces close "
        "to each other",
        shape.where);
    add(opposite_side(shape), pending);
    context_.scene.shapes.back().area_emitter =
        append(context_.scene.emitters,
               scene::Emitter(context_.scene.emitters[static_cast<size_t>(shape.area_emitter)]));
  }
  add(std::move(shape), pending);
}

void World::add(scene::Shape shape, Pending pending) {
  if (const std::optional<Error> error = context_.files.memory().take_object()) {
    context_.problems.fail(error->message, shape.where);
  }
  if (in_object()) {
    if (object_->group == scene::kNone) object_->group = group_count_++;
    shape.group = object_->group;
  }
  context_.scene.shapes.push_back(std::move(shape));
  pending_.push_back(std::move(pending));
}

void World::add_light(Entity entity, const GraphicsState& state) {
  if (in_object()) {
    return context_.problems.fail("a LightSource can't be part of an object", entity.where());
  }
  scene::Motion motion = motion_between(state.transform, entity.where(), context_);
  if (!motion.empty() && entity.type == "infinite") {
    context_.problems.warn("infinite lights don't move; this one stays where its motion starts",
                           entity.where());
    motion = {};
  }
  const size_t first = context_.scene.emitters.size();
  load_light(entity, motion.empty() ? state.transform[0] : kIdentity, context_);
  for (size_t i = first; i < context_.scene.emitters.size(); ++i)
    context_.scene.emitters[i].motion = motion;
}

void World::begin_object(const std::string& name, const SourceLocation& where) {
  const auto [found, is_new] = objects_.emplace(name, Object{scene::kNone, where});
  if (!is_new) {
    context_.problems.fail("object \"" + name + "\" is already defined in line " +
                               std::to_string(found->second.where.line) + "; names must be unique",
                           where);
  }
  object_ = &found->second;
}

void World::add_instance(const std::string& name, const GraphicsState& state,
                         const SourceLocation& where) {
  if (in_object()) {
    return context_.problems.fail("an ObjectInstance can't stand inside of an object", where);
  }
  if (const std::optional<Error> error = context_.files.memory().take_object()) {
    return context_.problems.fail(error->message, where);
  }
  scene::Instance instance;
  instance.motion = motion_between(state.transform, where, context_);
  if (instance.motion.empty()) instance.to_world = state.transform[0];
  instance.where = where;
  if (flattens(instance.to_world)) {
    return context_.problems.fail("the transform of an ObjectInstance must not flatten it", where);
  }
  instances_.push_back({name, std::move(instance)});
}

void World::finish() {
  attach_materials();
  attach_instances();
}

void World::attach_materials() {
  for (size_t i = 0; i < pending_.size() && !context_.problems.failed(); ++i) {
    const Pending& pending = pending_[i];
    scene::Index bsdf = materials_.build(pending.material, pending.uv);
    if (pending.alpha) bsdf = materials_.build_mask(*pending.alpha, bsdf, pending.uv);
    context_.scene.shapes[i].bsdf = bsdf;
  }
}

void World::attach_instances() {
  std::vector<std::string_view> known;
  for (const auto& [name, unused] : objects_) known.push_back(name);
  for (NamedInstance& named : instances_) {
    const auto found = objects_.find(named.name);
    if (found == objects_.end()) {
      return context_.problems.fail(
          "no object is named \"" + named.name + "\"" + suggestion(named.name, known),
          named.instance.where);
    }
    named.instance.group = found->second.group;
    if (named.instance.group == scene::kNone) continue;  // an object without shapes
    context_.scene.instances.push_back(std::move(named.instance));
  }
}

}  // namespace metrofarm::scene_file::pbrt
