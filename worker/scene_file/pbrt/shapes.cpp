#include "scene_file/pbrt/shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "motion/track.h"
#include "scene_file/pbrt/meshes.h"

namespace metrofarm::scene_file::pbrt {
namespace {

constexpr double kTolerance = 1e-4;  // relative, of what counts as a similarity

struct Loader {
  Parameters& parameters;
  const Placement& placement;
  Context& context;
  PlacedShape& placed;
};

void fail(const Loader& loader, std::string message) {
  loader.context.problems.fail(std::move(message), loader.parameters.where());
}

template <RawMesh (*read)(Parameters&, Context&)>
void load_mesh(const Loader& loader) {
  RawMesh raw = read(loader.parameters, loader.context);
  if (loader.context.problems.failed()) return;
  Result<scene::TriangleMesh> mesh = place_mesh(std::move(raw), loader.placement.to_world);
  if (!mesh) return fail(loader, mesh.error().message);
  const std::optional<Error> error = loader.context.files.memory().take(mesh.value());
  if (error) return fail(loader, error->message);
  loader.placed.shape.geometry = std::move(mesh.value());
}

// pbrt flips the normals of its quadrics under mirroring transforms, of meshes it doesn't.
bool is_mirrored(const Loader& loader) {
  return determinant(loader.placement.to_world) < 0;
}

bool is_full_turn(const Loader& loader) {
  const double phi = loader.parameters.number("phimax", 360, loader.context.problems);
  return std::abs(phi) >= 360;
}

void refuse_part(const Loader& loader, std::string_view what, std::string_view wanted) {
  loader.context.problems.unsupported("only whole " + std::string(what) + " are supported: " +
                                          std::string(wanted) + "; for a part of one use a mesh",
                                      loader.parameters.where());
}

void load_sphere(const Loader& loader) {
  Problems& problems = loader.context.problems;
  const Matrix& m = loader.placement.to_world;
  const double radius = loader.parameters.positive("radius", 1, problems);
  const double zmin = loader.parameters.number("zmin", -radius, problems);
  const double zmax = loader.parameters.number("zmax", radius, problems);
  const bool whole = std::min(zmin, zmax) <= -radius && std::max(zmin, zmax) >= radius;
  if (!is_full_turn(loader) || !whole) {
    refuse_part(loader, "spheres", "\"zmin\", \"zmax\" and \"phimax\" must keep all of it");
  }
  const double scale = length(column(m, 0));
  if (!(scale > 0) || deviation_from_rotation(m, scale) > kTolerance * scale * scale) {
    return fail(loader,
                "the transform of a sphere must scale equally in all directions; for an "
                "ellipsoid use a mesh");
  }
  scene::Sphere sphere;
  sphere.center = column(m, 3);
  sphere.radius = radius * scale;
  const bool mirrored = is_mirrored(loader);
  for (size_t row = 0; row < 3; ++row) {
    for (size_t col = 0; col < 3; ++col) {
      const double sign = mirrored && col == 1 ? -1 : 1;
      sphere.rotation[3 * row + col] = sign * m[4 * row + col] / scale;
    }
  }
  // pbrt's v runs from the south pole, ours from the north; mirroring y reverses u.
  loader.placed.uv = {1, 0, 0, 0, -1, 1};
  if (mirrored) loader.placed.uv = {-1, 0, 1, 0, -1, 1};
  if (mirrored) loader.placed.shape.flip_normals = !loader.placed.shape.flip_normals;
  loader.placed.shape.geometry = sphere;
}

void load_disk(const Loader& loader) {
  Problems& problems = loader.context.problems;
  const double radius = loader.parameters.positive("radius", 1, problems);
  const double height = loader.parameters.number("height", 0, problems);
  if (!is_full_turn(loader) || loader.parameters.number("innerradius", 0, problems) != 0) {
    refuse_part(loader, "disks", "\"innerradius\" must be 0 and \"phimax\" 360");
  }
  const bool mirrored = is_mirrored(loader);
  const double y = mirrored ? -radius : radius;  // the same disk, the same normal
  scene::Disk disk;
  disk.to_world = multiply(loader.placement.to_world,
                           multiply(translation({0, 0, height}), scaling({radius, y, 1})));
  if (length(cross(column(disk.to_world, 0), column(disk.to_world, 1))) == 0) {
    return fail(loader, "the transform of a disk must not flatten it to a line");
  }
  // pbrt: u = phi / 2 pi, v = 1 - radius; here (radius, phi / 2 pi).
  loader.placed.uv = {0, 1, 0, -1, 0, 1};
  if (mirrored) loader.placed.uv = {0, -1, 1, -1, 0, 1};
  if (mirrored) loader.placed.shape.flip_normals = !loader.placed.shape.flip_normals;
  loader.placed.shape.geometry = disk;
}

void load_cylinder(const Loader& loader) {
  Problems& problems = loader.context.problems;
  const double radius = loader.parameters.positive("radius", 1, problems);
  const double z0 = loader.parameters.number("zmin", -1, problems);
  const double z1 = loader.parameters.number("zmax", 1, problems);
  if (!is_full_turn(loader)) refuse_part(loader, "cylinders", "\"phimax\" must be 360");
  const Matrix& m = loader.placement.to_world;
  const double scale = length(column(m, 0));
  const Point axes[3] = {normalized(column(m, 0)), normalized(column(m, 1)),
                         normalized(column(m, 2))};
  const double skew = std::max({std::abs(dot(axes[0], axes[1])), std::abs(dot(axes[0], axes[2])),
                                std::abs(dot(axes[1], axes[2]))});
  const bool round = std::abs(length(column(m, 1)) - scale) <= kTolerance * scale;
  if (z0 == z1 || determinant(m) == 0 || skew > kTolerance || !round) {
    return fail(loader,
                "a cylinder must have a height, and its transform must keep it round and "
                "upright; for others use a mesh");
  }
  const bool mirrored = is_mirrored(loader);
  const double low = std::min(z0, z1);
  scene::Cylinder cylinder;
  cylinder.to_world =
      multiply(m, multiply(translation({0, 0, low}),
                           scaling({radius, mirrored ? -radius : radius, std::max(z0, z1) - low})));
  if (mirrored) loader.placed.uv = {-1, 0, 1, 0, 1, 0};
  if (mirrored) loader.placed.shape.flip_normals = !loader.placed.shape.flip_normals;
  loader.placed.shape.geometry = cylinder;
}

struct Row {
  std::string_view type;
  void (*load)(const Loader&);
};

constexpr Row kShapes[] = {
    {"trianglemesh", load_mesh<read_triangle_mesh>},
    {"plymesh", load_mesh<read_ply_mesh>},
    {"loopsubdiv", load_mesh<read_loop_subdivision>},
    {"bilinearmesh", load_mesh<read_bilinear_mesh>},
    {"sphere", load_sphere},
    {"disk", load_disk},
    {"cylinder", load_cylinder},
};

std::vector<double> triangle_areas(const scene::TriangleMesh& mesh, const Matrix& pose) {
  std::vector<double> areas;
  const auto vertex = [&](uint32_t i) {
    const float* p = &mesh.positions[3 * size_t{i}];
    return transform_point(pose, {p[0], p[1], p[2]});
  };
  for (size_t t = 0; t < mesh.indices.size(); t += 3) {
    const Point origin = vertex(mesh.indices[t]);
    const Point side = subtract(vertex(mesh.indices[t + 1]), origin);
    const Point other = subtract(vertex(mesh.indices[t + 2]), origin);
    areas.push_back(length(cross(side, other)) / 2);
  }
  return areas;
}

constexpr double kGap = 1e-4;

// The mesh with its vertices moved against the normals of the triangles around them.
void move_behind(scene::TriangleMesh& mesh, double side) {
  std::vector<Point> normals(mesh.positions.size() / 3, Point{0, 0, 0});
  Point lowest{1e300, 1e300, 1e300};
  Point highest{-1e300, -1e300, -1e300};
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    lowest[i % 3] = std::min<double>(lowest[i % 3], mesh.positions[i]);
    highest[i % 3] = std::max<double>(highest[i % 3], mesh.positions[i]);
  }
  const auto vertex = [&](uint32_t i) {
    const float* p = &mesh.positions[3 * size_t{i}];
    return Point{p[0], p[1], p[2]};
  };
  for (size_t t = 0; t < mesh.indices.size(); t += 3) {
    const uint32_t* v = &mesh.indices[t];
    const Point normal =
        cross(subtract(vertex(v[1]), vertex(v[0])), subtract(vertex(v[2]), vertex(v[0])));
    for (int c = 0; c < 3; ++c) {
      for (size_t axis = 0; axis < 3; ++axis) normals[v[c]][axis] += normal[axis];
    }
  }
  const double gap = kGap * length(subtract(highest, lowest)) * side;
  for (size_t i = 0; i < normals.size(); ++i) {
    const Point normal = normalized(normals[i]);
    for (size_t axis = 0; axis < 3; ++axis) {
      mesh.positions[3 * i + axis] -= static_cast<float>(gap * normal[axis]);
    }
  }
}

}  // namespace

std::optional<PlacedShape> load_shape(Entity& entity, const Placement& placement,
                                      Context& context) {
  std::vector<std::string_view> supported;
  for (const Row& row : kShapes) {
    supported.push_back(row.type);
    if (row.type != entity.type) continue;
    PlacedShape placed;
    placed.shape.where = entity.where();
    placed.shape.flip_normals = placement.reverse_orientation;
    row.load({entity.parameters, placement, context, placed});
    const bool is_mesh = std::holds_alternative<scene::TriangleMesh>(placed.shape.geometry);
    if (placement.mirrored_later && !is_mesh)
      placed.shape.flip_normals = !placed.shape.flip_normals;
    entity.parameters.ignore({"alpha"});
    entity.parameters.finish("shape \"" + entity.type + "\"", context.problems);
    if (context.problems.failed()) return std::nullopt;
    return placed;
  }
  report_unknown_plugin("shape", entity, supported, "it is left out", context.problems);
  return std::nullopt;
}

std::vector<double> areas_of(const scene::Shape& shape, double time) {
  constexpr double kPi = std::numbers::pi;
  const Matrix pose = shape.motion.empty() ? kIdentity : motion::Track(shape.motion).at(time);
  if (const auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry)) {
    return triangle_areas(*mesh, pose);
  }
  if (const auto* sphere = std::get_if<scene::Sphere>(&shape.geometry)) {
    const double scale = std::cbrt(std::abs(determinant(pose)));
    return {4 * kPi * sphere->radius * sphere->radius * scale * scale};
  }
  if (const auto* disk = std::get_if<scene::Disk>(&shape.geometry)) {
    const Matrix m = multiply(pose, disk->to_world);
    return {kPi * length(cross(column(m, 0), column(m, 1)))};
  }
  const Matrix m = multiply(pose, std::get<scene::Cylinder>(shape.geometry).to_world);
  return {2 * kPi * length(column(m, 0)) * length(column(m, 2))};
}

scene::Shape opposite_side(const scene::Shape& shape) {
  scene::Shape other = shape;
  other.flip_normals = !shape.flip_normals;
  const double side = shape.flip_normals ? -1 : 1;  // where the geometry's own normal points
  if (auto* mesh = std::get_if<scene::TriangleMesh>(&other.geometry)) {
    move_behind(*mesh, side);
  } else if (auto* sphere = std::get_if<scene::Sphere>(&other.geometry)) {
    sphere->radius *= 1 - side * kGap;
  } else if (auto* disk = std::get_if<scene::Disk>(&other.geometry)) {
    const double radius = length(column(disk->to_world, 0));
    const Point normal = normalized(cross(column(disk->to_world, 0), column(disk->to_world, 1)));
    for (size_t axis = 0; axis < 3; ++axis) {
      disk->to_world[4 * axis + 3] -= side * kGap * radius * normal[axis];
    }
  } else {
    Matrix& m = std::get<scene::Cylinder>(other.geometry).to_world;
    m = multiply(m, scaling({1 - side * kGap, 1 - side * kGap, 1}));
  }
  return other;
}

}  // namespace metrofarm::scene_file::pbrt
