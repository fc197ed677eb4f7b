#include "scene_file/affine.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene/linear.h"

namespace metrofarm::scene_file {

Matrix multiply(const Matrix& a, const Matrix& b) {
  Matrix product{};
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 4; ++col) {
      for (int k = 0; k < 4; ++k) product[row * 4 + col] += a[row * 4 + k] * b[k * 4 + col];
    }
  }
  return product;
}

Matrix translation(const Point& offset) {
  return {1, 0, 0, offset[0], 0, 1, 0, offset[1], 0, 0, 1, offset[2], 0, 0, 0, 1};
}

Matrix scaling(const Point& factors) {
  return {factors[0], 0, 0, 0, 0, factors[1], 0, 0, 0, 0, factors[2], 0, 0, 0, 0, 1};
}

Matrix rotation(const Point& axis, double degrees) {
  return rotation_formula(normalized(axis), degrees);
}

Matrix rotation_formula(const Point& axis, double degrees) {
  const auto [x, y, z] = axis;
  const double radians = degrees * (std::numbers::pi / 180);
  const double s = std::sin(radians);
  const double c = std::cos(radians);
  const double t = 1 - c;
  return {t * x * x + c,
          t * x * y - s * z,
          t * x * z + s * y,
          0,  //
          t * x * y + s * z,
          t * y * y + c,
          t * y * z - s * x,
          0,  //
          t * x * z - s * y,
          t * y * z + s * x,
          t * z * z + c,
          0,  //
          0,
          0,
          0,
          1};
}

std::optional<Matrix> look_at(const Point& origin, const Point& target, const Point& up) {
  const Point forward = normalized(subtract(target, origin));
  const Point left = cross(normalized(up), forward);
  constexpr double kSmallestSine = 1e-9;
  if (length(forward) == 0 || length(left) < kSmallestSine) return std::nullopt;
  const Point x = normalized(left);
  const Point y = cross(forward, x);
  return Matrix{x[0], y[0], forward[0], origin[0], x[1], y[1], forward[1], origin[1],
                x[2], y[2], forward[2], origin[2], 0,    0,    0,          1};
}

// Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
Point any_perpendicular(const Point& unit) {
  const auto [x, y, z] = unit;
  const double sign = std::copysign(1.0, z);
  const double a = -1 / (sign + z);
  return {1 + sign * x * x * a, sign * x * y * a, -sign * x};
}

Point cross(const Point& a, const Point& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double dot(const Point& a, const Point& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Point subtract(const Point& a, const Point& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

double length(const Point& v) {
  return std::hypot(v[0], v[1], v[2]);
}

Point normalized(const Point& v) {
  const double norm = length(v);
  if (!(norm > 0)) return {0, 0, 0};
  return {v[0] / norm, v[1] / norm, v[2] / norm};
}

Point transform_point(const Matrix& m, const Point& p) {
  return {m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3],
          m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
          m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11]};
}

Point column(const Matrix& m, int i) {
  return {m[i], m[4 + i], m[8 + i]};
}

double determinant(const Matrix& m) {
  return scene::determinant(scene::linear_part(m));
}

bool flattens(const Matrix& m) {
  // Hadamard's bound: the volume that perpendicular columns of these lengths would span.
  const double largest = length(column(m, 0)) * length(column(m, 1)) * length(column(m, 2));
  constexpr double kRounding = 1e-13;
  return !(std::abs(determinant(m)) > kRounding * largest);
}

Matrix normal_matrix(const Matrix& m) {
  const double sign = determinant(m) < 0 ? -1 : 1;
  const Point x = cross(column(m, 1), column(m, 2));
  const Point y = cross(column(m, 2), column(m, 0));
  const Point z = cross(column(m, 0), column(m, 1));
  return {sign * x[0], sign * y[0], sign * z[0], 0, sign * x[1], sign * y[1], sign * z[1], 0,
          sign * x[2], sign * y[2], sign * z[2], 0, 0,           0,           0,           1};
}

double deviation_from_rotation(const Matrix& m, double scale) {
  double worst = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const double expected = i == j ? scale * scale : 0;
      worst = std::max(worst, std::abs(dot(column(m, i), column(m, j)) - expected));
    }
  }
  return worst;
}

}  // namespace metrofarm::scene_file
