#include "metropolis/chain_pack.h"

namespace metrofarm::metropolis {
namespace {

// A state's weight is recorded before it grows past this: single precision then loses no more than
// a splat's own rounding, and a splat stays small.
constexpr float kWeightLimit = 16;

UInt consecutive(uint32_t first) {
  return UInt(first) + UInt(as_uint(Int(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))));
}

}  // namespace

ChainPack::ChainPack(const ChainPackConfig& config, Target& target)
    : scales_{static_cast<float>(config.kernel.large_step_probability * config.unit),
              static_cast<float>(config.kernel.large_step_probability)},
      large_step_probability_(static_cast<float>(config.kernel.large_step_probability)),
      inverse_unit_(static_cast<float>(1 / config.unit)),
      target_(target),
      sample_(config.key, consecutive(config.first_chain), config.kernel) {}

void ChainPack::advance(uint64_t n) {
  for (uint64_t i = 0; i < n; ++i) iterate();
}

void ChainPack::iterate() {
  const Coins coins = sample_.begin(iteration_++);
  const Mask large = coins.large < Float(large_step_probability_);
  sample_.set_large(large);

  const Float f_y = target_.evaluate(sample_);
  const Float acceptance = metropolis_acceptance(f_, f_y);
  const ExpectedWeights w = expected_weights(acceptance);
  const Mask accepted = coins.acceptance < acceptance;

  record_large_steps(f_y, large);
  // The state that is left behind takes its whole weight along; the one that stays gathers more.
  const Float gathered = weight_ + w.current;
  const Mask leaves = accepted | (gathered > Float(kWeightLimit));
  const Mask passes = ~accepted & (w.proposal > Float(0.F));
  target_.record(Which::kCurrent, Layer::kChain, scales_.chain(gathered, f_), leaves, serial_++);
  target_.record(Which::kProposal, Layer::kChain, scales_.chain(w.proposal, f_y), passes,
                 serial_++);
  target_.accept(accepted);
  sample_.finish(accepted);
  weight_ = select(accepted, w.proposal, select(leaves, Float(0.F), gathered));
  f_ = select(accepted, f_y, f_);
  observe(large, accepted, f_y);
}

void ChainPack::record_large_steps(Float f_y, Mask large) {
  const Mask lanes = large & (f_y > Float(0.F));
  if (any(lanes))
    target_.record(Which::kProposal, Layer::kLargeStep, scales_.large_step(f_y), lanes, serial_);
  ++serial_;
}

void ChainPack::observe(Mask large, Mask accepted, Float f_y) {
  const uint32_t large_lanes = bits(large), accepted_lanes = bits(accepted);
  const int larges = __builtin_popcount(large_lanes);
  const int large_accepts = __builtin_popcount(large_lanes & accepted_lanes);
  counts_.mutations += kLanes;
  counts_.large_steps += larges;
  counts_.small_steps += kLanes - larges;
  counts_.large_accepted += large_accepts;
  counts_.small_accepted += __builtin_popcount(accepted_lanes) - large_accepts;
  if (larges == 0) return;
  alignas(32) float f[kLanes];
  (f_y * Float(inverse_unit_)).store_aligned(f);
  for (uint32_t rest = large_lanes; rest != 0; rest &= rest - 1) {
    const int lane = __builtin_ctz(rest);
    ++sums_[lane].count;
    sums_[lane].sum += f[lane];
    sums_[lane].sum_squares += double(f[lane]) * f[lane];
  }
}

void ChainPack::flush() {
  const Mask waiting = weight_ > Float(0.F);
  target_.record(Which::kCurrent, Layer::kChain, scales_.chain(weight_, f_), waiting, serial_++);
  weight_ = Float(0.F);
}

ChainPack::State ChainPack::state() const {
  State s;
  s.iteration = iteration_;
  s.serial = serial_;
  f_.store_aligned(s.f);
  s.sums = sums_;
  return s;
}

void ChainPack::set_state(const State& s) {
  iteration_ = s.iteration;
  serial_ = s.serial;
  f_ = Float::load_aligned(s.f);
  sums_ = s.sums;
  weight_ = Float(0.F);
}

}  // namespace metrofarm::metropolis
