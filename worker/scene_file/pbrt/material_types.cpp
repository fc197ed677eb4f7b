// The single materials of pbrt-v4 and what stands for them here.
#include <algorithm>
#include <cmath>

#include "scene_file/named_materials.h"
#include "scene_file/pbrt/colours.h"
#include "scene_file/pbrt/materials.h"

namespace metrofarm::scene_file::pbrt {
namespace {

using scene::Colour;
using scene::Index;
using scene::Scalar;

// pbrt-v4 treats microfacet surfaces as smooth below.
constexpr float kSmoothest = 1e-3F;

bool is_constant(const Scalar& scalar) {
  return scalar.texture == scene::kNone;
}

float largest(const scene::Rgb& rgb) {
  return *std::max_element(rgb.begin(), rgb.end());
}

Colour times(const Colour& colour, float factor) {
  const scene::Rgb& c = colour.value;
  return {{c[0] * factor, c[1] * factor, c[2] * factor}, colour.texture};
}

}  // namespace

Colour Materials::colour(const Request& request, std::string_view name, float fallback) {
  const Parameter* parameter = request.parameters.find(name);
  if (!parameter) return {fallback, fallback, fallback};
  if (parameter->type == ParameterType::kTexture && parameter->strings.size() == 1) {
    return textures_.find(parameter->strings[0], true, request.shape_uv, parameter->where);
  }
  return {read_reflectance(request.parameters, name, {fallback, fallback, fallback}, context_)};
}

Scalar Materials::scalar(const Request& request, std::string_view name, float fallback) {
  const Parameter* parameter = request.parameters.find(
      name, {ParameterType::kFloat, ParameterType::kTexture}, context_.problems);
  if (!parameter) return {fallback};
  if (parameter->type == ParameterType::kTexture && parameter->strings.size() == 1) {
    const Colour found =
        textures_.find(parameter->strings[0], false, request.shape_uv, parameter->where);
    return {found.value[0], found.texture};
  }
  if (parameter->numbers.size() == 1) return {static_cast<float>(parameter->numbers[0])};
  context_.problems.fail("\"" + std::string(name) + "\" must be one number or one texture",
                         parameter->where);
  return {fallback};
}

// prefix: "" or, for the layers of coatedconductor, "interface." or "conductor.".
Materials::Roughness Materials::roughness(const Request& request, std::string_view prefix) {
  const std::string start(prefix);
  const Scalar both = scalar(request, start + "roughness", 0);
  Roughness result{both, both};
  const bool has_u = request.parameters.find(start + "uroughness") != nullptr;
  const bool has_v = request.parameters.find(start + "vroughness") != nullptr;
  if (has_u) result.u = scalar(request, start + "uroughness", 0);
  if (has_v) result.v = scalar(request, start + "vroughness", 0);
  const bool remap = request.parameters.boolean("remaproughness", true, context_.problems);
  for (Scalar* alpha : {&result.u, &result.v}) {
    if (is_constant(*alpha) && !(alpha->value >= 0)) {
      context_.problems.fail("roughness must not be negative", request.parameters.where());
    }
    if (!remap) continue;
    if (!is_constant(*alpha)) {
      context_.problems.unsupported(
          "textured roughness is supported only with \"bool remaproughness\" false",
          request.parameters.where());
    }
    alpha->value = std::sqrt(std::max(alpha->value, 0.F));
  }
  result.smooth = is_constant(result.u) && is_constant(result.v) &&
                  std::max(result.u.value, result.v.value) < kSmoothest;
  if (result.smooth) return result;
  for (Scalar* alpha : {&result.u, &result.v}) {
    // As pbrt does where only one direction is smooth.
    if (is_constant(*alpha)) alpha->value = std::max(alpha->value, 1e-4F);
  }
  return result;
}

Index Materials::add(const Request& request, decltype(scene::Bsdf::model) model) {
  return append(context_.scene.bsdfs, {model, "", request.parameters.where()});
}

// Under the relief that "displacement" or "normalmap" give.
Index Materials::with_relief(const Request& request, Index nested) {
  const SourceLocation& where = request.parameters.where();
  const std::string normals = request.parameters.text("normalmap", "", context_.problems);
  if (!normals.empty()) {
    scene::BitmapTexture bitmap;
    bitmap.image = textures_.image(normals, true, where);
    bitmap.to_uv = request.shape_uv;
    if (bitmap.image == scene::kNone) return nested;
    const Index texture = append(context_.scene.textures, {bitmap, "", where});
    return add(request, scene::NormalMap{texture, nested});
  }
  const Scalar displacement = scalar(request, "displacement", 0);
  if (is_constant(displacement)) return nested;
  return add(request, scene::BumpMap{displacement, nested});
}

// pbrt's reflecting materials look the same from both sides.
Index Materials::reflecting(const Request& request, decltype(scene::Bsdf::model) model) {
  const Index inner = with_relief(request, add(request, model));
  return add(request, scene::TwoSided{inner, inner});
}

Index Materials::load_diffuse(const Request& request) {
  return reflecting(request, scene::Diffuse{colour(request, "reflectance", 0.5F)});
}

void Materials::refuse_inner_medium(const Request& request) {
  const Colour albedo = colour(request, "albedo", 0);
  if (albedo.texture != scene::kNone || largest(albedo.value) > 0) {
    context_.problems.unsupported(
        "scattering between the layers is not supported: \"albedo\" "
        "must be 0",
        request.parameters.where());
  }
  request.parameters.ignore({"thickness", "g", "maxdepth", "nsamples", "twosided"});
}

Index Materials::load_coated_diffuse(const Request& request) {
  const Roughness alpha = roughness(request, "");
  const Colour reflectance = colour(request, "reflectance", 0.5F);
  const float index = eta(request);
  refuse_inner_medium(request);
  context_.problems.warn("coateddiffuse is rendered as the nearest plastic",
                         request.parameters.where());
  if (alpha.smooth) {
    return reflecting(request, scene::Plastic{index, reflectance, {}, true});
  }
  if (!is_constant(alpha.u) || !is_constant(alpha.v)) {
    context_.problems.unsupported("textured roughness of coateddiffuse is not supported",
                                  request.parameters.where());
  }
  scene::RoughPlastic plastic;
  plastic.distribution = scene::Microfacet::kGgx;
  plastic.alpha = std::sqrt(alpha.u.value * alpha.v.value);
  plastic.eta = index;
  plastic.diffuse_reflectance = reflectance;
  plastic.nonlinear = true;
  return reflecting(request, plastic);
}

// prefix: as in roughness().
Index Materials::conductor(const Request& request, std::string_view prefix) {
  const std::string start(prefix);
  const auto copper = *find_conductor("Cu");
  scene::RoughConductor metal;
  metal.distribution = scene::Microfacet::kGgx;
  metal.eta = read_index(request.parameters, start + "eta", context_).value_or(copper.eta);
  metal.k = read_index(request.parameters, start + "k", context_).value_or(copper.k);
  // pbrt-v4 has "reflectance" without the prefix of the layer.
  const Parameter* reflectance = request.parameters.find("reflectance");
  if (reflectance && reflectance->type == ParameterType::kTexture) {
    metal.eta = {0, 0, 0};  // reflects everything, times the texture
    metal.k = {1, 1, 1};
    metal.specular_reflectance = colour(request, "reflectance", 1);
    context_.problems.warn("a conductor with a textured reflectance has the same one at all angles",
                           request.parameters.where());
  } else if (reflectance) {
    const scene::Rgb rgb = read_reflectance(request.parameters, "reflectance", {1, 1, 1}, context_);
    metal.eta = {1, 1, 1};
    for (size_t i = 0; i < 3; ++i) {
      // As pbrt-v4: normal incidence on index 1 + i k reflects k^2 / (k^2 + 4).
      const float r = std::min(rgb[i], 0.9999F);
      metal.k[i] = 2 * std::sqrt(r) / std::sqrt(1 - r);
    }
  }
  const Roughness alpha = roughness(request, prefix);
  if (alpha.smooth) {
    return reflecting(request, scene::Conductor{metal.eta, metal.k, metal.specular_reflectance});
  }
  metal.alpha_u = alpha.u;
  metal.alpha_v = alpha.v;
  return reflecting(request, metal);
}

Index Materials::load_conductor(const Request& request) {
  return conductor(request, "");
}

Index Materials::load_coated_conductor(const Request& request) {
  refuse_inner_medium(request);
  request.parameters.ignore(
      {"interface.roughness", "interface.uroughness", "interface.vroughness", "interface.eta"});
  context_.problems.warn("coatedconductor is rendered as its conductor, without the coating",
                         request.parameters.where());
  return conductor(request, "conductor.");
}

// Inside relative to outside; of a spectrum the mean of the channels.
float Materials::eta(const Request& request) {
  const auto index = read_index(request.parameters, "eta", context_);
  if (!index) return 1.5F;
  const float mean = ((*index)[0] + (*index)[1] + (*index)[2]) / 3;
  if (mean > 0) return mean;
  context_.problems.fail("\"eta\" must be greater than 0", request.parameters.where());
  return 1.5F;
}

Index Materials::load_dielectric(const Request& request) {
  const Roughness alpha = roughness(request, "");
  const float index = eta(request);
  // Between equal indices nothing is bent, however rough the surface is.
  if (alpha.smooth || index == 1) {
    return with_relief(request, add(request, scene::Dielectric{index, {}, {}}));
  }
  scene::RoughDielectric glass;
  glass.distribution = scene::Microfacet::kGgx;
  glass.alpha_u = alpha.u;
  glass.alpha_v = alpha.v;
  glass.eta = index;
  return with_relief(request, add(request, glass));
}

Index Materials::load_thin_dielectric(const Request& request) {
  return with_relief(request, add(request, scene::ThinDielectric{eta(request), {}, {}}));
}

// R / (1 - w) and T / w under a blend of weight w, which keeps both at most 1 where R + T is.
Index Materials::load_diffuse_transmission(const Request& request) {
  const auto scale = static_cast<float>(request.parameters.number("scale", 1, context_.problems));
  const Colour reflectance = times(colour(request, "reflectance", 0.25F), scale);
  const Colour transmittance = times(colour(request, "transmittance", 0.25F), scale);
  const float r = largest(reflectance.value);
  const float t = largest(transmittance.value);
  const float weight = r + t > 0 ? t / (r + t) : 0.5F;
  if (weight == 0) return reflecting(request, scene::Diffuse{reflectance});
  const Index through = add(request, scene::DiffuseTransmitter{times(transmittance, 1 / weight)});
  if (weight == 1) return with_relief(request, through);
  const Index back = reflecting(request, scene::Diffuse{times(reflectance, 1 / (1 - weight))});
  return add(request, scene::Blend{{weight}, back, through});
}

Index Materials::load_interface(const Request& request) {
  return add(request, scene::Null{});
}

Index Materials::load_mix(const Request& request) {
  const SourceLocation& where = request.parameters.where();
  const Parameter* names =
      request.parameters.find("materials", {ParameterType::kString}, context_.problems);
  if (!names || names->strings.size() != 2) {
    context_.problems.fail("material \"mix\" needs \"string materials\" with two names", where);
    return 0;
  }
  const Index first = build_named(names->strings[0], where, request.shape_uv);
  const Index second = build_named(names->strings[1], where, request.shape_uv);
  const Scalar amount = scalar(request, "amount", 0.5F);
  if (is_constant(amount) && !(amount.value >= 0 && amount.value <= 1)) {
    context_.problems.fail("\"amount\" must lie between 0 and 1", where);
  }
  return add(request, scene::Blend{amount, first, second});
}

}  // namespace metrofarm::scene_file::pbrt
