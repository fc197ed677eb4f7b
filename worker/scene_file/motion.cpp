#include "scene_file/motion.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace metrofarm::scene_file {
namespace {

using Quaternion = std::array<double, 4>;  // x y z w

struct Parts {
  Point offset;
  Matrix rotation;  // determinant 1
  Matrix stretch;   // with the mirror, if there is one
};

double mix(double a, double b, double t) {
  return (1 - t) * a + t * b;
}

Matrix transposed_linear(const Matrix& m) {
  return {m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, 0, 0, 0, 1};
}

// The orthogonal factor of the polar decomposition, by Newton's iteration with scaling (Higham
// 1986, "Computing the Polar Decomposition", sections 3 and 5). Requires: m does not flatten.
Matrix orthogonal_factor(Matrix m) {
  m[3] = m[7] = m[11] = 0;
  constexpr int kMost = 100;
  constexpr double kConverged = 1e-15;
  double change = 1;
  for (int i = 0; i < kMost && change > kConverged; ++i) {
    Matrix inverse_transpose = normal_matrix(m);
    const double det = std::abs(determinant(m));
    const double scale = std::cbrt(1 / det);
    change = 0;
    for (size_t j = 0; j < m.size(); ++j) {
      if (j % 4 == 3 || j >= 12) continue;
      const double next = 0.5 * (scale * m[j] + inverse_transpose[j] / (det * scale));
      change = std::max(change, std::abs(next - m[j]));
      m[j] = next;
    }
  }
  return m;
}

std::optional<Parts> decompose(const Matrix& m) {
  if (flattens(m)) return std::nullopt;
  Matrix rotation = orthogonal_factor(m);
  if (determinant(rotation) < 0) {
    for (size_t j = 0; j < 12; ++j) rotation[j] = -rotation[j];
  }
  Matrix linear = m;
  linear[3] = linear[7] = linear[11] = 0;
  return Parts{column(m, 3), rotation, multiply(transposed_linear(rotation), linear)};
}

// Of a rotation: the largest component is found first, the others follow without cancellation
// (Shepperd 1978).
Quaternion to_quaternion(const Matrix& m) {
  const std::array<double, 4> squares = {1 + m[0] - m[5] - m[10], 1 - m[0] + m[5] - m[10],
                                         1 - m[0] - m[5] + m[10], 1 + m[0] + m[5] + m[10]};
  const auto largest = std::max_element(squares.begin(), squares.end()) - squares.begin();
  const double xy = m[4] + m[1], xz = m[8] + m[2], yz = m[9] + m[6];
  const double wx = m[9] - m[6], wy = m[2] - m[8], wz = m[4] - m[1];
  const std::array<Quaternion, 4> rows = {
      Quaternion{squares[0], xy, xz, wx}, Quaternion{xy, squares[1], yz, wy},
      Quaternion{xz, yz, squares[2], wz}, Quaternion{wx, wy, wz, squares[3]}};
  Quaternion q = rows[static_cast<size_t>(largest)];
  const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
  for (double& component : q) component /= norm;
  return q;
}

// Along the shorter arc. Weights sin((1 - t) a) / sin a and sin(t a) / sin a, a the arc's angle.
Quaternion between(const Quaternion& from, Quaternion to, double t) {
  double cosine = 0;
  for (size_t i = 0; i < 4; ++i) cosine += from[i] * to[i];
  if (cosine < 0) {
    for (double& component : to) component = -component;
  }
  double sine = 0;
  for (size_t i = 0; i < 4; ++i) {
    sine += (to[i] - std::abs(cosine) * from[i]) * (to[i] - std::abs(cosine) * from[i]);
  }
  const double angle = std::atan2(std::sqrt(sine), std::abs(cosine));
  constexpr double kTiny = 1e-8;  // the weights are linear in t up to its square
  const bool tiny = angle < kTiny;
  const double weight_from = tiny ? 1 - t : std::sin((1 - t) * angle) / std::sin(angle);
  const double weight_to = tiny ? t : std::sin(t * angle) / std::sin(angle);
  Quaternion q;
  for (size_t i = 0; i < 4; ++i) q[i] = weight_from * from[i] + weight_to * to[i];
  return q;
}

Matrix to_matrix(const Quaternion& q) {
  const auto [x, y, z, w] = q;
  return {1 - 2 * (y * y + z * z),
          2 * (x * y - w * z),
          2 * (x * z + w * y),
          0,  //
          2 * (x * y + w * z),
          1 - 2 * (x * x + z * z),
          2 * (y * z - w * x),
          0,  //
          2 * (x * z - w * y),
          2 * (y * z + w * x),
          1 - 2 * (x * x + y * y),
          0,  //
          0,
          0,
          0,
          1};
}

}  // namespace

std::optional<Matrix> pose_at(const std::vector<scene::Keyframe>& keys, double time) {
  const auto after = std::upper_bound(keys.begin(), keys.end(), time,
                                      [](double t, const auto& key) { return t < key.time; });
  if (after == keys.begin()) return after->to_world;
  const auto before = std::prev(after);
  if (after == keys.end() || before->time == time || before->to_world == after->to_world) {
    return before->to_world;
  }
  const double t = (time - before->time) / (after->time - before->time);
  const std::optional<Parts> a = decompose(before->to_world);
  const std::optional<Parts> b = decompose(after->to_world);
  if (!a || !b) return std::nullopt;
  const Quaternion q = between(to_quaternion(a->rotation), to_quaternion(b->rotation), t);
  Matrix stretch;
  for (size_t i = 0; i < stretch.size(); ++i) stretch[i] = mix(a->stretch[i], b->stretch[i], t);
  Matrix pose = multiply(to_matrix(q), stretch);
  for (size_t row = 0; row < 3; ++row) {
    pose[4 * row + 3] = mix(a->offset[row], b->offset[row], t);
  }
  return pose;
}

}  // namespace metrofarm::scene_file
