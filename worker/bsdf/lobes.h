// The closed set of scattering models. Each reads its parameters from a table of floats and answers
// evaluate() and sample(); parameters() writes one entry of that table.
#pragma once

#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"
#include "bsdf/types.h"
#include "scene/description.h"

namespace metrofarm::bsdf {

// One column per parameter, one row per material; columns are gathered by row.
class ParameterTable {
 public:
  static constexpr int kColumns = 11;

  int add_row(std::initializer_list<float> values);
  Float get(int column, Int row, Mask lanes) const {
    return gather(columns_[column].data(), row, lanes);
  }
  Spectrum get_rgb(int first_column, Int row, Mask lanes) const {
    return {get(first_column, row, lanes), get(first_column + 1, row, lanes),
            get(first_column + 2, row, lanes)};
  }

 private:
  std::vector<float> columns_[kColumns];
};

// Lambertian reflection.
struct DiffuseLobe {
  static int add(ParameterTable& table, const scene::Diffuse& d) {
    return table.add_row({d.reflectance[0], d.reflectance[1], d.reflectance[2]});
  }
  static Evaluation evaluate(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                             const Vec3& wi);
  static Sample sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                       const SampleInput& u);
};

// Perfect mirror of a metal.
struct ConductorLobe {
  static int add(ParameterTable& table, const scene::Conductor& c) {
    return table.add_row({c.eta[0], c.eta[1], c.eta[2], c.k[0], c.k[1], c.k[2],
                          c.specular_reflectance[0], c.specular_reflectance[1],
                          c.specular_reflectance[2]});
  }
  static Evaluation evaluate(const ParameterTable&, Int, Mask, const Vec3&, const Vec3&) {
    return {};
  }
  static Sample sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                       const SampleInput& u);
};

// Torrance-Sparrow reflection of a metal, Walter et al. 2007 eq. 20, separable Smith masking.
template <class Distribution>
struct RoughConductorLobe {
  static int add(ParameterTable& table, const scene::RoughConductor& c) {
    return table.add_row({c.eta[0], c.eta[1], c.eta[2], c.k[0], c.k[1], c.k[2],
                          c.specular_reflectance[0], c.specular_reflectance[1],
                          c.specular_reflectance[2], c.alpha_u, c.alpha_v});
  }
  static Evaluation evaluate(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                             const Vec3& wi);
  static Sample sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                       const SampleInput& u);
};

// Smooth boundary between two dielectrics. Radiance is scaled by 1 / eta^2 on refraction.
struct DielectricLobe {
  static int add(ParameterTable& table, const scene::Dielectric& d) {
    return table.add_row({d.eta, d.specular_reflectance[0], d.specular_reflectance[1],
                          d.specular_reflectance[2], d.specular_transmittance[0],
                          d.specular_transmittance[1], d.specular_transmittance[2]});
  }
  static Evaluation evaluate(const ParameterTable&, Int, Mask, const Vec3&, const Vec3&) {
    return {};
  }
  static Sample sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                       const SampleInput& u);
};

}  // namespace metrofarm::bsdf
