// Shapes of pbrt as geometry of the scene.
#pragma once

#include <optional>

#include "scene_file/pbrt/context.h"
#include "scene_file/pbrt/textures.h"

namespace metrofarm::scene_file::pbrt {

struct Placement {
  Matrix to_world = kIdentity;
  bool reverse_orientation = false;
  bool mirrored_later = false;  // it moves, and its poses mirror it
};

// Only geometry, flip_normals and where of the shape are set.
struct PlacedShape {
  scene::Shape shape;
  UvMatrix uv = scene::kIdentityUv;  // from the shape's surface coordinates to those of pbrt
};

// Nothing after a problem, and for a shape that is left out under leniency.
std::optional<PlacedShape> load_shape(Entity& entity, const Placement& placement, Context& context);

// In world units squared, at that time if it moves; of meshes the areas of their triangles, as pbrt
// makes a light of each. Of a sphere that a pose makes an ellipsoid: that of the sphere of the same
// volume.
std::vector<double> areas_of(const scene::Shape& shape, double time);

// The same surface seen from its other side, moved by about 1e-4 of its size to that side.
scene::Shape opposite_side(const scene::Shape& shape);

}  // namespace metrofarm::scene_file::pbrt
