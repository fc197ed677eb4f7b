#include "scene_file/mitsuba/film.h"

#include <algorithm>
#include <limits>

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Film;
using scene::ReconstructionFilter;

constexpr int64_t kMaxSize = 32768;

void load_box(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kBox;
  film.filter_radius = properties.number_in("radius", 0.5, 0.5, 16);
}

void load_tent(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kTent;
  film.filter_radius = properties.number_in("radius", 1, 0.01, 16);
}

void load_gaussian(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kGaussian;
  film.filter_stddev = properties.number_in("stddev", 0.5, 0.01, 4);
  film.filter_radius = 4 * film.filter_stddev;  // where Mitsuba cuts it off
}

void load_mitchell(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kMitchell;
  // Mitsuba names them in capitals; names come in lower case from old files.
  const auto parameter = [&](std::string_view capital, std::string_view small) {
    const double fallback = properties.number_in(small, 1.0 / 3, -10, 10);
    return properties.number_in(capital, fallback, -10, 10);
  };
  film.mitchell_b = parameter("B", "b");
  film.mitchell_c = parameter("C", "c");
  film.filter_radius = 2;
}

void load_catmull_rom(Properties&, Film& film) {
  film.filter = ReconstructionFilter::kCatmullRom;
  film.filter_radius = 2;
}

void load_lanczos(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kLanczos;
  film.filter_radius = static_cast<double>(properties.integer_in("lobes", 3, 1, 16));
}

constexpr Plugin<void (*)(Properties&, Film&)> kFilters[] = {
    {"box", load_box},           {"tent", load_tent},       {"gaussian", load_gaussian},
    {"mitchell", load_mitchell}, {"lanczos", load_lanczos}, {"catmullrom", load_catmull_rom},
};

void load_filter(const Element& element, Context& context) {
  const auto* plugin =
      find_plugin(kFilters, element, "a gaussian takes its place", context.problems);
  if (!plugin) return;
  Properties properties = context.properties_of(element);
  plugin->load(properties, context.scene.film);
  properties.finish();
}

void load_crop(Properties& properties, Film& film) {
  const auto read = [&](std::string_view name, int fallback, int64_t lowest, int64_t highest) {
    return static_cast<int>(
        properties.has(name) ? properties.integer_in(name, fallback, lowest, highest) : fallback);
  };
  film.crop.x = read("crop_offset_x", 0, 0, film.width - 1);
  film.crop.y = read("crop_offset_y", 0, 0, film.height - 1);
  film.crop.width = read("crop_width", film.width - film.crop.x, 1, film.width - film.crop.x);
  film.crop.height = read("crop_height", film.height - film.crop.y, 1, film.height - film.crop.y);
  if (film.crop.width == film.width && film.crop.height == film.height) film.crop = {};
}

// Parameters of 0.6's ldrfilm that change the values of the pixels.
void warn_about_tone_mapping(Properties& properties) {
  properties.ignore({"gamma"});
  for (std::string_view name : {"tonemap_method", "exposure", "key", "burn"}) {
    const Element* element = properties.find(name);
    if (!element) continue;
    properties.problems().warn(
        "tone mapping is left out: images are linear (parameter \"" + std::string(name) + "\")",
        element->where);
  }
}

}  // namespace

void load_film(const Element& element, Context& context) {
  Film& film = context.scene.film;
  film.where = element.where;
  const std::vector<std::string_view> known = {"hdrfilm", "ldrfilm", "mfilm", "tiledhdrfilm"};
  if (std::find(known.begin(), known.end(), element.get("type")) == known.end()) {
    report_unknown_plugin(element, known, "it is read as an hdrfilm", context.problems);
  }
  Properties properties = context.properties_of(element);
  film.width = static_cast<int>(properties.integer_in("width", film.width, 1, kMaxSize));
  film.height = static_cast<int>(properties.integer_in("height", film.height, 1, kMaxSize));
  load_crop(properties, film);
  warn_about_tone_mapping(properties);
  properties.ignore({"pixel_format", "component_format", "file_format", "banner", "filename",
                     "high_quality_edges", "sample_border", "compensate", "attach_log", "digits",
                     "variable", "metadata", "label"});
  if (const Element* filter = properties.object("rfilter")) load_filter(*filter, context);
  properties.finish();
}

void load_sampler(const Element& element, Context& context) {
  Properties properties = context.properties_of(element);
  scene::IntegratorSettings& settings = context.scene.integrator;
  constexpr int64_t kMaxInt = std::numeric_limits<int>::max();
  settings.sample_count =
      static_cast<int>(properties.integer_in("sample_count", settings.sample_count, 1, kMaxInt));
  properties.ignore({"seed", "jitter", "dimension", "scramble", "base", "wavefront_size"});
  properties.finish();
}

}  // namespace metrofarm::scene_file::mitsuba
