#include "primary_space/stratified_source.h"

#include "base/check.h"
#include "math/sobol.h"

namespace metrofarm::primary_space {
namespace {

// Words of the generator that scramble, apart from those that are samples.
constexpr uint32_t kScrambling = 1;

// First Sobol dimension of each stratified slot. The low dimensions are the best distributed; they
// go to the film, the scattered direction and the light, the idle ones to lens and time.
constexpr int kDimensionOf[kStratifiedSlots] = {0, 10, 12, 6, 2, 8, 4};
static_assert(2 * kStratifiedSlots <= kSobolDimensions);

struct Words {
  alignas(32) uint32_t low[kLanes], high[kLanes];
};

Words consecutive_words(uint64_t first, uint64_t step) {
  Words w;
  for (int i = 0; i < kLanes; ++i) {
    w.low[i] = static_cast<uint32_t>(first + i * step);
    w.high[i] = static_cast<uint32_t>((first + i * step) >> 32);
  }
  return w;
}

// Words of points 0 .. 7, which linearity turns into those of any aligned eight.
UInt first_points(int dimension) {
  alignas(32) uint32_t words[kLanes];
  for (uint32_t i = 0; i < kLanes; ++i) words[i] = sobol_reversed(i, dimension);
  return UInt::load_aligned(words);
}

}  // namespace

void StratifiedSource::begin_points(uint64_t number, uint64_t sequence, uint32_t first) {
  METROFARM_CHECK(first % kLanes == 0);
  begin(number);
  const Words w = consecutive_words(sequence, 0);
  sequence_low_ = UInt::load_aligned(w.low);
  sequence_high_ = UInt::load_aligned(w.high);
  index_ = first;
  consecutive_ = true;
}

void StratifiedSource::begin_sequences(uint64_t number, uint64_t sequence, uint32_t index) {
  begin(number);
  const Words w = consecutive_words(sequence, 1);
  sequence_low_ = UInt::load_aligned(w.low);
  sequence_high_ = UInt::load_aligned(w.high);
  index_ = index;
  consecutive_ = false;
}

UInt StratifiedSource::reversed_word(int dimension) const {
  const UInt word(sobol_reversed(index_, dimension));
  return consecutive_ ? word ^ first_points(dimension) : word;
}

FixedPair StratifiedSource::fixed_pair(Slot slot) const {
  if (slot >= kStratifiedSlots) return IndependentSource::fixed_pair(slot);
  const RngWords key =
      random_words(static_cast<uint32_t>(slot), sequence_low_, sequence_high_, kScrambling);
  const int dimension = kDimensionOf[slot];
  return {owen_scramble(reversed_word(dimension), {key[0], key[1]}),
          owen_scramble(reversed_word(dimension + 1), {key[2], key[3]})};
}

}  // namespace metrofarm::primary_space
