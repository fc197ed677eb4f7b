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

struct PackState {
  metropolis::ChainPack::State chains;
  std::array<RenderTarget::Payload, kLanes> payload;
  std::array<std::vector<primary_space::StoredPair>, kLanes> pairs;
};

using GroupState = std::array<PackState, kPacksPerGroup>;

std::string serialize(const GroupState& state);
// Fails on anything that serialize() does not write.
Result<GroupState> parse_group_state(std::string_view bytes);

}  // namespace metrofarm::work_unit
