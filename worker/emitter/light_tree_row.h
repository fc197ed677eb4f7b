// How an inner node of a light tree lies in memory: three groups of eight floats, the first two its
// children, the third the rest of what both need.
#pragma once

namespace metrofarm::emitter::light_tree_row {

// Of a child.
inline constexpr int kCenter = 0;  // 3; of the sphere around the lights
inline constexpr int kRadius2 = 3;
inline constexpr int kAxis = 4;  // 3; of the cone of normals
inline constexpr int kIntensity = 7;
inline constexpr int kChildStride = 8;

// Of the row.
inline constexpr int kAngles = 16;  // per child: cosine of the cone, LightBounds::cos_spread
inline constexpr int kAnglesStride = 2;
inline constexpr int kReference = 20;  // per child an integer: its row, or ~light
inline constexpr int kCount = 22;      // per child an integer: how many lights it holds
inline constexpr int kStride = 24;

}  // namespace metrofarm::emitter::light_tree_row
