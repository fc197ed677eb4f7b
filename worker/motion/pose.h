// Affine maps taken apart into what can be interpolated: a stretch, then a rotation, then a
// translation (Shoemake and Duff 1992, "Matrix Animation and Polar Decomposition").
#pragma once

#include <array>
#include <optional>

#include "scene/description.h"
#include "scene/linear.h"

namespace metrofarm::motion {

using scene::Linear;
using scene::Matrix;
using scene::Point;

using Quaternion = std::array<double, 4>;  // x y z w, unit

struct Parts {
  Point offset = {0, 0, 0};
  Quaternion rotation = {0, 0, 0, 1};
  Linear stretch = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // symmetric; with the mirror, if there is one
};

// Nothing if the map flattens space, or nearly so: then it has no such parts.
std::optional<Parts> decompose(const Matrix& m);
Matrix compose(const Parts& parts);

// The rotation that comes second times the one that comes first.
Quaternion multiply(const Quaternion& second, const Quaternion& first);
Quaternion conjugate(const Quaternion& q);
Quaternion rotation_about(const Point& axis, double radians);  // Requires: axis is not zero
Linear to_linear(const Quaternion& q);
// Of a rotation.
Quaternion to_quaternion(const Linear& m);
Point rotated(const Quaternion& q, const Point& v);

Linear multiply(const Linear& a, const Linear& b);
Matrix multiply(const Matrix& a, const Matrix& b);
Matrix affine(const Linear& linear, const Point& offset);

}  // namespace metrofarm::motion
