// For how long chains have not moved: the alarm for chains that are trapped.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

#include "math/lanes.h"

namespace metrofarm::metropolis {

// A chain that has not moved for so many mutations counts as trapped. With large steps of
// probability 0.3 a state keeps a chain that long where its f is about 600 times the mean.
inline constexpr int32_t kTrappedAfter = 2000;

// What became of stays, of any number of chains and iterations.
struct StayCounts {
  uint64_t longest = 0;  // mutations without a move, of a single chain
  uint64_t trapped = 0;  // stays that reached kTrappedAfter
  uint64_t freed = 0;    // stays that ended after that

  StayCounts& operator+=(const StayCounts& o) {
    longest = std::max(longest, o.longest);
    trapped += o.trapped;
    freed += o.freed;
    return *this;
  }
};

// The stays of eight chains.
class Stays {
 public:
  using Lengths = std::array<int32_t, kLanes>;

  void observe(Mask moved) {
    const Mask was_trapped = ~less(length_, Int(kTrappedAfter));
    // Lengths stop growing just below overflow.
    const Int longer = select(less(length_, Int(kLongest)), length_ + Int(1), length_);
    freed_ += __builtin_popcount(bits(was_trapped & moved));
    length_ = select(moved, Int(0), longer);
    trapped_ += __builtin_popcount(bits(~was_trapped & ~less(length_, Int(kTrappedAfter))));
    longest_ = xsimd::max(longest_, length_);
  }

  StayCounts counts() const {
    const Lengths longest = stored(longest_);
    return {static_cast<uint64_t>(*std::max_element(longest.begin(), longest.end())), trapped_,
            freed_};
  }

  // Mutations since the last move. Requires of set_lengths: none negative.
  Lengths lengths() const { return stored(length_); }
  void set_lengths(const Lengths& lengths) {
    length_ = Int::load_unaligned(lengths.data());
    longest_ = length_;
  }

 private:
  static constexpr int32_t kLongest = std::numeric_limits<int32_t>::max();

  static Lengths stored(Int lanes) {
    Lengths out;
    lanes.store_unaligned(out.data());
    return out;
  }

  Int length_ = Int(0);
  Int longest_ = Int(0);
  uint64_t trapped_ = 0, freed_ = 0;
};

}  // namespace metrofarm::metropolis
