// The units of work: pure functions of the context and their arguments. Same inputs, same bits,
// whatever thread, machine or order. A segment that is told to stop ends within milliseconds: what
// it has added to the film by then, and its chains, are of no use to anybody.
#pragma once

#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "work_unit/context.h"
#include "work_unit/group_state.h"

namespace metrofarm::work_unit {

// ---- bootstrap ----

struct BootstrapOutput {
  std::vector<float> values;  // f by sample
  std::vector<double> map;    // where light landed, see BootstrapResult.map; if it was wanted
  uint64_t rays = 0;
  diagnostics::AnomalyLog anomalies;
};

// Samples [first, first + count). Requires: both multiples of kLanes.
BootstrapOutput run_bootstrap(const Context& context, uint64_t first, uint32_t count,
                              bool wants_map = false);

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

// Numbers of samples of every cell.
struct SampleRange {
  uint64_t first = 0;
  uint64_t count = 0;
};

struct SegmentOutput {
  uint64_t digest = 0;
  Counts counts;
  diagnostics::AnomalyLog anomalies;

  // What was rendered beside it in the same segment.
  void add(const SegmentOutput& other) {
    digest += other.digest;
    counts.add_costs(other.counts);
    anomalies.merge(other.anomalies);
  }
};

// Advances every chain of a group by `mutations` and leaves the new state in `chains`.
SegmentOutput run_chain_segment(const Context& context, ChainGroup& chains, uint64_t mutations,
                                film::Film& film, const std::stop_token& stop = {});

// What becomes of chains that start from these seeds, under another kernel than the spec's.
Result<SegmentOutput> try_kernel(const Context& context, const metropolis::Kernel& kernel,
                                 const ChainSeeds& seeds, uint64_t mutations);

// ---- independent paths ----

SegmentOutput run_path_segment(const Context& context, uint32_t segment, const SampleRange& samples,
                               film::Film& film, const std::stop_token& stop = {});

// Direct light of a chain group's share of the cells. Requires: the spec has it apart.
SegmentOutput run_direct_segment(const Context& context, uint32_t group, const SampleRange& samples,
                                 film::Film& film, const std::stop_token& stop = {});

}  // namespace metrofarm::work_unit
