// 3 x 3 matrices: the part of an affine map that turns, scales and shears.
#pragma once

#include <array>

#include "scene/description.h"

namespace metrofarm::scene {

using Linear = std::array<double, 9>;  // row major

inline Linear linear_part(const Matrix& m) {
  return {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
}

inline double cofactor(const Linear& m, int row, int column) {
  const int r1 = (row + 1) % 3, r2 = (row + 2) % 3;
  const int c1 = (column + 1) % 3, c2 = (column + 2) % 3;
  return m[3 * r1 + c1] * m[3 * r2 + c2] - m[3 * r1 + c2] * m[3 * r2 + c1];
}

// Its sign says whether the map mirrors.
inline double determinant(const Linear& m) {
  return m[0] * cofactor(m, 0, 0) + m[1] * cofactor(m, 0, 1) + m[2] * cofactor(m, 0, 2);
}

// Of the inverse transpose, which maps normals. Requires: the determinant is not 0.
inline Linear inverse_transpose(const Linear& m) {
  const double d = determinant(m);
  Linear out;
  for (int i = 0; i < 9; ++i) out[i] = cofactor(m, i / 3, i % 3) / d;
  return out;
}

// Requires: the determinant is not 0.
inline Linear inverse(const Linear& m) {
  const Linear t = inverse_transpose(m);
  return {t[0], t[3], t[6], t[1], t[4], t[7], t[2], t[5], t[8]};
}

}  // namespace metrofarm::scene
