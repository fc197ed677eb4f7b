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

// ---- images and textures ----

// Pixels in scanline order from the top left corner. Bytes are kept as bytes: a texture takes no
// more memory than its file's pixels.
struct Image {
  int width = 1;
  int height = 1;
  int channels = 3;  // 1: grey, 3: RGB, 4: RGB and alpha (not premultiplied)
  // One value per channel and pixel. Bytes stand for value / 255.
  std::variant<std::vector<uint8_t>, std::vector<float>> pixels;
  bool srgb = false;  // bytes are sRGB-encoded (alpha never is)
};

enum class TextureFilter { kBilinear, kNearest };
enum class TextureWrap { kRepeat, kMirror, kClamp };

// Maps surface coordinates to texture coordinates: (m0 u + m1 v + m2, m3 u + m4 v + m5).
using UvMatrix = std::array<float, 6>;
inline constexpr UvMatrix kIdentityUv = {1, 0, 0, 0, 1, 0};

// (0, 0) is the image's BOTTOM left corner: importers fold their format's convention into to_uv.
struct BitmapTexture {
  Index image = kNone;
  TextureFilter filter = TextureFilter::kBilinear;
  TextureWrap wrap = TextureWrap::kRepeat;
  UvMatrix to_uv = kIdentityUv;
};

// A colour or, where `texture` is given, that texture times `value`.
struct Colour {
  Rgb value = {1, 1, 1};
  Index texture = kNone;

  Colour() = default;
  // NOLINTNEXTLINE(google-explicit-constructor): a constant is a colour
  Colour(const Rgb& rgb, Index t = kNone) : value(rgb), texture(t) {}
  Colour(float r, float g, float b) : value{r, g, b} {}
};

// The same for a number; of a texture in colour its luminance.
struct Scalar {
  float value = 1;
  Index texture = kNone;

  Scalar() = default;
  // NOLINTNEXTLINE(google-explicit-constructor): a constant is a number
  Scalar(float v, Index t = kNone) : value(v), texture(t) {}
};

// colour0 where floor(2 u) and floor(2 v) are both even or both odd, else colour1.
struct CheckerboardTexture {
  Colour colour0 = {{0.4F, 0.4F, 0.4F}};
  Colour colour1 = {{0.2F, 0.2F, 0.2F}};
  UvMatrix to_uv = kIdentityUv;
};

// The mesh attribute of this name; black on shapes without it.
struct AttributeTexture {
  std::string name;
};

struct Texture {
  std::variant<BitmapTexture, CheckerboardTexture, AttributeTexture> model;
  std::string id;
  SourceLocation where;
};

// ---- shapes ----

// Values at the vertices or faces of a mesh, beside those that shading knows.
struct MeshAttribute {
  std::string name;           // "vertex_color", "face_color", ...
  int channels = 3;           // 1 or 3
  bool per_face = false;      // else per vertex, interpolated
  std::vector<float> values;  // channels per vertex or face
};

// Vertices of a mesh at a time of their own.
struct VertexKey {
  std::vector<float> positions;
  std::vector<float> normals;  // as many, or none
};

// Indexed triangles in the space of their group, world space outside groups.
struct TriangleMesh {
  std::vector<float> positions;   // 3 per vertex
  std::vector<float> normals;     // 3 per vertex (unit length), or empty: face normals
  std::vector<float> texcoords;   // 2 per vertex, or empty
  std::vector<uint32_t> indices;  // 3 per triangle, counter-clockwise seen from outside
  std::vector<MeshAttribute> attributes = {};
  // Of a mesh that deforms, at its shape's key_times; positions and normals are the first's.
  std::vector<VertexKey> keys = {};
};

struct Sphere {
  Point center = {0, 0, 0};
  double radius = 1;
  // Turns the surface coordinates: the columns are the axes from which u = phi / 2 pi and
  // v = theta / pi are measured. Rotation only.
  std::array<double, 9> rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
};

// The unit disk z = 0, x^2 + y^2 <= 1 with normal +z, mapped by to_world; u = radius,
// v = phi / 2 pi.
struct Disk {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
};

// The open unit cylinder x^2 + y^2 = 1, 0 <= z <= 1 with normals away from its axis, mapped by
// to_world (rotation, one scale for x and y, another for z); u = phi / 2 pi, v = z.
struct Cylinder {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
};

// A rotation as a file writes it: more than half a turn is more than its matrix tells.
struct Turn {
  Point axis = {0, 0, 1};
  double degrees = 0;
};

// Where something is at a time: the file's to_world there. Times grow from key to key.
struct Keyframe {
  double time = 0;
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  std::vector<Turn> turns = {};  // all that to_world is made of, in order, if known
  // Control points of a Bezier path, before and after the key: where to_world puts the origin.
  Point in = {0, 0, 0}, out = {0, 0, 0};
};

// How the origin goes from key to key.
enum class MotionPath { kLinear, kCatmullRom, kBezier };

// See motion::Track for what is between the keys. Without keys there is no motion.
struct Motion {
  std::vector<Keyframe> keys;
  MotionPath path = MotionPath::kLinear;
  bool empty() const { return keys.empty(); }
};

struct Shape {
  std::variant<TriangleMesh, Sphere, Disk, Cylinder> geometry;
  Index bsdf = kNone;          // index into bsdfs; importers fill in the default, so never kNone
  Index area_emitter = kNone;  // index into emitters (an AreaEmitter); kNone in groups
  bool flip_normals = false;   // importers have NOT applied it to geometry
  std::string id = {};         // as the file names it, for messages; may be empty
  SourceLocation where = {};
  Index group = kNone;  // the shape is part of this group and seen through its instances only
  // Of a shape outside groups: geometry is in the shape's own space, which moves.
  Motion motion = {};
  // Of a mesh that deforms: growing, and it holds the first before, the last after. In between
  // vertices go straight from key to key.
  std::vector<double> key_times = {};
};

// One placement of a group (groups are numbered from 0 by their shapes).
struct Instance {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  Index group = kNone;
  SourceLocation where = {};
  Motion motion = {};  // comes after to_world
};

// ---- materials ----

struct Diffuse {
  Colour reflectance = {{0.5F, 0.5F, 0.5F}};
};

// Smooth conductor: complex index of refraction eta + i k (relative to the outside).
struct Conductor {
  Rgb eta = {0, 0, 0};
  Rgb k = {1, 1, 1};
  Colour specular_reflectance = {};
};

enum class Microfacet { kBeckmann, kGgx };

struct RoughConductor {
  Microfacet distribution = Microfacet::kBeckmann;
  Scalar alpha_u = {0.1F};
  Scalar alpha_v = {0.1F};
  Rgb eta = {0, 0, 0};
  Rgb k = {1, 1, 1};
  Colour specular_reflectance = {};
};

// Smooth dielectric boundary; eta = interior index / exterior index.
struct Dielectric {
  float eta = 1.5046F / 1.000277F;
  Colour specular_reflectance = {};
  Colour specular_transmittance = {};
};

// A thin sheet with two parallel smooth faces: all its inner reflections at once, no refraction.
struct ThinDielectric {
  float eta = 1.5046F / 1.000277F;
  Colour specular_reflectance = {};
  Colour specular_transmittance = {};
};

// Rough dielectric boundary (Walter et al. 2007).
struct RoughDielectric {
  Microfacet distribution = Microfacet::kBeckmann;
  Scalar alpha_u = {0.1F};
  Scalar alpha_v = {0.1F};
  float eta = 1.5046F / 1.000277F;
  Colour specular_reflectance = {};
  Colour specular_transmittance = {};
};

// A diffuse base under a smooth dielectric coating, inner reflections included.
struct Plastic {
  float eta = 1.49F / 1.000277F;
  Colour diffuse_reflectance = {{0.5F, 0.5F, 0.5F}};
  Colour specular_reflectance = {};
  bool nonlinear = false;  // colour shifts by inner reflections
};

// The same under a rough coating; reflectances as in Mitsuba's roughplastic.
struct RoughPlastic {
  Microfacet distribution = Microfacet::kBeckmann;
  float alpha = 0.1F;
  float eta = 1.49F / 1.000277F;
  Colour diffuse_reflectance = {{0.5F, 0.5F, 0.5F}};
  Colour specular_reflectance = {};
  bool nonlinear = false;
};

// Modified Phong reflection (Lafortune and Willems 1994). Both reflectances: at most 1 together.
struct Phong {
  Scalar exponent = {30};
  Colour diffuse_reflectance = {{0.5F, 0.5F, 0.5F}};
  Colour specular_reflectance = {{0.2F, 0.2F, 0.2F}};
};

// Disney's principled BSDF (Burley 2012 and 2015) with Mitsuba 3's parameters and lobes.
struct Principled {
  Colour base_color = {{0.5F, 0.5F, 0.5F}};
  Scalar roughness = {0.5F};
  Scalar anisotropic = {0};
  Scalar metallic = {0};
  Scalar spec_trans = {0};
  Scalar spec_tint = {0};
  Scalar sheen = {0};
  Scalar sheen_tint = {0};
  Scalar flatness = {0};
  Scalar clearcoat = {0};
  Scalar clearcoat_gloss = {0};
  float eta = 1.5F;  // importers turn "specular" into it
  float main_specular_sampling_rate = 1;
  float clearcoat_sampling_rate = 1;
  float diffuse_reflectance_sampling_rate = 1;
};

// Its variant for thin sheets.
struct PrincipledThin {
  Colour base_color = {{0.5F, 0.5F, 0.5F}};
  Scalar roughness = {0.5F};
  Scalar anisotropic = {0};
  Scalar spec_trans = {0};
  Scalar diff_trans = {0};  // 0 .. 2
  Scalar eta = {1.5F};
  Scalar spec_tint = {0};
  Scalar sheen = {0};
  Scalar sheen_tint = {0};
  Scalar flatness = {0};
  float spec_reflectance_sampling_rate = 1;
  float spec_transmittance_sampling_rate = 1;
  float diffuse_reflectance_sampling_rate = 1;
  float diffuse_transmittance_sampling_rate = 1;
};

// Diffuse transmission to the other side, nothing reflected (0.6: difftrans).
struct DiffuseTransmitter {
  Colour transmittance = {{0.5F, 0.5F, 0.5F}};
};

// Invisible: rays go straight through.
struct Null {};

// Applies `front` where the geometric normal faces the ray's origin and `back` on the other side.
// Both are indices into bsdfs of materials that reflect only.
struct TwoSided {
  Index front = kNone;
  Index back = kNone;
};

// `nested` with probability opacity, else invisible.
struct Mask {
  Scalar opacity = {0.5F};
  Index nested = kNone;
};

// (1 - weight) first + weight second.
struct Blend {
  Scalar weight = {0.5F};
  Index first = kNone;
  Index second = kNone;
};

// `nested` on a surface displaced by the texture along its normal, in scene units.
struct BumpMap {
  Scalar displacement = {};  // a texture; value is its scale
  Index nested = kNone;
};

// `nested` under a normal given in the tangent frame: 2 rgb - 1.
struct NormalMap {
  Index normals = kNone;  // index into textures, raw values
  Index nested = kNone;
};

struct Bsdf {
  std::variant<Diffuse, Conductor, RoughConductor, Dielectric, TwoSided, ThinDielectric,
               RoughDielectric, Plastic, RoughPlastic, Phong, Principled, PrincipledThin,
               DiffuseTransmitter, Null, Mask, Blend, BumpMap, NormalMap>
      model;
  std::string id;
  SourceLocation where;
};

// ---- emitters ----

// Radiates from the side of its shape that the normal points to. Radiance in W / (m^2 sr).
struct AreaEmitter {
  Colour radiance = {};
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

// Point light in a cone around +z of its space: full within the beam width, falling linearly in
// the angle to zero at the cutoff. A texture is projected onto the cone's square.
struct SpotEmitter {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  Colour intensity = {};  // W / sr
  double cutoff_degrees = 20;
  double beam_width_degrees = 15;
};

// Parallel light that travels along `direction` (world space). Irradiance in W / m^2 on a surface
// across it.
struct DirectionalEmitter {
  Point direction = {0, 0, 1};
  Rgb irradiance = {1, 1, 1};
};

// Latitude-longitude image of the radiance from all directions. In its own space +y is up, the
// image's top row shows +y; column 0 lies at u = 0, where u = atan2(x, -z) / 2 pi.
struct EnvironmentEmitter {
  Index image = kNone;
  float scale = 1;
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
};

// A slide projector: an inverted pinhole camera whose image is `irradiance` (a texture, seen at
// distance 1 along +z of its space).
struct ProjectorEmitter {
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  Colour irradiance = {};
  double fov_x_degrees = 45;
  double aspect = 1;  // width over height
};

struct Emitter {
  std::variant<AreaEmitter, PointEmitter, ConstantEmitter, SpotEmitter, DirectionalEmitter,
               EnvironmentEmitter, ProjectorEmitter>
      model;
  SourceLocation where;
  Motion motion = {};  // of lights without extent, which are in a space that moves
};

// ---- sensor and film ----

enum class Projection { kPerspective, kThinLens, kOrthographic };

// Looks along +z of its own space with +y up and +x to the LEFT of the image (Mitsuba's
// convention). fov_x_degrees is the horizontal field of view of the whole film; the orthographic
// sensor sees [-1, 1] of its own space in x.
struct Sensor {
  Projection projection = Projection::kPerspective;
  Matrix to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  double fov_x_degrees = 90;
  double near_clip = 0.01;
  double far_clip = 10000;
  double principal_point_offset_x = 0;  // fraction of the film's width
  double principal_point_offset_y = 0;  // fraction of the film's height
  double aperture_radius = 0;           // thin lens, scene units
  double focus_distance = 1;            // thin lens, along +z
  SourceLocation where = {};
  Motion motion = {};       // comes after to_world
  double shutter_open = 0;  // times as those of keys
  double shutter_close = 0;
};

enum class ReconstructionFilter { kBox, kTent, kGaussian, kMitchell, kCatmullRom, kLanczos };

// Part of the film that is rendered, in pixels of the whole film.
struct CropWindow {
  int x = 0, y = 0;
  int width = 0, height = 0;  // 0: the whole film
};

struct Film {
  int width = 768;  // of the whole film, also where a crop window is given
  int height = 576;
  CropWindow crop = {};
  ReconstructionFilter filter = ReconstructionFilter::kGaussian;
  double filter_radius = 2;    // pixels; half the support per axis (box 0.5, tent 1)
  double filter_stddev = 0.5;  // pixels; gaussian only
  double mitchell_b = 1.0 / 3, mitchell_c = 1.0 / 3;
  SourceLocation where = {};

  // Size of the image to be rendered.
  int image_width() const { return crop.width > 0 ? crop.width : width; }
  int image_height() const { return crop.height > 0 ? crop.height : height; }
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
  std::vector<Image> images;
  std::vector<Texture> textures;  // a texture names only textures before it
  std::vector<Shape> shapes;
  std::vector<Instance> instances;
  std::vector<Bsdf> bsdfs;
  std::vector<Emitter> emitters;  // area emitters are named by a shape's area_emitter
  Sensor sensor;
  Film film;
  IntegratorSettings integrator;
  std::vector<Error> warnings;  // accepted, but worth telling the user
};

// Whether anything that rays meet moves, or a light; the sensor does not count.
bool has_motion(const SceneDescription& scene);

}  // namespace metrofarm::scene
