// A target with a known answer whose dimension varies: how many pairs are read depends on the
// coordinates, and narrow ridges at the scale of the mutations lie in all three pairs.
//
//   pair 0 (a, b): f = 0 where b >= 0.9
//   a < 0.5        f = 0.2 + 3 ridge(a - b)
//   a >= 0.5       reads pair 1 (c, d): f = 0.1 + 2 ridge(c - d),
//                  and where c < 0.4 reads pair 2 (e, g): f += 4 ridge(e - g)
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "metropolis/target.h"

namespace metrofarm::metropolis::test {

// Its three pairs lie in an eye subpath, in a light subpath and in what both share.
inline constexpr std::array<primary_space::Slot, 3> kBranchingSlots = {
    primary_space::kFilmSlot, primary_space::light_slot(0, primary_space::Decision::kDirection),
    primary_space::kTimeSlot};

class BranchingTarget final : public Target {
 public:
  static constexpr double kRidge = 0.02;
  static constexpr double kLargest = 6.1;
  // 5 x 10 cells over (a, b), 10 x 10 over (c, d), and the cores of both ridges.
  static constexpr int kBins = 152;

  struct Payload {
    float f = 0;
    std::array<float, 4> x{};
  };
  // Where a payload counts: its cell, and kBins - 2 or kBins - 1 if it is in a core, or else -1.
  struct Bins {
    int cell, core;
  };
  static Bins bins_of(const Payload& payload);

  // What record() is told of one lane.
  struct Record {
    Which which;
    Layer layer;
    int lane;
    double scale;
    double f;
    Bins bins;
  };
  using Sink = std::function<void(const Record&)>;

  // eager: asks for every pair, read or not.
  explicit BranchingTarget(bool eager) : eager_(eager) {}
  void set_sink(Sink sink) { sink_ = std::move(sink); }

  Float evaluate(primary_space::SampleSource& source, Which into, Mask lanes) override;
  void accept(Which from, Mask lanes) override;
  void record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) override;

  Payload payload(Which which, int lane) const;
  Payload proposal(int lane) const { return payload(Which::kProposal, lane); }
  Payload current(int lane) const { return payload(Which::kCurrent, lane); }
  void set_current(int lane, const Payload& payload);

  // Integral of f over the unit cube, and over the part of each bin.
  static double integral();
  static const std::vector<double>& bin_integrals();

 private:
  struct Found {
    Float f = Float(0.F);
    std::array<Float, 4> x = {Float(0.F), Float(0.F), Float(0.F), Float(0.F)};
  };

  void take(Which into, const Found& found, Mask lanes);

  bool eager_;
  Sink sink_;
  std::array<Found, kStates> found_;
};

// States drawn from the target itself, by rejection from uniform samples.
struct ExactStart {
  BranchingTarget::Payload payload;
  std::vector<primary_space::StoredPair> pairs;
};
std::vector<ExactStart> exact_starts(bool eager, size_t count, uint64_t seed);

}  // namespace metrofarm::metropolis::test
