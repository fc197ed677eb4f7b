#include <algorithm>
#include <cmath>

#include "burn_in/bootstrap.h"
#include "work_unit/units.h"

namespace metrofarm::work_unit {

using metropolis::ChainPack;

namespace {

// The bootstrap's samples, as the job's estimator values them. Multiplexed paths are drawn with all
// lengths alike, since how to draw them well is what the bootstrap finds out.
class BootstrapRun {
 public:
  explicit BootstrapRun(const Context& context)
      : target_(context, context.make_estimator(Context::Lengths::kUniform)),
        bootstrap_(context.spec().seed, context.spec().bootstrap_samples, target_,
                   coordinates_of_lengths(context)) {}

  RenderTarget& target() { return target_; }
  burn_in::Bootstrap& bootstrap() { return bootstrap_; }

 private:
  static std::vector<uint32_t> coordinates_of_lengths(const Context& context) {
    std::vector<uint32_t> out;
    if (context.spec().integrator != Integrator::kMmlt) return out;
    const auto tracer = context.make_multiplexed(Context::Lengths::kUniform);
    const auto lengths = static_cast<int>(tracer->length_probabilities().size());
    for (int edges = 1; edges <= lengths; ++edges) out.push_back(tracer->coordinate_of(edges));
    return out;
  }

  RenderTarget target_;
  burn_in::Bootstrap bootstrap_;
};

}  // namespace

BootstrapOutput run_bootstrap(const Context& context, uint64_t first, uint32_t count,
                              bool wants_map) {
  BootstrapRun run(context);
  BootstrapOutput out;
  out.values.resize(count);
  LightMap map(context.spec().width, context.spec().height);
  for (uint32_t i = 0; i < count; i += kLanes) {
    run.bootstrap().evaluate(first + i).store_unaligned(&out.values[i]);
    if (wants_map) run.target().add_proposal_to(map);
  }
  if (wants_map) out.map = map.sums();
  out.rays = run.target().costs().rays;
  out.anomalies = run.target().anomalies();
  return out;
}

namespace {

Error replay_error(uint64_t index, float expected, float found) {
  return {"bootstrap sample " + std::to_string(index) + " has value " + std::to_string(found) +
          " here, but " + std::to_string(expected) +
          " was reported: workers disagree about the scene"};
}

// Carries a seed from the bootstrap's distribution of path lengths to that of the chains: the same
// path, divided by another probability.
class LengthChange {
 public:
  explicit LengthChange(const Context& context) {
    if (context.spec().integrator != Integrator::kMmlt) return;
    before_ = context.make_multiplexed(Context::Lengths::kUniform);
    after_ = context.make_multiplexed(Context::Lengths::kAsResolved);
  }
  bool needed() const { return before_ != nullptr; }

  void apply(size_t length_index, int lane, PackState& pack) const {
    const float ratio = before_->length_probabilities()[length_index] /
                        after_->length_probabilities()[length_index];
    pack.chains.f[lane] *= ratio;
    for (RenderTarget::LaneSplat& splat : pack.payload[lane].splats)
      for (float& v : splat.rgb) v *= ratio;
    for (primary_space::StoredPair& pair : pack.pairs[lane]) {
      if (pair.slot == primary_space::kTechniqueSlot)
        pair.first = after_->coordinate_of(static_cast<int>(length_index) + 1);
    }
  }

 private:
  std::unique_ptr<transport::MultiplexedTracer> before_, after_;
};

}  // namespace

Result<GroupState> start_chains(const Context& context, const ChainSeeds& seeds) {
  if (seeds.indices.size() != kGroupSize || seeds.values.size() != kGroupSize)
    return Error{"a chain group needs " + std::to_string(kGroupSize) + " seeds"};
  BootstrapRun run(context);
  const LengthChange lengths(context);
  GroupState state;
  for (int chain = 0; chain < kGroupSize; ++chain) {
    const uint64_t index = seeds.indices[chain];
    const int from = static_cast<int>(index % kLanes);
    const float f = lane_value(run.bootstrap().evaluate(index - from), from);
    if (!(f > 0) || f != seeds.values[chain]) return replay_error(index, seeds.values[chain], f);
    PackState& pack = state[chain / kLanes];
    const int lane = chain % kLanes;
    pack.members[lane] = static_cast<uint8_t>(chain);
    pack.chains.f[lane] = f;
    pack.payload[lane] = run.target().proposal(from);
    pack.pairs[lane] = run.bootstrap().pairs(from);
    if (lengths.needed()) lengths.apply(run.bootstrap().length_index(index - from), lane, pack);
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

Counts to_counts(const metropolis::ChainCounts& chains, const RenderTarget& target) {
  const transport::PathCosts& costs = target.costs();
  Counts counts;
  counts.mutations = chains.mutations;
  counts.path_evaluations = costs.paths;
  counts.rays = costs.rays;
  counts.large_steps = chains.large.tried;
  counts.large_accepted = chains.large.accepted;
  counts.small_steps = chains.small.tried;
  counts.small_accepted = chains.small.accepted;
  counts.subpath_steps = chains.subpath.tried;
  counts.subpath_accepted = chains.subpath.accepted;
  counts.second_stages = chains.second_after_small.tried;
  counts.second_accepted = chains.second_after_small.accepted;
  counts.second_after_large = chains.second_after_large.tried;
  counts.second_after_large_accepted = chains.second_after_large.accepted;
  counts.coordinates = 2 * chains.pairs_read;
  counts.lengths = target.lengths();
  counts.techniques = target.techniques();
  counts.stays = chains.stays;
  return counts;
}

}  // namespace

namespace {

metropolis::PackMembers members_of(const ChainGroup& group, int pack) {
  std::array<uint32_t, kLanes> chains;
  for (int lane = 0; lane < kLanes; ++lane)
    chains[lane] = group.group * kGroupSize + group.state[pack].members[lane];
  return {chains, group.group * kPacksPerGroup + pack};
}

// splatter: may be null, then nothing is splatted.
SegmentOutput advance(const Context& context, ChainGroup& group, uint64_t mutations,
                      film::Splatter* splatter, const std::stop_token& stop) {
  const Spec& spec = context.spec();
  RenderTarget target(context);
  metropolis::ChainCounts counts;
  const metropolis::Moves moves(spec.proposals());
  const RngKey key = rng_key(spec.seed, RngDomain::kChain);
  while (mutations > 0 && !stop.stop_requested()) {
    const uint64_t since_deal = group.state[0].chains.iteration % kDealInterval;
    if (since_deal == 0) deal(group.state);
    const uint64_t now = std::min(mutations, kDealInterval - since_deal);
    for (int p = 0; p < kPacksPerGroup; ++p) {
      const metropolis::PackMembers members = members_of(group, p);
      target.begin_pack(splatter, group.group, members);
      ChainPack chains({key, members, moves, spec.unit, spec.layer_weights}, target);
      load(chains, target, group.state[p]);
      chains.advance(now);
      chains.flush();
      save(chains, target, group.state[p]);
      counts += chains.counts();
    }
    mutations -= now;
  }
  SegmentOutput out;
  out.anomalies = target.anomalies();
  out.counts = to_counts(counts, target);
  return out;
}

}  // namespace

SegmentOutput run_chain_segment(const Context& context, ChainGroup& group, uint64_t mutations,
                                film::Film& film, const std::stop_token& stop) {
  film::Splatter splatter(film, context.filter());
  SegmentOutput out = advance(context, group, mutations, &splatter, stop);
  out.digest = splatter.digest();
  return out;
}

Result<SegmentOutput> try_kernel(const Context& context, const metropolis::Kernel& kernel,
                                 const ChainSeeds& seeds, uint64_t mutations) {
  Spec spec = context.spec();
  spec.kernel = kernel;
  if (const std::string problem = problem_with(spec); !problem.empty()) return Error{problem};
  const Context trial(context.scene(), spec);
  auto state = start_chains(trial, seeds);
  if (!state) return state.error();
  ChainGroup group{0, std::move(state.value())};
  return advance(trial, group, mutations, nullptr, {});
}

}  // namespace metrofarm::work_unit
