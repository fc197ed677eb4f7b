#include "scene_file/pbrt/textures.h"

#include <cmath>

#include "scene_file/names.h"
#include "scene_file/pbrt/colours.h"

namespace metrofarm::scene_file::pbrt {
namespace {

using scene::Colour;
using scene::Rgb;

const Colour kGrey = {{0.5F, 0.5F, 0.5F}};

constexpr int kMaxNesting = 64;

Rgb product(const Rgb& a, const Rgb& b) {
  return {a[0] * b[0], a[1] * b[1], a[2] * b[2]};
}

bool is_constant(const Colour& colour) {
  return colour.texture == scene::kNone;
}

}  // namespace

UvMatrix compose(const UvMatrix& a, const UvMatrix& b) {
  return {a[0] * b[0] + a[1] * b[3], a[0] * b[1] + a[1] * b[4], a[0] * b[2] + a[1] * b[5] + a[2],
          a[3] * b[0] + a[4] * b[3], a[3] * b[1] + a[4] * b[4], a[3] * b[2] + a[4] * b[5] + a[5]};
}

void Textures::define(const std::string& name, const std::string& value_type, Entity entity) {
  if (value_type != "float" && value_type != "spectrum") {
    return context_.problems.fail("texture \"" + name + "\" is of type \"" + value_type +
                                      "\"; it must be \"float\" or \"spectrum\"",
                                  entity.where());
  }
  const bool is_spectrum = value_type == "spectrum";
  const auto found = definitions_.find({name, is_spectrum});
  if (found != definitions_.end()) {
    return context_.problems.fail("texture \"" + name + "\" is already defined in line " +
                                      std::to_string(found->second.entity.where().line) +
                                      "; names must be unique",
                                  entity.where());
  }
  definitions_.emplace(std::make_pair(name, is_spectrum),
                       Definition{std::move(entity), is_spectrum});
}

Colour Textures::find(const std::string& name, bool is_spectrum, const UvMatrix& shape_uv,
                      const SourceLocation& where) {
  const auto found = definitions_.find({name, is_spectrum});
  if (found == definitions_.end()) {
    std::vector<std::string_view> known;
    for (const auto& [key, unused] : definitions_) {
      if (key.second == is_spectrum) known.push_back(key.first);
    }
    context_.problems.fail("no " + std::string(is_spectrum ? "spectrum" : "float") +
                               " texture is named \"" + name + "\"" + suggestion(name, known),
                           where);
    return kGrey;
  }
  Definition& definition = found->second;
  const auto built = definition.built.find(shape_uv);
  if (built != definition.built.end()) return built->second;
  if (definition.in_progress) {
    context_.problems.fail("texture \"" + name + "\" refers to itself", where);
    return kGrey;
  }
  if (depth_ >= kMaxNesting) {
    context_.problems.fail("textures are nested more than " + std::to_string(kMaxNesting) + " deep",
                           where);
    return kGrey;
  }
  definition.in_progress = true;
  ++depth_;
  const Colour colour = build({name, definition, shape_uv});
  --depth_;
  definition.in_progress = false;
  definition.built.emplace(shape_uv, colour);
  return colour;
}

Colour Textures::build(const Request& request) {
  struct Row {
    std::string_view type;
    Colour (Textures::*load)(const Request&);
  };
  static constexpr Row kRows[] = {{"constant", &Textures::build_constant},
                                  {"scale", &Textures::build_scale},
                                  {"mix", &Textures::build_mix},
                                  {"imagemap", &Textures::build_imagemap},
                                  {"checkerboard", &Textures::build_checkerboard}};
  Entity& entity = request.definition.entity;
  std::vector<std::string_view> supported;
  for (const Row& row : kRows) {
    supported.push_back(row.type);
    if (row.type != entity.type) continue;
    const Colour colour = (this->*row.load)(request);
    entity.parameters.finish("texture \"" + entity.type + "\"", context_.problems);
    return colour;
  }
  report_unknown_plugin("texture \"" + request.name + "\" of type", entity, supported, "it is grey",
                        context_.problems);
  return kGrey;
}

// A number, a colour or the name of another texture.
Colour Textures::operand(const Request& request, std::string_view name, float fallback) {
  Parameters& parameters = request.definition.entity.parameters;
  Parameter* parameter = parameters.find(name);
  if (!parameter) return Colour(fallback, fallback, fallback);
  const bool is_factor = name == "scale" || name == "amount";
  if (parameter->type == ParameterType::kTexture) {
    if (parameter->strings.size() == 1) {
      return find(parameter->strings[0], request.definition.is_spectrum && !is_factor,
                  request.shape_uv, parameter->where);
    }
  } else if (parameter->type == ParameterType::kFloat && parameter->numbers.size() == 1) {
    const auto value = static_cast<float>(parameter->numbers[0]);
    return {value, value, value};
  } else if (request.definition.is_spectrum) {
    return read_reflectance(parameters, name, {fallback, fallback, fallback}, context_);
  }
  context_.problems.fail("parameter \"" + std::string(name) +
                             "\" must be one number, one colour or the name of one texture",
                         parameter->where);
  return kGrey;
}

Colour Textures::build_constant(const Request& request) {
  return operand(request, "value", 1);
}

Colour Textures::build_scale(const Request& request) {
  const Colour texture = operand(request, "tex", 1);
  const Colour scale = operand(request, "scale", 1);
  if (is_constant(texture) || is_constant(scale)) {
    return {product(texture.value, scale.value),
            is_constant(texture) ? scale.texture : texture.texture};
  }
  context_.problems.unsupported("the product of two textures is not supported: of texture \"" +
                                    request.name + "\" one factor must be constant",
                                request.definition.entity.where());
  return texture;
}

Colour Textures::build_mix(const Request& request) {
  const Colour first = operand(request, "tex1", 0);
  const Colour second = operand(request, "tex2", 1);
  const Colour amount = operand(request, "amount", 0.5F);
  const float t = amount.value[0];
  if (is_constant(amount) && t == 0) return first;
  if (is_constant(amount) && t == 1) return second;
  if (is_constant(first) && is_constant(second) && is_constant(amount)) {
    Rgb mixed{};
    for (size_t i = 0; i < 3; ++i) mixed[i] = (1 - t) * first.value[i] + t * second.value[i];
    return {mixed};
  }
  context_.problems.unsupported(
      "a mix of textures is not supported where one of them is not constant: texture \"" +
          request.name + "\"",
      request.definition.entity.where());
  return is_constant(amount) && t >= 0.5F ? second : first;
}

UvMatrix Textures::read_mapping(const Request& request) {
  Parameters& parameters = request.definition.entity.parameters;
  Problems& problems = context_.problems;
  const std::string mapping = parameters.text("mapping", "uv", problems);
  if (mapping != "uv") {
    problems.unsupported("texture mapping \"" + mapping + "\" of texture \"" + request.name +
                             "\" is not supported; supported: uv",
                         request.definition.entity.where());
    parameters.ignore({"v1", "v2"});
  }
  const auto number = [&](std::string_view name, double fallback) {
    return static_cast<float>(parameters.number(name, fallback, problems));
  };
  const UvMatrix to_st = {number("uscale", 1), 0, number("udelta", 0), 0, number("vscale", 1),
                          number("vdelta", 0)};
  return compose(to_st, request.shape_uv);
}

scene::Index Textures::image_of(const Request& request, Parameters& parameters) {
  Problems& problems = context_.problems;
  const SourceLocation& where = request.definition.entity.where();
  const std::string encoding = parameters.text("encoding", "sRGB", problems);
  const bool linear = encoding == "linear";
  if (!linear && encoding != "sRGB") {
    problems.unsupported(
        "image encoding \"" + encoding + "\" is not supported; supported: sRGB, linear", where);
  }
  return image(parameters.text("filename", "", problems), linear, where);
}

scene::Index Textures::image(const std::string& name, bool linear, const SourceLocation& where) {
  const auto known = images_.find({name, linear});
  if (known != images_.end()) return known->second;
  const scene::Index index = read_named_image(name, linear, where, context_);
  images_.emplace(std::make_pair(name, linear), index);
  return index;
}

Colour Textures::build_imagemap(const Request& request) {
  Parameters& parameters = request.definition.entity.parameters;
  Problems& problems = context_.problems;
  const SourceLocation& where = request.definition.entity.where();
  scene::BitmapTexture bitmap;
  bitmap.image = image_of(request, parameters);
  const std::string filter = parameters.text("filter", "bilinear", problems);
  bitmap.filter =
      filter == "point" ? scene::TextureFilter::kNearest : scene::TextureFilter::kBilinear;
  const std::string wrap = parameters.text("wrap", "repeat", problems);
  if (wrap == "clamp") bitmap.wrap = scene::TextureWrap::kClamp;
  if (wrap != "clamp" && wrap != "repeat") {
    problems.unsupported("wrap mode \"" + wrap + "\" is not supported; supported: repeat, clamp",
                         where);
  }
  if (parameters.boolean("invert", false, problems)) {
    problems.unsupported("inverted images are not supported: \"invert\" must be false", where);
  }
  const auto scale = static_cast<float>(parameters.number("scale", 1, problems));
  parameters.ignore({"maxanisotropy"});
  bitmap.to_uv = read_mapping(request);
  if (bitmap.image == scene::kNone) return kGrey;
  return {{scale, scale, scale}, append(context_.scene.textures, {bitmap, request.name, where})};
}

// tex1 where floor(s) + floor(t) is even; ours counts half units.
Colour Textures::build_checkerboard(const Request& request) {
  const Colour even = operand(request, "tex1", 1);
  const Colour odd = operand(request, "tex2", 0);
  Parameters& parameters = request.definition.entity.parameters;
  const SourceLocation& where = request.definition.entity.where();
  const int dimension = parameters.integer_in("dimension", 2, 2, context_.problems);
  if (dimension != 2) {
    context_.problems.unsupported("checkerboards in 3 dimensions are not supported", where);
  }
  const UvMatrix half = {0.5F, 0, 0, 0, 0.5F, 0};
  scene::CheckerboardTexture board;
  board.colour0 = even;
  board.colour1 = odd;
  board.to_uv = compose(half, read_mapping(request));
  return {{1, 1, 1}, append(context_.scene.textures, {board, request.name, where})};
}

}  // namespace metrofarm::scene_file::pbrt
