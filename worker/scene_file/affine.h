// 4 x 4 matrices of affine maps in double precision, row major, acting on column vectors.
#pragma once

#include <optional>

#include "scene/description.h"

namespace metrofarm::scene_file {

using scene::Matrix;
using scene::Point;

inline constexpr Matrix kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

Matrix multiply(const Matrix& a, const Matrix& b);
Matrix translation(const Point& offset);
Matrix scaling(const Point& factors);

// Counter-clockwise rotation about an axis through the origin. Requires: axis is not zero.
Matrix rotation(const Point& axis, double degrees);
// cos I + (1 - cos) a a^T + sin [a]x: a rotation if the axis a is of unit length.
Matrix rotation_formula(const Point& axis, double degrees);

// Maps the origin to `origin`, +z towards `target` and the y-z plane to the one that holds `up`;
// nothing if these don't determine a frame.
std::optional<Matrix> look_at(const Point& origin, const Point& target, const Point& up);

// A unit vector perpendicular to a unit vector.
Point any_perpendicular(const Point& unit);

Point cross(const Point& a, const Point& b);
double dot(const Point& a, const Point& b);
Point subtract(const Point& a, const Point& b);
double length(const Point& v);
// The zero vector stays zero.
Point normalized(const Point& v);

Point transform_point(const Matrix& m, const Point& p);

// Determinant of the linear part: its sign says whether the map mirrors.
double determinant(const Matrix& m);

// Whether the linear part has no inverse that rounding leaves anything of.
bool flattens(const Matrix& m);

// Maps normals: the inverse transpose of the linear part times |determinant|, which exists for
// singular maps too. Results are not normalized.
Matrix normal_matrix(const Matrix& m);

// Column i (0..2) of the linear part: the image of a coordinate axis; 3 is the translation.
Point column(const Matrix& m, int i);

// Largest absolute deviation of linear^T linear from the identity times scale^2.
double deviation_from_rotation(const Matrix& m, double scale);

}  // namespace metrofarm::scene_file
