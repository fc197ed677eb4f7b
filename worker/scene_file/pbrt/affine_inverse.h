#pragma once

#include <optional>

#include "scene_file/affine.h"

namespace metrofarm::scene_file::pbrt {

// The inverse of an affine map; nothing if it is singular.
inline std::optional<Matrix> affine_inverse(const Matrix& m) {
  const double det = determinant(m);
  if (!(det != 0)) return std::nullopt;
  const Point columns[3] = {column(m, 0), column(m, 1), column(m, 2)};
  const Point rows[3] = {cross(columns[1], columns[2]), cross(columns[2], columns[0]),
                         cross(columns[0], columns[1])};
  Matrix inverse = kIdentity;
  for (size_t row = 0; row < 3; ++row) {
    for (size_t col = 0; col < 3; ++col) inverse[4 * row + col] = rows[row][col] / det;
    inverse[4 * row + 3] = -dot(rows[row], column(m, 3)) / det;
  }
  return inverse;
}

}  // namespace metrofarm::scene_file::pbrt
