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
inline constexpr Slot kFirstVertexSlot = 3;

// What a vertex of a subpath decides. The light subpath's vertex 0 is the point on the emitter: it
// uses kLight to choose the emitter, kLightPoint and kDirection.
enum class Decision : int {
  kLobe = 0,       // .first: lobe, .second: Russian roulette
  kDirection = 1,  // scattered or emitted direction
  kLight = 2,      // .first: which light, .second: which component of a mixed material
  kLightPoint = 3  // point on the light
};
inline constexpr int kDecisionsPerVertex = 4;

// The eye and the light subpath take turns, so that short paths use low slots only.
constexpr Slot vertex_slot(int subpath, int vertex, Decision decision) {
  return kFirstVertexSlot + kDecisionsPerVertex * (2 * vertex + subpath) +
         static_cast<int>(decision);
}
// vertex counts surface vertices from the camera, from 0.
constexpr Slot eye_slot(int vertex, Decision decision) {
  return vertex_slot(0, vertex, decision);
}
// vertex counts from the emitter, which is 0.
constexpr Slot light_slot(int vertex, Decision decision) {
  return vertex_slot(1, vertex, decision);
}

// Whose subpath a slot belongs to. Time and technique are shared by both.
enum class Stream { kEye, kLight, kShared };

// Multiplexed: .first chooses the path's length, .second its technique. An emitter scatters
// nothing, so the slot is free.
inline constexpr Slot kTechniqueSlot = light_slot(0, Decision::kLobe);

constexpr Stream stream_of(Slot slot) {
  if (slot == kTimeSlot || slot == kTechniqueSlot) return Stream::kShared;
  if (slot < kFirstVertexSlot) return Stream::kEye;
  const bool light = (slot - kFirstVertexSlot) / kDecisionsPerVertex % 2 == 1;
  return light ? Stream::kLight : Stream::kEye;
}

// Paths without a depth limit end by Russian roulette; beyond this many edges they are cut (at a
// survival probability of at most 0.95 per edge, fewer than one in 10^10 gets there).
inline constexpr int kLongestPath = 512;
inline constexpr int kSlotCount = kFirstVertexSlot + 2 * kDecisionsPerVertex * kLongestPath;

}  // namespace metrofarm::primary_space
