#include "scene_file/pbrt/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "spectrum/luminance.h"
#include "spectrum/srgb.h"

namespace metrofarm::scene_file::pbrt {
namespace {

using scene::Rgb;

constexpr double kPi = std::numbers::pi;

float channel(const scene::Image& image, size_t i) {
  if (const auto* floats = std::get_if<std::vector<float>>(&image.pixels)) return (*floats)[i];
  const double value = std::get<std::vector<uint8_t>>(image.pixels)[i] / 255.0;
  return static_cast<float>(image.srgb ? srgb_to_linear(value) : value);
}

// Without negative parts, as in pbrt.
Rgb pixel(const scene::Image& image, int x, int y) {
  const size_t first =
      (static_cast<size_t>(y) * static_cast<size_t>(image.width) + static_cast<size_t>(x)) *
      static_cast<size_t>(image.channels);
  Rgb rgb{};
  for (size_t c = 0; c < 3; ++c) {
    rgb[c] = std::max(channel(image, first + (image.channels >= 3 ? c : 0)), 0.F);
  }
  return rgb;
}

bool all_finite(const scene::Image& image) {
  const auto* floats = std::get_if<std::vector<float>>(&image.pixels);
  return !floats || std::all_of(floats->begin(), floats->end(),
                                [](float value) { return std::isfinite(value); });
}

// The pixel that pbrt sees in that direction; it doesn't interpolate either.
Rgb look_up(const scene::Image& map, const Point& direction) {
  const auto [u, v] = equal_area_square(direction);
  const auto at = [](double s, int size) {
    return std::clamp(static_cast<int>(s * size), 0, size - 1);
  };
  return pixel(map, at(u, map.width), at(v, map.height));
}

// Direction of scene::EnvironmentEmitter at (u, v) in [0, 1], v downwards.
Point direction_at(double u, double v) {
  const double sine = std::sin(kPi * v);
  return {sine * std::sin(2 * kPi * u), std::cos(kPi * v), -sine * std::cos(2 * kPi * u)};
}

}  // namespace

std::array<double, 2> equal_area_square(const Point& d) {
  const double r = std::sqrt(std::max(1 - std::abs(d[2]), 0.0));
  double v = r * std::atan2(std::abs(d[1]), std::abs(d[0])) * (2 / kPi);
  double u = r - v;
  if (d[2] < 0) {
    std::swap(u, v);
    u = 1 - u;
    v = 1 - v;
  }
  return {(std::copysign(u, d[0]) + 1) / 2, (std::copysign(v, d[1]) + 1) / 2};
}

Result<scene::Image> to_latitude_longitude(const scene::Image& map) {
  if (map.width != map.height) {
    return Error{
        "an environment map must be square, in the equal-area octahedral mapping; this "
        "one has " +
        std::to_string(map.width) + " x " + std::to_string(map.height) +
        " pixels (pbrt's imgtool makeequiarea converts latitude-longitude maps)"};
  }
  if (!all_finite(map)) return Error{"a pixel of the environment map is not a finite number"};
  scene::Image image;
  image.height = std::max(1, static_cast<int>(std::lround(map.height * std::sqrt(kPi) / 2)));
  image.width = 2 * image.height;
  constexpr int kSamples = 4;  // per axis
  std::vector<float> pixels;
  pixels.reserve(static_cast<size_t>(image.width) * static_cast<size_t>(image.height) * 3);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      double sum[3] = {};
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const double u = (x + (s % kSamples + 0.5) / kSamples) / image.width;
        const int row = s / kSamples;
        const double v = (y + (row + 0.5) / kSamples) / image.height;
        const Rgb rgb = look_up(map, direction_at(u, v));
        for (size_t c = 0; c < 3; ++c) sum[c] += rgb[c];
      }
      for (double value : sum) {
        pixels.push_back(static_cast<float>(value / (kSamples * kSamples)));
      }
    }
  }
  image.pixels = std::move(pixels);
  return image;
}

double upward_illuminance(const scene::Image& map) {
  double sum = 0;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const double up = std::abs(2 * (x + 0.5) / map.width - 1);
      const double vp = std::abs(2 * (y + 0.5) / map.height - 1);
      const double r = up + vp;  // cos theta = 1 - r^2 in the inner diamond
      if (r < 1) sum += luminance(pixel(map, x, y).data()) * (1 - r * r);
    }
  }
  return sum * 2 * kPi / (static_cast<double>(map.width) * map.height);
}

}  // namespace metrofarm::scene_file::pbrt
