#include "motion/pose.h"

#include <algorithm>
#include <cmath>

namespace metrofarm::motion {
namespace {

using scene::determinant;
using scene::inverse_transpose;

double column_length(const Linear& m, int column) {
  return std::hypot(m[column], m[3 + column], m[6 + column]);
}

bool flattens(const Linear& m) {
  // Hadamard's bound: the volume that perpendicular columns of these lengths would span.
  const double largest = column_length(m, 0) * column_length(m, 1) * column_length(m, 2);
  constexpr double kRounding = 1e-13;
  return !(std::fabs(determinant(m)) > kRounding * largest);
}

Linear transposed(const Linear& m) {
  return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
}

// The orthogonal factor of the polar decomposition, by Newton's iteration with scaling (Higham
// 1986, "Computing the Polar Decomposition", sections 3 and 5). Requires: m does not flatten.
Linear orthogonal_factor(Linear m) {
  constexpr int kMost = 100;
  constexpr double kConverged = 1e-15;
  double change = 1;
  for (int i = 0; i < kMost && change > kConverged; ++i) {
    const Linear across = inverse_transpose(m);
    const double scale = std::cbrt(1 / std::fabs(determinant(m)));
    change = 0;
    for (size_t j = 0; j < m.size(); ++j) {
      const double next = 0.5 * (scale * m[j] + across[j] / scale);
      change = std::max(change, std::fabs(next - m[j]));
      m[j] = next;
    }
  }
  return m;
}

}  // namespace

Linear multiply(const Linear& a, const Linear& b) {
  Linear product{};
  for (int i = 0; i < 9; ++i) {
    for (int k = 0; k < 3; ++k) product[i] += a[3 * (i / 3) + k] * b[3 * k + i % 3];
  }
  return product;
}

Matrix multiply(const Matrix& a, const Matrix& b) {
  const Linear outer = scene::linear_part(a);
  Point offset = {a[3], a[7], a[11]};
  for (int k = 0; k < 3; ++k) {
    for (int j = 0; j < 3; ++j) offset[k] += outer[3 * k + j] * b[4 * j + 3];
  }
  return affine(multiply(outer, scene::linear_part(b)), offset);
}

Matrix affine(const Linear& l, const Point& o) {
  return {l[0], l[1], l[2], o[0], l[3], l[4], l[5], o[1], l[6], l[7], l[8], o[2], 0, 0, 0, 1};
}

std::optional<Parts> decompose(const Matrix& m) {
  const Linear linear = scene::linear_part(m);
  if (flattens(linear)) return std::nullopt;
  Linear rotation = orthogonal_factor(linear);
  if (determinant(rotation) < 0) {
    for (double& v : rotation) v = -v;
  }
  return Parts{
      {m[3], m[7], m[11]}, to_quaternion(rotation), multiply(transposed(rotation), linear)};
}

Matrix compose(const Parts& parts) {
  return affine(multiply(to_linear(parts.rotation), parts.stretch), parts.offset);
}

Quaternion multiply(const Quaternion& a, const Quaternion& b) {
  return {a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
          a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
          a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
          a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]};
}

Quaternion conjugate(const Quaternion& q) {
  return {-q[0], -q[1], -q[2], q[3]};
}

Quaternion rotation_about(const Point& axis, double radians) {
  const double scale = std::sin(radians / 2) / std::hypot(axis[0], axis[1], axis[2]);
  return {axis[0] * scale, axis[1] * scale, axis[2] * scale, std::cos(radians / 2)};
}

Linear to_linear(const Quaternion& q) {
  const auto [x, y, z, w] = q;
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

// The largest component is found first, the others follow without cancellation (Shepperd 1978).
Quaternion to_quaternion(const Linear& m) {
  const std::array<double, 4> squares = {1 + m[0] - m[4] - m[8], 1 - m[0] + m[4] - m[8],
                                         1 - m[0] - m[4] + m[8], 1 + m[0] + m[4] + m[8]};
  const auto largest = std::max_element(squares.begin(), squares.end()) - squares.begin();
  const double xy = m[3] + m[1], xz = m[6] + m[2], yz = m[7] + m[5];
  const double wx = m[7] - m[5], wy = m[2] - m[6], wz = m[3] - m[1];
  const std::array<Quaternion, 4> rows = {
      Quaternion{squares[0], xy, xz, wx}, Quaternion{xy, squares[1], yz, wy},
      Quaternion{xz, yz, squares[2], wz}, Quaternion{wx, wy, wz, squares[3]}};
  Quaternion q = rows[static_cast<size_t>(largest)];
  const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
  for (double& component : q) component /= norm;
  return q;
}

Point rotated(const Quaternion& q, const Point& v) {
  const Linear m = to_linear(q);
  return {m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
          m[6] * v[0] + m[7] * v[1] + m[8] * v[2]};
}

}  // namespace metrofarm::motion
