#include "metropolis/chain_pack.h"

namespace metrofarm::metropolis {
namespace {

// A state's weight is recorded before it grows past this: single precision then loses no more than
// a splat's own rounding, and a splat stays small.
constexpr float kWeightLimit = 16;

// What an iteration may record, each under a number of its own. Whether it does depends on no other
// lane, and the numbers on nothing at all.
enum Serial { kLargeStep, kLeft, kPassedBy, kSecondPassedBy, kSerials };

Mask not_zero(Float x) {
  return (x > Float(0.F)) | (x < Float(0.F));
}

}  // namespace

ChainPack::ChainPack(const ChainPackConfig& config, Target& target)
    : delayed_(config.moves.delayed_rejection()),
      scales_{static_cast<float>(config.moves.kernel().large_step_probability * config.unit),
              static_cast<float>(config.moves.kernel().large_step_probability), config.weights},
      large_end_(static_cast<float>(config.moves.kernel().large_step_probability)),
      eye_end_(large_end_ + static_cast<float>(config.moves.kernel().eye_step_probability)),
      light_end_(eye_end_ + static_cast<float>(config.moves.kernel().light_step_probability)),
      inverse_unit_(static_cast<float>(1 / config.unit)),
      target_(target),
      sample_(config.key, config.members, config.moves) {}

void ChainPack::advance(uint64_t n) {
  for (uint64_t i = 0; i < n; ++i) iterate();
}

void ChainPack::iterate() {
  const Coins coins = sample_.begin(iteration_++);
  Outcome o;
  o.steps = steps_of(coins.step);
  sample_.set_steps(o.steps);
  o.f_y = evaluate(Stage::kFirst, all_lanes());
  o.first_acceptance = metropolis_acceptance(f_, o.f_y);
  o.first = coins.acceptance < o.first_acceptance;
  target_.observe({o.steps.large, o.first, o.first_acceptance});

  record_proposal(o);
  if (delayed_.enabled()) try_second(o, coins.second);
  move(o);
  observe(o);
}

// The coin does not look at the state, so each kind of step may be reversible by itself.
Steps ChainPack::steps_of(Float coin) const {
  const Mask large = coin < Float(large_end_);
  const Mask eye = ~large & (coin < Float(eye_end_));
  const Mask light = ~large & ~eye & (coin < Float(light_end_));
  return {large, eye, light};
}

// f at a stage's point; the payload of the reverse proposal takes the first one's place, which has
// been recorded by then.
Float ChainPack::evaluate(Stage stage, Mask lanes) {
  sample_.enter(stage);
  counts_.evaluations += __builtin_popcount(bits(lanes));
  const Which into = stage == Stage::kSecond ? Which::kSecond : Which::kProposal;
  return target_.evaluate(sample_, into, lanes);
}

void ChainPack::record_proposal(const Outcome& o) {
  const Layer layer =
      scales_.weights == LayerWeights::kTwoLayer ? Layer::kLargeStep : Layer::kChain;
  const Mask independent = o.steps.large & (o.f_y > Float(0.F));
  if (any(independent))
    target_.record(Which::kProposal, layer, scales_.large_step(o.f_y), independent,
                   serial_ + kLargeStep);
  const Mask passed_by = ~o.first & (o.first_acceptance > Float(0.F));
  target_.record(Which::kProposal, Layer::kChain, scales_.chain(o.first_acceptance, o.f_y),
                 passed_by, serial_ + kPassedBy);
}

Mask ChainPack::wants_second(const Outcome& o) const {
  const Mask after_small = delayed_.move == SecondMove::kNone ? no_lanes() : o.steps.small();
  const Mask after_large = delayed_.after_large_steps ? o.steps.large : no_lanes();
  return ~o.first & (after_small | after_large);
}

void ChainPack::try_second(Outcome& o, Float coin) {
  o.second_tried = wants_second(o);
  if (none(o.second_tried)) return;
  o.f_z = evaluate(Stage::kSecond, o.second_tried);
  o.second_acceptance = keep(o.second_tried, judge_second(o));
  o.second = coin < o.second_acceptance;
}

// Acceptance of z in the lanes that have one. After a large step its density cancels: y does not
// depend on x or z, and the local move between them is symmetric.
Float ChainPack::judge_second(const Outcome& o) {
  Float f_reverse = o.f_y, ratio(1.F);
  const Mask small = o.second_tried & o.steps.small();
  if (delayed_.rule == AcceptanceRule::kTierneyMira && any(small))
    ratio = select(small, xsimd::exp(sample_.log_ratio()), ratio);
  // Without light at z there is nothing that f at the reverse proposal could decide.
  const Mask open = small & (o.f_z > Float(0.F));
  if (delayed_.rule == AcceptanceRule::kGreenMira && any(open))
    f_reverse = select(open, evaluate(Stage::kReverse, open), f_reverse);
  return second_acceptance(f_ - o.f_y, o.f_z - f_reverse, ratio);
}

// The state that is left behind takes its whole weight along; the one that stays gathers more.
void ChainPack::move(const Outcome& o) {
  const ExpectedWeights w = expected_weights(o.first_acceptance, o.second_acceptance);
  const Float gathered = weight_ + w.current;
  const Mask leaves = o.first | o.second | (gathered > Float(kWeightLimit));
  target_.record(Which::kCurrent, Layer::kChain, scales_.chain(gathered, f_),
                 leaves & not_zero(gathered), serial_ + kLeft);
  target_.accept(Which::kProposal, o.first);
  weight_ = select(o.first, w.first, select(leaves, Float(0.F), gathered));
  f_ = select(o.first, o.f_y, f_);
  if (any(o.second_tried)) {
    const Mask passed_by = ~o.second & (w.second > Float(0.F));
    target_.record(Which::kSecond, Layer::kChain, scales_.chain(w.second, o.f_z), passed_by,
                   serial_ + kSecondPassedBy);
    target_.accept(Which::kSecond, o.second);
    weight_ = select(o.second, w.second, weight_);
    f_ = select(o.second, o.f_z, f_);
  }
  sample_.finish(o.first, o.second);
  serial_ += kSerials;
}

void ChainPack::observe(const Outcome& o) {
  const uint32_t large = bits(o.steps.large), small = bits(o.steps.small());
  const uint32_t first = bits(o.first);
  counts_.mutations += kLanes;
  counts_.large.add(large, first);
  counts_.small.add(small, first);
  counts_.subpath.add(bits(o.steps.subpath()), first);
  if (any(o.second_tried)) {
    const uint32_t tried = bits(o.second_tried), second = bits(o.second);
    counts_.second_after_large.add(tried & large, second);
    counts_.second_after_small.add(tried & small, second);
  }
  stays_.observe(o.first | o.second);
  if (large != 0) add_large_steps(o.f_y, large);
}

void ChainPack::add_large_steps(Float f_y, uint32_t lanes) {
  alignas(32) float f[kLanes];
  (f_y * Float(inverse_unit_)).store_aligned(f);
  for (uint32_t rest = lanes; rest != 0; rest &= rest - 1) {
    const int lane = __builtin_ctz(rest);
    ++sums_[lane].count;
    sums_[lane].sum += f[lane];
    sums_[lane].sum_squares += double(f[lane]) * f[lane];
  }
}

ChainCounts ChainPack::counts() const {
  ChainCounts counts = counts_;
  counts.pairs_read = sample_.pairs_read();
  counts.stays = stays_.counts();
  return counts;
}

void ChainPack::flush() {
  const Mask waiting = not_zero(weight_);
  target_.record(Which::kCurrent, Layer::kChain, scales_.chain(weight_, f_), waiting, serial_++);
  weight_ = Float(0.F);
}

ChainPack::State ChainPack::state() const {
  State s;
  s.iteration = iteration_;
  s.serial = serial_;
  f_.store_aligned(s.f);
  s.sums = sums_;
  s.stays = stays_.lengths();
  return s;
}

void ChainPack::set_state(const State& s) {
  iteration_ = s.iteration;
  serial_ = s.serial;
  f_ = Float::load_aligned(s.f);
  sums_ = s.sums;
  stays_.set_lengths(s.stays);
  weight_ = Float(0.F);
}

}  // namespace metrofarm::metropolis
