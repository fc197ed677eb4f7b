// The layout of primary sample space. Coordinates come in pairs; a pair's slot is fixed by what it
// decides and at which vertex of the path, so an event that flips early on a path does not change
// the meaning of what follows.
#pragma once

namespace metrofarm::primary_space {

using Slot = int;

// Camera stream. The lens and time slots stay unread for a pinhole and a still scene: a pair that
// nobody reads costs nothing.
inline constexpr Slot kFilmSlot = 0;
inline constexpr Slot kLensSlot = 1;
inline constexpr Slot kTimeSlot = 2;
inline constexpr Slot kFirstEyeSlot = 3;

// What a vertex of the eye path decides.
enum class Decision : int {
  kLobe = 0,       // .first: lobe, .second: Russian roulette
  kDirection = 1,  // scattered direction
  kLight = 2,      // .first: which light, .second: which component of a mixed material
  kLightPoint = 3  // point on the light
};
inline constexpr int kDecisionsPerVertex = 4;

// vertex counts surface vertices from the camera, from 0.
constexpr Slot eye_slot(int vertex, Decision decision) {
  return kFirstEyeSlot + kDecisionsPerVertex * vertex + static_cast<int>(decision);
}

// Paths without a depth limit end by Russian roulette; beyond this many edges they are cut (at a
// survival probability of at most 0.95 per edge, fewer than one in 10^10 gets there).
inline constexpr int kLongestPath = 512;
inline constexpr int kSlotCount = kFirstEyeSlot + kDecisionsPerVertex * kLongestPath;

}  // namespace metrofarm::primary_space
