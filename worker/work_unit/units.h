// The units of work: pure functions of the context and their arguments. Same inputs, same bits,
// whatever thread, machine or order.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "work_unit/context.h"
#include "work_unit/group_state.h"

namespace metrofarm::work_unit {

// ---- bootstrap ----

struct BootstrapOutput {
  std::vector<float> values;  // f by sample
  uint64_t rays = 0;
  diagnostics::AnomalyLog anomalies;
};

// Samples [first, first + count). Requires: both multiples of kLanes.
BootstrapOutput run_bootstrap(const Context& context, uint64_t first, uint32_t count);

// ---- chains ----

struct ChainSeeds {
  std::vector<uint64_t> indices;  // kGroupSize bootstrap indices
  std::vector<float> values;      // what the bootstrap reported for them
};

struct ChainGroup {
  uint32_t group = 0;
  GroupState state;
};

// States of chains that start from their seeds. Fails if a seed's value is not reproduced exactly:
// a free check that this worker sees the scene that the bootstrap saw.
Result<GroupState> start_chains(const Context& context, const ChainSeeds& seeds);

struct SegmentOutput {
  uint64_t digest = 0;
  Counts counts;
  diagnostics::AnomalyLog anomalies;
};

// Advances every chain of a group by `mutations` and leaves the new state in `chains`.
SegmentOutput run_chain_segment(const Context& context, ChainGroup& chains, uint64_t mutations,
                                film::Film& film);

// ---- independent paths ----

struct PathRange {
  uint32_t segment = 0;
  uint64_t first_sample = 0;  // per pixel
  uint64_t samples = 0;       // per pixel
};

SegmentOutput run_path_segment(const Context& context, const PathRange& range, film::Film& film);

}  // namespace metrofarm::work_unit
