#include "scene_file/mitsuba/textures.h"

#include <algorithm>

#include "scene_file/mitsuba/images.h"
#include "scene_file/names.h"
#include "spectrum/luminance.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Colour;
using scene::Index;
using scene::UvMatrix;

const Colour kGrey = {{0.5F, 0.5F, 0.5F}};  // after a problem

// Textures inside textures, counted from the outermost.
constexpr size_t kMaxNesting = 16;

Colour append(decltype(scene::Texture::model) model, const Element& element, Context& context) {
  context.scene.textures.push_back({std::move(model), element.get("id"), element.where});
  return {{1, 1, 1}, static_cast<Index>(context.scene.textures.size() - 1)};
}

// Where Mitsuba looks a texture up for surface coordinates: to_uv since version 2, before it a
// scale and an offset for each.
UvMatrix read_uv(Properties& properties) {
  if (!properties.element().legacy || properties.has("to_uv")) {
    const Matrix m = properties.transform("to_uv");
    return {static_cast<float>(m[0]), static_cast<float>(m[1]), static_cast<float>(m[3]),
            static_cast<float>(m[4]), static_cast<float>(m[5]), static_cast<float>(m[7])};
  }
  const double both = properties.number("uvscale", 1);
  return {static_cast<float>(properties.number("uscale", both)),
          0,
          static_cast<float>(properties.number("uoffset", 0)),
          0,
          static_cast<float>(properties.number("vscale", both)),
          static_cast<float>(properties.number("voffset", 0))};
}

// Mitsuba's images have v = 0 at the top, ours at the bottom.
UvMatrix from_bottom(const UvMatrix& m) {
  return {m[0], m[1], m[2], -m[3], -m[4], 1 - m[5]};
}

// The value of a parameter that has a few words to choose from. Requires: fallback is one of them.
template <class Value, size_t count>
Value read_choice(Properties& properties, std::string_view name, std::string_view fallback,
                  const std::pair<std::string_view, Value> (&choices)[count]) {
  const std::string word = lower_case(properties.text(name, fallback));
  std::vector<std::string_view> words;
  Value otherwise{};
  for (const auto& [known, value] : choices) {
    if (known == word) return value;
    if (known == fallback) otherwise = value;
    words.push_back(known);
  }
  properties.problems().unsupported("unknown " + std::string(name) + " \"" + word + "\" of " +
                                        properties.element().describe() + suggestion(word, words),
                                    properties.find(name)->where);
  return otherwise;
}

scene::TextureFilter read_filter(Properties& properties) {
  using enum scene::TextureFilter;
  if (properties.element().legacy) {
    // Trilinear and anisotropic filtering differ only in how aliasing shows between the samples of
    // a pixel.
    return read_choice<scene::TextureFilter>(properties, "filter_type", "ewa",
                                             {{"bilinear", kBilinear},
                                              {"nearest", kNearest},
                                              {"trilinear", kBilinear},
                                              {"ewa", kBilinear}});
  }
  return read_choice<scene::TextureFilter>(properties, "filter_type", "bilinear",
                                           {{"bilinear", kBilinear}, {"nearest", kNearest}});
}

scene::TextureWrap read_wrap(Properties& properties) {
  using enum scene::TextureWrap;
  static constexpr std::pair<std::string_view, scene::TextureWrap> kWraps[] = {
      {"repeat", kRepeat}, {"mirror", kMirror}, {"clamp", kClamp}};
  const scene::TextureWrap both = read_choice(properties, "wrap_mode", "repeat", kWraps);
  if (!properties.element().legacy) return both;
  const bool has_u = properties.has("wrap_mode_u");
  const bool has_v = properties.has("wrap_mode_v");
  const scene::TextureWrap u =
      has_u ? read_choice(properties, "wrap_mode_u", "repeat", kWraps) : both;
  const scene::TextureWrap v =
      has_v ? read_choice(properties, "wrap_mode_v", "repeat", kWraps) : both;
  if (u != v) {
    properties.problems().unsupported(
        "a texture wraps the same way in u and v here",
        properties.find(has_v ? "wrap_mode_v" : "wrap_mode_u")->where);
  }
  return u;
}

Colour load_bitmap(Properties& properties, ColourUse, Context& context) {
  scene::BitmapTexture texture;
  texture.filter = read_filter(properties);
  texture.wrap = read_wrap(properties);
  texture.to_uv = from_bottom(read_uv(properties));
  texture.image = load_image(properties, read_decoding(properties), context);
  if (texture.image == scene::kNone) return kGrey;
  return append(texture, properties.element(), context);
}

Colour load_checkerboard(Properties& properties, ColourUse use, Context& context) {
  scene::CheckerboardTexture texture;
  texture.colour0 = read_textured_colour(properties, "color0", {{0.4F, 0.4F, 0.4F}}, use, context);
  texture.colour1 = read_textured_colour(properties, "color1", {{0.2F, 0.2F, 0.2F}}, use, context);
  texture.to_uv = read_uv(properties);
  return append(texture, properties.element(), context);
}

Colour times(const Colour& colour, const scene::Rgb& factor) {
  Colour product = colour;
  for (int i = 0; i < 3; ++i) product.value[i] *= factor[i];
  return product;
}

// Mitsuba 0.6: a nested texture times a number or colour.
Colour load_scale(Properties& properties, ColourUse, Context& context) {
  const scene::Rgb factor = read_colour(properties, "scale", {1, 1, 1}, ColourUse::kIndex, context);
  const Element* nested = find_nested_texture(properties, "scale");
  if (!nested) {
    context.problems.fail("texture \"scale\" needs a nested texture", properties.element().where);
    return kGrey;
  }
  return times(load_textured_colour(*nested, ColourUse::kIndex, context), factor);
}

Colour load_mesh_attribute(Properties& properties, ColourUse, Context& context) {
  const std::string name = properties.text("name", "");
  const auto scale = static_cast<float>(properties.number("scale", 1));
  if (!name.starts_with("vertex_") && !name.starts_with("face_")) {
    context.problems.fail(
        "texture \"mesh_attribute\" needs a name that begins with \"vertex_\" or \"face_\", as in "
        "\"vertex_color\"",
        properties.element().where);
  }
  return times(append(scene::AttributeTexture{name}, properties.element(), context),
               {scale, scale, scale});
}

// Mitsuba 0.6.
Colour load_vertex_colours(Properties& properties, ColourUse, Context& context) {
  return append(scene::AttributeTexture{"vertex_color"}, properties.element(), context);
}

constexpr Plugin<Colour (*)(Properties&, ColourUse, Context&)> kTextures[] = {
    {"bitmap", load_bitmap},
    {"checkerboard", load_checkerboard},
    {"scale", load_scale},
    {"mesh_attribute", load_mesh_attribute},
    {"vertexcolors", load_vertex_colours},
};

Colour load_new_texture(const Element& element, ColourUse use, Context& context) {
  if (!context.textures_in_progress.insert(&element).second) {
    context.problems.fail(element.describe() + " contains itself", element.where);
    return kGrey;
  }
  if (context.textures_in_progress.size() > kMaxNesting) {
    context.problems.fail("textures are nested more than " + std::to_string(kMaxNesting) + " deep",
                          element.where);
    return kGrey;
  }
  const auto* plugin = find_plugin(kTextures, element, "grey takes its place", context.problems);
  Colour colour = kGrey;
  if (plugin) {
    Properties properties = context.properties_of(element);
    colour = plugin->load(properties, use, context);
    properties.finish();
  }
  context.textures_in_progress.erase(&element);
  return colour;
}

}  // namespace

Colour load_textured_colour(const Element& element, ColourUse use, Context& context) {
  if (is_colour(element)) return load_colour(element, element.describe(), use, context);
  const std::pair key(&element, use == ColourUse::kEmission);
  if (const auto it = context.textures.find(key); it != context.textures.end()) return it->second;
  const Colour colour = load_new_texture(element, use, context);
  context.textures.emplace(key, colour);
  return colour;
}

Index load_texture(const Element& element, Context& context) {
  const Colour colour = load_textured_colour(element, ColourUse::kIndex, context);
  const bool plain = colour.texture != scene::kNone && colour.value == scene::Rgb{1, 1, 1};
  if (plain || context.problems.failed()) return colour.texture;
  context.problems.unsupported(
      "a texture is needed here as it is, without a scale; " + element.describe() + " is not",
      element.where);
  return colour.texture;
}

Colour read_textured_colour(Properties& properties, std::string_view name, const Colour& fallback,
                            ColourUse use, Context& context) {
  const Element* element = properties.find(name);
  if (!element) return fallback;
  if (element->tag == "texture" || element->tag == "spectrum") {
    if (!is_colour(*element)) return load_textured_colour(*element, use, context);
  }
  return read_colour(properties, name, fallback.value, use, context);
}

scene::Scalar read_textured_number(Properties& properties, std::string_view name, double fallback,
                                   const Range& range, Context& context) {
  const Element* element = properties.find(name);
  const bool is_number = !element || element->tag == "float" || element->tag == "integer";
  if (is_number) {
    return static_cast<float>(properties.number_in(name, fallback, range.lowest, range.highest));
  }
  const Colour colour = read_textured_colour(properties, name, {}, ColourUse::kIndex, context);
  if (colour.texture != scene::kNone) return {luminance(colour.value.data()), colour.texture};
  const float mean = (colour.value[0] + colour.value[1] + colour.value[2]) / 3;
  properties.check_range(name, mean, range.lowest, range.highest);
  return mean;
}

const Element* find_nested_texture(Properties& properties, std::string_view except) {
  const Element* excluded = except.empty() ? nullptr : properties.find(except);
  const Element* found = nullptr;
  for (std::string_view tag : {"texture", "spectrum"}) {
    for (const Element* element : properties.objects(tag)) {
      if (element == excluded) continue;
      if (found) {
        properties.problems().fail(properties.element().describe() + " takes only one texture",
                                   element->where);
      }
      found = element;
    }
  }
  return found;
}

std::vector<std::string_view> texture_types() {
  std::vector<std::string_view> types;
  for (const auto& plugin : kTextures) types.push_back(plugin.type);
  return types;
}

}  // namespace metrofarm::scene_file::mitsuba
