#include "rpc/structure.h"

#include <algorithm>
#include <vector>

#include "motion/track.h"

namespace metrofarm::rpc {
namespace {

using metrofarm::scene::Bsdf;
using metrofarm::scene::SceneDescription;
using std::holds_alternative;

// What rays meet in a material, the materials in it included.
struct Traits {
  bool masked = false;  // some pass through unscattered
  bool smooth = false;  // none scatters into a continuum of directions
};

class MaterialTraits {
 public:
  explicit MaterialTraits(const SceneDescription& scene) : scene_(scene) {}

  // Materials name only others that end somewhere: importers refuse cycles.
  Traits of(metrofarm::scene::Index index) const {
    const Bsdf& bsdf = scene_.bsdfs[index];
    if (const auto* sides = std::get_if<metrofarm::scene::TwoSided>(&bsdf.model))
      return both(of(sides->front), of(sides->back));
    if (const auto* blend = std::get_if<metrofarm::scene::Blend>(&bsdf.model))
      return both(of(blend->first), of(blend->second));
    if (const auto* mask = std::get_if<metrofarm::scene::Mask>(&bsdf.model))
      return {true, of(mask->nested).smooth};
    if (const auto* bump = std::get_if<metrofarm::scene::BumpMap>(&bsdf.model))
      return of(bump->nested);
    if (const auto* map = std::get_if<metrofarm::scene::NormalMap>(&bsdf.model))
      return of(map->nested);
    const bool null = holds_alternative<metrofarm::scene::Null>(bsdf.model);
    return {null, null || holds_alternative<metrofarm::scene::Conductor>(bsdf.model) ||
                      holds_alternative<metrofarm::scene::Dielectric>(bsdf.model) ||
                      holds_alternative<metrofarm::scene::ThinDielectric>(bsdf.model)};
  }

 private:
  static Traits both(const Traits& a, const Traits& b) {
    return {a.masked || b.masked, a.smooth && b.smooth};
  }

  const SceneDescription& scene_;
};

// When something moves, the sensor included: ascending, none touching another.
std::vector<motion::Interval> moving_spans(const SceneDescription& d) {
  std::vector<motion::Interval> spans;
  const auto add = [&](const metrofarm::scene::Motion& motion) {
    if (motion.empty()) return;
    for (const motion::Interval& span : motion::Track(motion).moving()) spans.push_back(span);
  };
  add(d.sensor.motion);
  for (const auto& shape : d.shapes) {
    add(shape.motion);
    if (!shape.key_times.empty())
      spans.push_back({shape.key_times.front(), shape.key_times.back()});
  }
  for (const auto& instance : d.instances) add(instance.motion);
  for (const auto& emitter : d.emitters) add(emitter.motion);
  std::ranges::sort(spans, {}, &motion::Interval::begin);
  std::vector<motion::Interval> merged;
  for (const motion::Interval& span : spans) {
    if (!merged.empty() && span.begin <= merged.back().end) {
      merged.back().end = std::max(merged.back().end, span.end);
    } else {
      merged.push_back(span);
    }
  }
  return merged;
}

void count_lights(const SceneDescription& d, metrofarm::scene::v1::Structure& out) {
  uint32_t extended = 0, delta = 0, maps = 0, distant = 0;
  for (const auto& shape : d.shapes) extended += shape.area_emitter != metrofarm::scene::kNone;
  for (const auto& emitter : d.emitters) {
    const bool map = holds_alternative<metrofarm::scene::EnvironmentEmitter>(emitter.model);
    const bool constant = holds_alternative<metrofarm::scene::ConstantEmitter>(emitter.model);
    const bool parallel = holds_alternative<metrofarm::scene::DirectionalEmitter>(emitter.model);
    const bool area = holds_alternative<metrofarm::scene::AreaEmitter>(emitter.model);
    maps += map;
    extended += map || constant;
    delta += !(map || constant || area);
    distant += map || constant || parallel;
  }
  out.set_extended_lights(extended);
  out.set_delta_lights(delta);
  out.set_environment_maps(maps);
  out.set_distant_lights(distant);
}

}  // namespace

metrofarm::scene::v1::Structure structure_of(const SceneDescription& d) {
  metrofarm::scene::v1::Structure out;
  out.set_lens(d.sensor.projection == metrofarm::scene::Projection::kThinLens &&
               d.sensor.aperture_radius > 0);
  for (const motion::Interval& span : moving_spans(d)) {
    metrofarm::scene::v1::TimeSpan& moving = *out.add_moving();
    moving.set_begin(span.begin);
    moving.set_end(span.end);
  }
  out.set_motion(out.moving_size() > 0);
  const MaterialTraits materials(d);
  uint32_t masked = 0, smooth = 0;
  for (const auto& shape : d.shapes) {
    const Traits traits = materials.of(shape.bsdf);
    masked += traits.masked;
    smooth += traits.smooth;
  }
  out.set_shapes(d.shapes.size());
  out.set_masked_shapes(masked);
  out.set_delta_shapes(smooth);
  count_lights(d, out);
  out.set_hide_emitters(d.integrator.hide_emitters);
  return out;
}

}  // namespace metrofarm::rpc
