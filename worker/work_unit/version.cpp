#include "work_unit/version.h"

#include <bit>
#include <cmath>
#include <cstdio>

#include "base/parallel.h"
#include "work_unit/units.h"

namespace metrofarm::work_unit {
namespace {

using scene::SceneDescription;

// A diffuse floor, a glossy sphere, a glass sphere and lights near and far, as many as a tree is
// built for: every kind of code path.
SceneDescription probe_scene() {
  SceneDescription d;
  d.bsdfs.push_back({scene::Diffuse{}, "", {}});
  scene::RoughConductor metal;
  metal.distribution = scene::Microfacet::kGgx;
  metal.eta = {0.2F, 0.9F, 1.1F};
  metal.k = {3.9F, 2.4F, 2.1F};
  d.bsdfs.push_back({metal, "", {}});
  d.bsdfs.push_back({scene::Dielectric{}, "", {}});
  scene::TriangleMesh floor;
  floor.positions = {-3, 0, -3, 3, 0, -3, 3, 0, 3, -3, 0, 3};
  floor.indices = {0, 2, 1, 0, 3, 2};
  d.shapes.push_back({floor, 0, scene::kNone, false, "", {}});
  d.shapes.push_back({scene::Sphere{{-0.8, 0.6, 0.1}, 0.6}, 1, scene::kNone, false, "", {}});
  d.shapes.push_back({scene::Sphere{{0.8, 0.7, 0.2}, 0.6}, 2, scene::kNone, false, "", {}});
  d.shapes.push_back({scene::Sphere{{0.3, 3.1, 0.4}, 0.3}, 0, 0, false, "", {}});
  d.emitters.push_back({scene::AreaEmitter{{9, 8, 7}}, {}});
  d.emitters.push_back({scene::ConstantEmitter{{0.1F, 0.1F, 0.2F}}, {}});
  d.emitters.push_back({scene::PointEmitter{{-2, 2, -1}, {2, 1, 1}}, {}});
  const scene::Matrix down = {1, 0, 0, 2, 0, 0, -1, 3, 0, 1, 0, 1, 0, 0, 0, 1};
  d.emitters.push_back({scene::SpotEmitter{down, {{5, 6, 5}}, 40, 20}, {}});
  d.sensor.to_world = {1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, -4, 0, 0, 0, 1};
  d.sensor.fov_x_degrees = 60;
  d.film.filter = scene::ReconstructionFilter::kBox;
  d.film.filter_radius = 0.5;
  return d;
}

class Hash {
 public:
  void add(uint64_t v) { state_ = mix64(state_ ^ v); }
  void add(double v) { add(std::bit_cast<uint64_t>(v)); }
  void add(const std::vector<float>& values) {
    for (float f : values) add(double(f));
  }
  uint64_t value() const { return state_; }

 private:
  uint64_t state_ = 0;
};

// libm is used when a scene is prepared and by reconstruction filters; its last digits vary with
// its version.
void add_libm(Hash& hash) {
  for (int i = 1; i <= 64; ++i) {
    const double x = 0.137 * i;
    for (double v : {std::exp(-x), std::log(x), std::sin(x), std::cos(x), std::tan(x), std::erf(x),
                     std::pow(x, 2.4), std::cbrt(x), std::hypot(x, 0.7), std::expm1(x),
                     std::atan2(x, 0.7), std::acos(x / 9), std::asin(x / 9)})
      hash.add(v);
    const auto f = static_cast<float>(x);
    hash.add(std::vector<float>{std::exp(-f), std::sin(f), std::hypot(f, 0.7F)});
  }
}

}  // namespace

std::string probe_hash(std::string_view isa) {
  const FlushDenormals flush;
  const transport::Scene scene(probe_scene(), isa);
  Spec spec;
  spec.integrator = Integrator::kPssmlt;
  spec.width = spec.height = 16;
  spec.path.max_depth = 12;
  const Context context(scene, spec);
  Hash hash;
  hash.add(run_bootstrap(context, 0, 2048).values);
  add_libm(hash);
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash.value()));
  return text;
}

}  // namespace metrofarm::work_unit
