// Serialization of a chain group between two segments. The format is private to one build: a worker
// of another version never reads it.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "metropolis/chain_pack.h"
#include "work_unit/context.h"
#include "work_unit/render_target.h"

namespace metrofarm::work_unit {

// The chains of a group move between its packs, see deal().
struct PackState {
  std::array<uint8_t, kLanes> members = {};  // which of the group's chains, by lane
  metropolis::ChainPack::State chains;
  std::array<RenderTarget::Payload, kLanes> payload;
  std::array<std::vector<primary_space::StoredPair>, kLanes> pairs;
};

using GroupState = std::array<PackState, kPacksPerGroup>;

// Every so many iterations the chains of a group are dealt to its packs anew, and what they have
// gathered is recorded. Coordinators count on the number: a segment that ends on a multiple of it
// can be gone on with as if it had not ended, to the same bits (CutMultiple of
// services/internal/plan).
inline constexpr uint64_t kDealInterval = 16;

// Sorts the chains by the length of their subpaths, so that the lanes of a pack have alike work. It
// depends on the chains' states alone.
void deal(GroupState& state);

// Large-step sums of all chains of the group, in chain order.
std::vector<metropolis::LargeStepSums> large_step_sums(const GroupState& state);

std::string serialize(const GroupState& state);
// Fails on anything that serialize() does not write.
Result<GroupState> parse_group_state(std::string_view bytes);

}  // namespace metrofarm::work_unit
