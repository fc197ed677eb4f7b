#include "scene_file/mitsuba/primitive_shapes.h"

#include <cmath>
#include <utility>

#include "motion/track.h"
#include "scene_file/mesh.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Shape;

void finish_into(RawMesh raw, Properties& properties, Shape& shape, Context& context) {
  Result<scene::TriangleMesh> mesh =
      finish_mesh(std::move(raw), {.to_world = properties.transform("to_world")});
  if (!mesh) return context.problems.fail(mesh.error().message, shape.where);
  shape.geometry = std::move(mesh.value());
}

}  // namespace

void load_rectangle(Properties& properties, Shape& shape, Context& context) {
  RawMesh raw;
  raw.positions = {-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0};
  raw.normals = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
  raw.texcoords = {0, 0, 1, 0, 0, 1, 1, 1};
  raw.indices = {0, 1, 2, 2, 1, 3};
  properties.ignore({"face_normals"});
  finish_into(std::move(raw), properties, shape, context);
}

// Each face is given by its normal and the direction in which u grows; the numbering of vertices,
// triangles and texture coordinates is Mitsuba's.
void load_cube(Properties& properties, Shape& shape, Context& context) {
  struct Face {
    Point normal;
    Point u;
  };
  constexpr Face kFaces[] = {
      {{0, -1, 0}, {0, 0, 1}}, {{0, 1, 0}, {-1, 0, 0}}, {{1, 0, 0}, {0, 1, 0}},
      {{0, 0, 1}, {0, 1, 0}},  {{-1, 0, 0}, {0, 1, 0}}, {{0, 0, -1}, {0, -1, 0}},
  };
  constexpr double kCorners[4][2] = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  RawMesh raw;
  for (const Face& face : kFaces) {
    const auto first = static_cast<uint32_t>(raw.vertex_count());
    const Point v = cross(face.normal, face.u);
    for (const auto& [s, t] : kCorners) {
      for (int axis = 0; axis < 3; ++axis) {
        const double corner =
            face.normal[axis] + (2 * s - 1) * face.u[axis] - (2 * t - 1) * v[axis];
        raw.positions.push_back(static_cast<float>(corner));
      }
      raw.normals.insert(raw.normals.end(), face.normal.begin(), face.normal.end());
      raw.texcoords.insert(raw.texcoords.end(), {static_cast<float>(s), static_cast<float>(t)});
    }
    for (uint32_t corner : {0U, 1U, 2U, 3U, 0U, 2U}) raw.indices.push_back(first + corner);
  }
  properties.ignore({"face_normals"});
  finish_into(std::move(raw), properties, shape, context);
}

void load_sphere(Properties& properties, Shape& shape, Context& context) {
  scene::Sphere sphere;
  const Matrix to_world = properties.transform("to_world");
  sphere.center = transform_point(to_world, properties.point("center", {0, 0, 0}));
  const double radius = properties.number("radius", 1);
  const double scale = length(column(to_world, 0));
  constexpr double kTolerance = 1e-4;
  if (!(radius > 0)) {
    context.problems.fail("the radius of a sphere must be greater than 0",
                          properties.find("radius")->where);
  } else if (!(scale > 0) ||
             deviation_from_rotation(to_world, scale) > kTolerance * scale * scale) {
    context.problems.fail(
        "a sphere's to_world must scale equally in all directions; for an "
        "ellipsoid use a mesh",
        properties.find("to_world")->where);
  }
  sphere.radius = radius * scale;
  for (int axis = 0; axis < 3; ++axis) {
    const Point image = normalized(column(to_world, axis));
    for (int row = 0; row < 3; ++row) sphere.rotation[3 * row + axis] = image[row];
  }
  // A mirrored sphere is seen from inside, also where its motion mirrors it.
  if (determinant(to_world) < 0 || motion::mirrors(shape.motion))
    shape.flip_normals = !shape.flip_normals;
  properties.ignore({"subdiv"});
  shape.geometry = sphere;
}

void load_disk(Properties& properties, Shape& shape, Context& context) {
  scene::Disk disk;
  disk.to_world = properties.transform("to_world");
  const Point normal = normalized(cross(column(disk.to_world, 0), column(disk.to_world, 1)));
  if (length(normal) == 0) {
    return context.problems.fail("a disk's to_world must not flatten it to a line",
                                 properties.find("to_world")->where);
  }
  // Only the first two axes shape a disk: with a flat third one the matrix would have no inverse.
  if (determinant(disk.to_world) == 0) {
    for (int axis = 0; axis < 3; ++axis) disk.to_world[4 * axis + 2] = normal[axis];
  }
  shape.geometry = disk;
}

// The frame around the axis is Mitsuba's, so that u starts at the same side.
void load_cylinder(Properties& properties, Shape& shape, Context& context) {
  const Point p0 = properties.point("p0", {0, 0, 0});
  const Point p1 = properties.point("p1", {0, 0, 1});
  const double radius = properties.number("radius", 1);
  const Point axis = subtract(p1, p0);
  const double height = length(axis);
  if (!(radius > 0)) {
    return context.problems.fail("the radius of a cylinder must be greater than 0",
                                 properties.find("radius")->where);
  }
  if (!(height > 0)) {
    return context.problems.fail("the ends p0 and p1 of a cylinder must differ", shape.where);
  }
  const Point z = normalized(axis);
  const Point x = any_perpendicular(z);
  const Point y = cross(z, x);
  const Matrix frame = {radius * x[0],
                        radius * y[0],
                        axis[0],
                        p0[0],  //
                        radius * x[1],
                        radius * y[1],
                        axis[1],
                        p0[1],  //
                        radius * x[2],
                        radius * y[2],
                        axis[2],
                        p0[2],  //
                        0,
                        0,
                        0,
                        1};
  const Matrix to_world = multiply(properties.transform("to_world"), frame);
  const Point images[3] = {column(to_world, 0), column(to_world, 1), column(to_world, 2)};
  constexpr double kTolerance = 1e-4;
  const double across = length(images[0]);
  const double along = length(images[2]);
  const bool round = across > 0 && std::abs(length(images[1]) - across) <= kTolerance * across &&
                     std::abs(dot(images[0], images[1])) <= kTolerance * across * across;
  const bool upright = along > 0 &&
                       std::abs(dot(images[0], images[2])) <= kTolerance * across * along &&
                       std::abs(dot(images[1], images[2])) <= kTolerance * across * along;
  if (!round || !upright) {
    // Numbers near the largest ones get here without a to_world.
    const Element* transform = properties.find("to_world");
    return context.problems.fail(
        "a cylinder's to_world must not shear it or scale it unequally across its axis; for "
        "others use a mesh",
        transform ? transform->where : shape.where);
  }
  shape.geometry = scene::Cylinder{to_world};
}

}  // namespace metrofarm::scene_file::mitsuba
