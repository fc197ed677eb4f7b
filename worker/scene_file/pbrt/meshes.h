// The shapes of pbrt that become triangle meshes.
#pragma once

#include "scene_file/mesh.h"
#include "scene_file/pbrt/context.h"

namespace metrofarm::scene_file::pbrt {

// Each in the space of the shape; what it returns is not valid after a problem.
RawMesh read_triangle_mesh(Parameters& parameters, Context& context);
RawMesh read_ply_mesh(Parameters& parameters, Context& context);
RawMesh read_bilinear_mesh(Parameters& parameters, Context& context);
RawMesh read_loop_subdivision(Parameters& parameters, Context& context);

// Places a mesh as pbrt does: without normals it is flat, with normals the winding of each triangle
// follows them; its outside stays outside under mirroring transforms.
Result<scene::TriangleMesh> place_mesh(RawMesh raw, const Matrix& to_world);

}  // namespace metrofarm::scene_file::pbrt
