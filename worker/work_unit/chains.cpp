#include <cmath>

#include "burn_in/bootstrap.h"
#include "work_unit/units.h"

namespace metrofarm::work_unit {

using metropolis::ChainPack;

BootstrapOutput run_bootstrap(const Context& context, uint64_t first, uint32_t count) {
  RenderTarget target(context);
  burn_in::Bootstrap bootstrap(context.spec().seed, context.spec().bootstrap_samples, target);
  BootstrapOutput out;
  out.values.resize(count);
  for (uint32_t i = 0; i < count; i += kLanes)
    bootstrap.evaluate(first + i).store_unaligned(&out.values[i]);
  out.rays = target.costs().rays;
  out.anomalies = target.anomalies();
  return out;
}

namespace {

Error replay_error(uint64_t index, float expected, float found) {
  return {"bootstrap sample " + std::to_string(index) + " has value " + std::to_string(found) +
          " here, but " + std::to_string(expected) +
          " was reported: workers disagree about the scene"};
}

}  // namespace

Result<GroupState> start_chains(const Context& context, const ChainSeeds& seeds) {
  if (seeds.indices.size() != kGroupSize || seeds.values.size() != kGroupSize)
    return Error{"a chain group needs " + std::to_string(kGroupSize) + " seeds"};
  RenderTarget target(context);
  burn_in::Bootstrap bootstrap(context.spec().seed, context.spec().bootstrap_samples, target);
  GroupState state;
  for (int chain = 0; chain < kGroupSize; ++chain) {
    const uint64_t index = seeds.indices[chain];
    const int from = static_cast<int>(index % kLanes);
    const float f = lane_value(bootstrap.evaluate(index - from), from);
    if (!(f > 0) || f != seeds.values[chain]) return replay_error(index, seeds.values[chain], f);
    PackState& pack = state[chain / kLanes];
    const int lane = chain % kLanes;
    pack.chains.f[lane] = f;
    pack.payload[lane] = target.proposal(from);
    pack.pairs[lane] = bootstrap.pairs(from);
  }
  return state;
}

namespace {

void load(ChainPack& chains, RenderTarget& target, const PackState& state) {
  chains.set_state(state.chains);
  for (int lane = 0; lane < kLanes; ++lane) {
    target.set_current(lane, state.payload[lane]);
    chains.sample().restore(lane, state.pairs[lane]);
  }
}

void save(const ChainPack& chains, const RenderTarget& target, PackState& state) {
  state.chains = chains.state();
  for (int lane = 0; lane < kLanes; ++lane) {
    state.payload[lane] = target.current(lane);
    state.pairs[lane] = chains.sample().stored(lane);
  }
}

Counts to_counts(const metropolis::ChainCounts& chains, const transport::PathCosts& costs) {
  Counts counts;
  counts.mutations = chains.mutations;
  counts.path_evaluations = costs.paths;
  counts.rays = costs.rays;
  counts.large_steps = chains.large.tried;
  counts.large_accepted = chains.large.accepted;
  counts.small_steps = chains.small.tried;
  counts.small_accepted = chains.small.accepted;
  counts.second_stages = chains.second_after_small.tried;
  counts.second_accepted = chains.second_after_small.accepted;
  counts.second_after_large = chains.second_after_large.tried;
  counts.second_after_large_accepted = chains.second_after_large.accepted;
  counts.coordinates = 2 * chains.pairs_read;
  return counts;
}

}  // namespace

SegmentOutput run_chain_segment(const Context& context, ChainGroup& group, uint64_t mutations,
                                film::Film& film) {
  const Spec& spec = context.spec();
  RenderTarget target(context);
  film::Splatter splatter(film, context.filter());
  metropolis::ChainCounts counts;
  const metropolis::Moves moves(spec.proposals());
  for (int p = 0; p < kPacksPerGroup; ++p) {
    const uint32_t first_chain = group.group * kGroupSize + p * kLanes;
    target.begin_pack(&splatter, group.group, first_chain);
    ChainPack chains(
        {rng_key(spec.seed, RngDomain::kChain), first_chain, moves, spec.unit, spec.layer_weights},
        target);
    load(chains, target, group.state[p]);
    chains.advance(mutations);
    chains.flush();
    save(chains, target, group.state[p]);
    counts += chains.counts();
  }
  SegmentOutput out;
  out.digest = splatter.digest();
  out.anomalies = target.anomalies();
  out.counts = to_counts(counts, target.costs());
  return out;
}

}  // namespace metrofarm::work_unit
