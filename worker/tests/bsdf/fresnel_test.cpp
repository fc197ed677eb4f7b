#include "bsdf/fresnel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>

namespace metrofarm::bsdf {
namespace {

using Complex = std::complex<double>;

// Fresnel's formulas as they stand, with a complex index and Snell's law.
double reflectance(double cosine, Complex index) {
  const Complex sine2 = (1 - cosine * cosine) / (index * index);
  const Complex cosine_t = std::sqrt(1.0 - sine2);
  const Complex s = (cosine - index * cosine_t) / (cosine + index * cosine_t);
  const Complex p = (index * cosine - cosine_t) / (index * cosine + cosine_t);
  return 0.5 * (std::norm(s) + std::norm(p));
}

float conductor(double cosine, double eta, double k) {
  return lane_value(fresnel_conductor(Float(static_cast<float>(cosine)),
                                      Float(static_cast<float>(eta)), Float(static_cast<float>(k))),
                    0);
}

TEST(FresnelConductor, AgreesWithComplexArithmetic) {
  for (double eta : {0.05, 0.2, 1.0, 1.5, 3.1, 6.0}) {
    for (double k : {0.1, 1.0, 2.4, 3.9, 9.0}) {
      for (int i = 0; i <= 50; ++i) {
        const double cosine = i / 50.0;
        EXPECT_NEAR(conductor(cosine, eta, k), reflectance(cosine, {eta, k}), 1e-5)
            << "eta " << eta << ", k " << k << ", cosine " << cosine;
      }
    }
  }
}

TEST(FresnelConductor, KnownAtNormalAndGrazingIncidence) {
  const double eta = 0.2, k = 3.9;
  const double normal = ((eta - 1) * (eta - 1) + k * k) / ((eta + 1) * (eta + 1) + k * k);
  EXPECT_NEAR(conductor(1, eta, k), normal, 1e-6);
  EXPECT_NEAR(conductor(0, eta, k), 1, 1e-6);
}

TEST(FresnelConductor, AMaterialOfNoIndexReflectsEverything) {
  for (double cosine : {0.0, 0.01, 0.5, 1.0}) EXPECT_NEAR(conductor(cosine, 0, 1), 1, 1e-6);
}

TEST(FresnelDielectric, AgreesWithTheFormulasOnBothSides) {
  for (double eta : {1.0003, 1.33, 1.5, 2.4, 1 / 1.33, 1 / 1.5, 1 / 2.4}) {
    for (int i = 1; i <= 100; ++i) {
      const double cosine = i / 100.0;
      const auto d =
          fresnel_dielectric(Float(static_cast<float>(cosine)), Float(static_cast<float>(eta)));
      EXPECT_NEAR(lane_value(d.reflectance, 0), reflectance(cosine, {eta, 0}), 1e-4)
          << "eta " << eta << ", cosine " << cosine;
      const double sine2 = (1 - cosine * cosine) / (eta * eta);
      const double cosine_t = std::sqrt(std::max(0.0, 1 - sine2));
      EXPECT_NEAR(lane_value(d.cos_transmitted, 0), cosine_t, 1e-3);
    }
  }
}

TEST(FresnelDielectric, KnownAtBrewstersAngleAndNormalIncidence) {
  const double eta = 1.5;
  const double brewster = std::cos(std::atan(eta));
  const auto at = [&](double cosine) {
    return lane_value(
        fresnel_dielectric(Float(static_cast<float>(cosine)), Float(1.5F)).reflectance, 0);
  };
  // Only the perpendicular half is reflected: ((1 - eta^2) / (1 + eta^2))^2 / 2.
  EXPECT_NEAR(at(brewster), 0.5 * std::pow((1 - 2.25) / (1 + 2.25), 2), 1e-6);
  EXPECT_NEAR(at(1), 0.04, 1e-6);
  EXPECT_NEAR(at(0), 1, 1e-6);
}

TEST(FresnelDielectric, ReflectsTotallyBeyondTheCriticalAngle) {
  const double critical = std::sqrt(1 - 1 / 2.25);
  for (double cosine : {0.0, 0.3, critical - 1e-4}) {
    const auto d = fresnel_dielectric(Float(static_cast<float>(cosine)), Float(1 / 1.5F));
    EXPECT_EQ(lane_value(d.reflectance, 0), 1.F);
    EXPECT_EQ(lane_value(d.cos_transmitted, 0), 0.F);
  }
  EXPECT_LT(
      lane_value(fresnel_dielectric(Float(static_cast<float>(critical + 1e-3)), Float(1 / 1.5F))
                     .reflectance,
                 0),
      1.F);
}

TEST(FresnelDielectric, BothSidesReflectAlike) {
  for (int i = 1; i <= 50; ++i) {
    const double cosine = i / 50.0;
    const auto outside = fresnel_dielectric(Float(static_cast<float>(cosine)), Float(1.5F));
    const auto inside = fresnel_dielectric(outside.cos_transmitted, Float(1 / 1.5F));
    EXPECT_NEAR(lane_value(outside.reflectance, 0), lane_value(inside.reflectance, 0), 1e-4);
    EXPECT_NEAR(lane_value(inside.cos_transmitted, 0), cosine, 1e-4);
  }
}

}  // namespace
}  // namespace metrofarm::bsdf
