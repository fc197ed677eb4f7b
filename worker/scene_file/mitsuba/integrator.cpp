#include "scene_file/mitsuba/integrator.h"

#include <algorithm>
#include <array>
#include <limits>

namespace metrofarm::scene_file::mitsuba {
namespace {

constexpr int64_t kMaxInt = std::numeric_limits<int>::max();

// Integrators that hand the light transport to a nested one.
constexpr std::array<std::string_view, 5> kWrappers = {"moment", "aov", "adaptive", "multichannel",
                                                       "irrcache"};
// Those that compute the same image as a path tracer does, but for their noise.
constexpr std::array<std::string_view, 12> kLikePath = {
    "path",   "volpath", "volpath_simple", "volpathmis", "bdpt",      "mlt",
    "pssmlt", "erpt",    "ptracer",        "prb",        "prb_basic", "photonmapper"};

template <size_t count>
bool contains(const std::array<std::string_view, count>& list, std::string_view name) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

void read_depths(Properties& properties, scene::IntegratorSettings& settings) {
  settings.max_depth =
      static_cast<int>(properties.integer_in("max_depth", settings.max_depth, -1, kMaxInt));
  settings.rr_depth =
      static_cast<int>(properties.integer_in("rr_depth", settings.rr_depth, 1, kMaxInt));
}

void load_direct(Properties& properties, scene::IntegratorSettings& settings) {
  // Emitted light and one bounce: paths of at most two edges.
  settings.max_depth = 2;
  properties.ignore({"shading_samples", "emitter_samples", "bsdf_samples"});
}

void warn_about_strict_normals(Properties& properties) {
  if (!properties.boolean("strict_normals", false)) return;
  properties.problems().warn("strict_normals is ignored: shading normals are used as they are",
                             properties.find("strict_normals")->where);
}

// What the integrators of papers have in common with `path`; the rest means nothing here.
void load_unknown(const Element& element, Properties& properties,
                  scene::IntegratorSettings& settings) {
  properties.problems().warn(element.describe() + " is not known; it is read as a path integrator",
                             element.where);
  const Element* depth = properties.find("max_depth");
  if (depth && depth->tag == "integer") read_depths(properties, settings);
}

}  // namespace

void load_integrator(const Element& element, Context& context) {
  scene::IntegratorSettings& settings = context.scene.integrator;
  const std::string& type = element.get("type");
  if (type.empty()) return report_unknown_plugin(element, {"path", "direct"}, "", context.problems);
  Properties properties = context.properties_of(element);
  const std::vector<const Element*> nested = properties.objects("integrator");
  const bool wraps = contains(kWrappers, type) && !nested.empty();
  settings.hide_emitters = properties.boolean("hide_emitters", settings.hide_emitters);
  if (wraps && context.integrators_in_progress.insert(&element).second) {
    return load_integrator(*nested[0], context);
  }
  if (wraps) return context.problems.fail(element.describe() + " contains itself", element.where);
  if (type == "direct") {
    load_direct(properties, settings);
  } else if (contains(kLikePath, type)) {
    read_depths(properties, settings);
  } else {
    return load_unknown(element, properties, settings);
  }
  warn_about_strict_normals(properties);
  properties.ignore(
      {"samples_per_pass", "block_size", "timeout", "sample_num", "delta", "version"});
  // Parameters of the other algorithms tune what isn't here.
  if (type == "path" || type == "direct" || type == "volpath") properties.finish();
}

}  // namespace metrofarm::scene_file::mitsuba
