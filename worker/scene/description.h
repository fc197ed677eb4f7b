// A scene as data: what an importer produces and the renderer is built from. It knows no file
// format and no acceleration structure, so a new importer touches no renderer code.
//
// Units and spaces: positions are in world space and in the scene's own length unit; directions are
// not necessarily normalized; angles are in degrees; colours are linear Rec. 709 RGB.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "base/result.h"

namespace metrofarm::scene {

using Rgb = std::array<float, 3>;
using Point = std::array<double, 3>;
using Matrix = std::array<double, 16>;  // row major; maps column vectors

// Reference to another element by its index in SceneDescription; kNone where there is none.
using Index = int32_t;
inline constexpr Index kNone = -1;

// ---- shapes ----

// Indexed triangles in world space.
struct TriangleMesh {
  std::vector<float> positions;   // 3 per vertex
  std::vector<float> normals;     // 3 per vertex (unit length), or empty: face normals
  std::vector<float> texcoords;   // 2 per vertex, or empty
  std::vector<uint32_t> indices;  // 3 per triangle, counter-clockwise seen from outside
};

struct Sphere {
  Point center = {0, 0, 0};
  double radius = 1;
};

// The unit disk z = 0, x^2 + y^2 <= 1 with normal +z, mapped by to_world.
struct Disk {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
};

struct Shape {
  std::variant<TriangleMesh, Sphere, Disk> geometry;
  Index bsdf = kNone;          // index into bsdfs; importers fill in the default, so never kNone
  Index area_emitter = kNone;  // index into emitters (an AreaEmitter)
  bool flip_normals = false;   // importers have NOT applied it to geometry
  std::string id;              // as the file names it, for messages; may be empty
  SourceLocation where;
};

// ---- materials ----

struct Diffuse {
  Rgb reflectance = {0.5F, 0.5F, 0.5F};
};

// Smooth conductor: complex index of refraction eta + i k (relative to the outside).
struct Conductor {
  Rgb eta = {0, 0, 0};
  Rgb k = {1, 1, 1};
  Rgb specular_reflectance = {1, 1, 1};
};

enum class Microfacet { kBeckmann, kGgx };

struct RoughConductor {
  Microfacet distribution = Microfacet::kBeckmann;
  float alpha_u = 0.1F;
  float alpha_v = 0.1F;
  Rgb eta = {0, 0, 0};
  Rgb k = {1, 1, 1};
  Rgb specular_reflectance = {1, 1, 1};
};

// Smooth dielectric boundary; eta = interior index / exterior index.
struct Dielectric {
  float eta = 1.5046F / 1.000277F;
  Rgb specular_reflectance = {1, 1, 1};
  Rgb specular_transmittance = {1, 1, 1};
};

// Applies `front` where the geometric normal faces the ray's origin and `back` on the other side.
// Both are indices into bsdfs of materials that reflect only.
struct TwoSided {
  Index front = kNone;
  Index back = kNone;
};

struct Bsdf {
  std::variant<Diffuse, Conductor, RoughConductor, Dielectric, TwoSided> model;
  std::string id;
  SourceLocation where;
};

// ---- emitters ----

// Radiates from the side of its shape that the normal points to. Radiance in W / (m^2 sr).
struct AreaEmitter {
  Rgb radiance = {1, 1, 1};
};

// Isotropic point light. Intensity in W / sr.
struct PointEmitter {
  Point position = {0, 0, 0};
  Rgb intensity = {1, 1, 1};
};

// The same radiance from every direction of the environment.
struct ConstantEmitter {
  Rgb radiance = {1, 1, 1};
};

struct Emitter {
  std::variant<AreaEmitter, PointEmitter, ConstantEmitter> model;
  SourceLocation where;
};

// ---- sensor and film ----

// Pinhole camera, looking along +z of its own space with +y up and +x to the LEFT of the image
// (Mitsuba's convention). fov_x_degrees is the horizontal field of view of the whole film.
struct PerspectiveSensor {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  double fov_x_degrees = 90;
  double near_clip = 0.01;
  double far_clip = 10000;
  double principal_point_offset_x = 0;  // fraction of the film's width
  double principal_point_offset_y = 0;  // fraction of the film's height
  SourceLocation where;
};

enum class ReconstructionFilter { kBox, kTent, kGaussian };

struct Film {
  int width = 768;
  int height = 576;
  ReconstructionFilter filter = ReconstructionFilter::kGaussian;
  double filter_radius = 2;    // pixels; half the support per axis (box 0.5, tent 1)
  double filter_stddev = 0.5;  // pixels; gaussian only
  SourceLocation where;
};

// What the file asks of the renderer; jobs may override each.
struct IntegratorSettings {
  std::string type = "path";
  int max_depth = -1;  // path edges: 1 sees emitters only, 2 adds direct light; -1 has no limit
  int rr_depth = 5;    // first depth at which Russian roulette may end a path
  bool hide_emitters = false;
  int sample_count = 4;
};

struct SceneDescription {
  std::vector<Shape> shapes;
  std::vector<Bsdf> bsdfs;
  std::vector<Emitter> emitters;  // area emitters are named by a shape's area_emitter
  PerspectiveSensor sensor;
  Film film;
  IntegratorSettings integrator;
  std::vector<Error> warnings;  // accepted, but worth telling the user
};

}  // namespace metrofarm::scene
