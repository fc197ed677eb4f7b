#include "scene_file/mitsuba/bsdfs.h"

#include "scene_file/mitsuba/nested_bsdfs.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Index;

// Materials inside materials, counted from the outermost.
constexpr size_t kMaxNesting = 16;

constexpr Plugin<BsdfModel (*)(Properties&, Context&)> kBsdfs[] = {
    {"diffuse", load_diffuse},
    {"roughdiffuse", load_rough_diffuse},
    {"difftrans", load_diffuse_transmitter},
    {"conductor", load_conductor},
    {"roughconductor", load_rough_conductor},
    {"dielectric", load_dielectric},
    {"thindielectric", load_thin_dielectric},
    {"roughdielectric", load_rough_dielectric},
    {"plastic", load_plastic},
    {"roughplastic", load_rough_plastic},
    {"phong", load_phong},
    {"principled", load_principled},
    {"principledthin", load_principled_thin},
    {"null", load_null},
    {"twosided", load_twosided},
    {"mask", load_mask},
    {"blendbsdf", load_blend},
    {"mixturebsdf", load_mixture},
    {"bumpmap", load_bump_map},
    {"normalmap", load_normal_map},
};

// Plugins of Mitsuba that are not supported, and what comes near.
struct Neighbour {
  std::string_view type;
  std::string_view nearest;
};

constexpr Neighbour kNeighbours[] = {
    {"coating", "plastic"},
    {"roughcoating", "roughplastic"},
    {"ward", "phong"},
    {"hk", "difftrans"},
    {"irawan", "diffuse"},
    {"hair", "diffuse"},
    {"measured", "roughconductor"},
    {"pplastic", "roughplastic"},
    {"polarizer", "null"},
    {"retarder", "null"},
    {"circular", "null"},
    {"disneybsdf", "principled"},
};

void report_neighbour(const Element& element, std::string_view nearest, Problems& problems) {
  problems.unsupported(element.describe() + " is not supported; the nearest that is: \"" +
                           std::string(nearest) + "\"" +
                           (problems.lenient() ? "; a grey diffuse bsdf takes its place" : ""),
                       element.where);
}

Index append_bsdf(BsdfModel model, const Element& element, Context& context) {
  context.scene.bsdfs.push_back({model, element.get("id"), element.where});
  return static_cast<Index>(context.scene.bsdfs.size() - 1);
}

BsdfModel load_model(const Element& element, Context& context) {
  for (const Neighbour& neighbour : kNeighbours) {
    if (neighbour.type != element.get("type")) continue;
    report_neighbour(element, neighbour.nearest, context.problems);
    return scene::Diffuse{};
  }
  const auto* plugin =
      find_plugin(kBsdfs, element, "a grey diffuse bsdf takes its place", context.problems);
  if (!plugin) return scene::Diffuse{};
  Properties properties = context.properties_of(element);
  BsdfModel model = plugin->load(properties, context);
  properties.finish();
  return model;
}

}  // namespace

Index load_bsdf(const Element& element, Context& context) {
  if (const auto it = context.bsdfs.find(&element); it != context.bsdfs.end()) return it->second;
  if (!context.bsdfs_in_progress.insert(&element).second) {
    context.problems.fail(element.describe() + " contains itself", element.where);
    return default_bsdf(false, context);
  }
  if (context.bsdfs_in_progress.size() > kMaxNesting) {
    context.problems.fail("bsdfs are nested more than " + std::to_string(kMaxNesting) + " deep",
                          element.where);
    return default_bsdf(false, context);
  }
  BsdfModel model = load_model(element, context);
  context.bsdfs_in_progress.erase(&element);
  const Index index = append_bsdf(model, element, context);
  context.bsdfs.emplace(&element, index);
  return index;
}

Index default_bsdf(bool for_emitter, Context& context) {
  Index& index = for_emitter ? context.black_bsdf : context.default_bsdf;
  if (index == scene::kNone) {
    const float reflectance = for_emitter ? 0.0F : 0.5F;
    index =
        append_bsdf(scene::Diffuse{{reflectance, reflectance, reflectance}}, Element{}, context);
  }
  return index;
}

std::vector<std::string_view> bsdf_types() {
  std::vector<std::string_view> types;
  for (const auto& plugin : kBsdfs) types.push_back(plugin.type);
  return types;
}

}  // namespace metrofarm::scene_file::mitsuba
