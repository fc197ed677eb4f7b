// Vertex normals computed from the triangles around each vertex.
#pragma once

#include "scene_file/mesh.h"

namespace metrofarm::scene_file {

// Gives every vertex whose normal is (0, 0, 0), or that has none, the mean of the unit normals of
// the triangles around it, weighted by their angles there (Thuermer and Wuethrich 1998): it doesn't
// depend on how a polygon was cut into triangles. Normals of unused vertices are any unit vector.
void complete_normals(RawMesh& mesh);

// Replaces all normals: at each corner the weighted mean over those triangles at the same position
// whose planes differ by at most `degrees`. Vertices are doubled where corners disagree. Where
// triangles of thousands of planes meet, similar planes count as one.
void smooth_up_to_angle(RawMesh& mesh, double degrees);

}  // namespace metrofarm::scene_file
