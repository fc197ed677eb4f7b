// The second stage's moves: exact geometry on the torus, laws of angles, and the flux of whole
// chains to and fro, which shows which combinations keep detailed balance and which do not.
#include "metropolis/moves.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "metropolis/chain_pack.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

using primary_space::FixedPair;

constexpr double kFalseAlarm = 1e-5;

Proposals with(KernelKind kernel, SecondMove move, AcceptanceRule rule) {
  Proposals p;
  p.kernel.kind = kernel;
  p.delayed_rejection.move = move;
  p.delayed_rejection.rule = rule;
  return p;
}

double turns(UInt word, int lane) {
  return static_cast<double>(static_cast<int32_t>(lane_word(word, lane))) * 0x1p-32;
}

double length(const FixedPair& p, int lane) {
  return std::hypot(turns(p.first, lane), turns(p.second, lane));
}

RngWords random_words(test::UniformLanes& random) {
  return {random.word(), random.word(), random.word(), random.word()};
}

class OrbitTest : public testing::TestWithParam<KernelKind> {};

// z = y - R d where y = x + d. |z - y| = |y - x| but for rounding to the grid, and for isotropic
// kernels the way back is exact.
TEST_P(OrbitTest, TurnsAroundTheProposal) {
  const Moves moves(with(GetParam(), SecondMove::kOrbital, AcceptanceRule::kTierneyMira));
  const Stepper stepper(moves.kernel());
  const AngleTable angles(AngleLaw::kWrappedCauchy, moves.delayed_rejection().concentration);
  test::UniformLanes random(31);
  for (int i = 0; i < 2000; ++i) {
    const FixedPair words{random.word(), random.word()};
    const RngWords own = random_words(random);
    const FixedPair to_y = moves.first(4, words.first, words.second);
    const FixedPair to_z = moves.second(4, words, own, no_lanes());
    const FixedPair z_to_y{to_y.first - to_z.first, to_y.second - to_z.second};
    const FixedPair back =
        to_torus(stepper.displacement(words.first, words.second + angles.angle(own[2])));
    for (int lane = 0; lane < kLanes; ++lane) {
      if (is_isotropic(GetParam())) {
        EXPECT_EQ(lane_word(z_to_y.first, lane), lane_word(back.first, lane));
        EXPECT_EQ(lane_word(z_to_y.second, lane), lane_word(back.second, lane));
      }
      const double radius = length(to_y, lane);
      // Beyond a quarter of the torus the way may be shorter around it.
      if (radius < 0.25) {
        EXPECT_NEAR(length(z_to_y, lane), radius, 1e-9 + 3e-7 * radius);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels, OrbitTest,
                         testing::Values(KernelKind::kKelemenPair, KernelKind::kGaussian,
                                         KernelKind::kKelemenCoordinate, KernelKind::kWrappedCauchy,
                                         KernelKind::kUniform));

TEST(Moves, FrozenCoordinatesStay) {
  for (SecondMove move : {SecondMove::kOrbital, SecondMove::kLocal}) {
    Proposals p = with(KernelKind::kKelemenPair, move, AcceptanceRule::kTierneyMira);
    p.frozen = {{3, true, false}, {5, true, true}};
    const Moves moves(p);
    test::UniformLanes random(32);
    for (Mask large : {no_lanes(), all_lanes(), mask_from_bits(0x5a)}) {
      const FixedPair words{random.word(), random.word()};
      const RngWords own = random_words(random);
      for (int slot : {3, 5, 6}) {
        const FixedPair y = moves.first(slot, words.first, words.second);
        const FixedPair z = moves.second(slot, words, own, large);
        for (const FixedPair& step : {y, z}) {
          EXPECT_EQ(lane_word(step.first, 0) == 0, slot != 6);
          EXPECT_EQ(lane_word(step.second, 0) == 0, slot == 5);
        }
      }
    }
  }
}

double wrapped_cauchy_cdf(double rho, double turn) {
  return 0.5 +
         std::atan((1 + rho) / (1 - rho) * std::tan(std::numbers::pi * turn)) / std::numbers::pi;
}

double von_mises_cdf(double kappa, double turn) {
  const auto integral = [&](double to) {
    constexpr int kSteps = 20000;
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double t = -0.5 + (to + 0.5) * (i + 0.5) / kSteps;
      sum += std::exp(kappa * (std::cos(2 * std::numbers::pi * t) - 1));
    }
    return sum * (to + 0.5);
  };
  return integral(turn) / integral(0.5);
}

struct Law {
  AngleLaw law;
  double concentration;
  double (*cdf)(double, double);
};
class AngleTest : public testing::TestWithParam<Law> {};

// H0: angles follow their law, 400,000 draws in 40 cells of equal width. An angle and its opposite
// come from words that differ in the lowest bit.
TEST_P(AngleTest, FollowsItsLawAndIsSymmetric) {
  const auto [law, concentration, cdf] = GetParam();
  const AngleTable table(law, concentration);
  test::UniformLanes random(33);
  constexpr int kDraws = 400000, kCells = 40;
  test::Histogram observed(kCells, 1), expected(kCells, 1);
  for (int i = 0; i < kDraws; i += kLanes) {
    const UInt word = random.word();
    const UInt angle = table.angle(word), opposite = table.angle(word ^ UInt(1U));
    for (int lane = 0; lane < kLanes; ++lane) {
      observed.add(turns(angle, lane) + 0.5, 0);
      EXPECT_EQ(lane_word(angle + opposite, lane), 0U);
    }
  }
  for (int i = 0; i < kCells; ++i) {
    const double low = double(i) / kCells - 0.5, high = double(i + 1) / kCells - 0.5;
    const double below = i == 0 ? 0 : cdf(concentration, low);
    const double above = i == kCells - 1 ? 1 : cdf(concentration, high);
    expected.add_to(i, 0, kDraws * (above - below));
  }
  EXPECT_TRUE(metrofarm::test::follows(observed.counts(), expected.counts(), kFalseAlarm));
}

INSTANTIATE_TEST_SUITE_P(Laws, AngleTest,
                         testing::Values(Law{AngleLaw::kWrappedCauchy, 0.7788007830714049,
                                             wrapped_cauchy_cdf},
                                         Law{AngleLaw::kWrappedCauchy, 0, wrapped_cauchy_cdf},
                                         Law{AngleLaw::kVonMises, 2.5, von_mises_cdf},
                                         Law{AngleLaw::kVonMises, 0, von_mises_cdf}));

// Sharp laws are met but for their outermost thousandth.
TEST(AngleTable, FollowsSharpLaws) {
  for (const Law& law :
       {Law{AngleLaw::kVonMises, 60, von_mises_cdf}, Law{AngleLaw::kVonMises, 10000, von_mises_cdf},
        Law{AngleLaw::kWrappedCauchy, 0.99, wrapped_cauchy_cdf}}) {
    const AngleTable table(law.law, law.concentration);
    constexpr uint32_t kWords = 1U << 16;
    for (double q : {0.01, 0.2, 0.5, 0.7, 0.99}) {
      double low = -0.5, high = 0.5;
      for (int step = 0; step < 30; ++step)
        (law.cdf(law.concentration, 0.5 * (low + high)) < q ? low : high) = 0.5 * (low + high);
      // Evenly spaced words of both signs: the law itself, without noise.
      uint32_t below = 0;
      for (uint32_t i = 0; i < kWords; ++i)
        below += turns(table.angle(UInt((i << 17) | (i >> 15))), 0) < low ? 1 : 0;
      EXPECT_NEAR(double(below) / kWords, q, 2e-3) << law.concentration;
    }
  }
}

// A hole in a plain: f = 0 within kHole of the middle, 1 elsewhere.
class HoleTarget final : public Target {
 public:
  static constexpr double kHole = 0.004;

  Float evaluate(primary_space::SampleSource& source, Which /*into*/, Mask lanes) override {
    const primary_space::Pair p = source.pair(0, lanes);
    const Float d2 = sqr(p.first - Float(0.5F)) + sqr(p.second - Float(0.5F));
    return select(d2 < Float(static_cast<float>(kHole * kHole)), Float(0.F), Float(1.F));
  }
  void accept(Which, Mask) override {}
  void record(Which, Layer, Float, Mask, uint64_t) override {}
};

// Near the coordinate axes through the hole, or near the diagonals.
enum class Sector { kAxis, kDiagonal, kNeither };

Sector sector_of(uint32_t first, uint32_t second) {
  const double x = first * 0x1p-32 - 0.5, y = second * 0x1p-32 - 0.5;
  const double radius = std::hypot(x, y);
  if (radius < 0.01 || radius > 0.018) return Sector::kNeither;
  // 0 on an axis, 1/2 on a diagonal; sectors of an eighth of the circle.
  const double from_axis = std::fabs(std::fmod(test::turns(x, y) * 4 + 0.5, 1) - 0.5);
  if (from_axis < 0.125) return Sector::kAxis;
  return from_axis > 0.375 ? Sector::kDiagonal : Sector::kNeither;
}

struct Fluxes {
  double to_diagonal = 0, to_axis = 0;

  double ratio() const { return to_diagonal / to_axis; }
  // H0: both fluxes are equal, so given their sum either is binomial with p = 1/2.
  double z() const { return (to_diagonal - to_axis) / std::sqrt(to_diagonal + to_axis); }
};

// Moves of second stages between the sectors, in one step of chains that start uniformly in a
// square around the hole.
Fluxes fluxes(const Proposals& proposals, uint32_t packs) {
  const Moves moves(proposals);
  HoleTarget target;
  test::UniformLanes random(34);
  Fluxes out;
  ChainPack::State state;
  std::fill(std::begin(state.f), std::end(state.f), 1.F);
  ChainPack chains({rng_key(3, RngDomain::kChain), 0, moves}, target);
  for (uint32_t pack = 0; pack < packs; ++pack) {
    uint32_t from[kLanes][2];
    const UInt words[2] = {random.word(), random.word()};
    for (int lane = 0; lane < kLanes; ++lane) {
      for (int i = 0; i < 2; ++i) {
        // Within 0.02 of the middle.
        const double offset = (lane_word(words[i], lane) * 0x1p-32 - 0.5) * 0.04;
        from[lane][i] = static_cast<uint32_t>((0.5 + offset) * 0x1p32);
      }
      // In the hole there is nothing to start from; the test counts no such lane.
      chains.sample().restore(lane, {{0, from[lane][0], from[lane][1]}});
    }
    state.iteration = pack;
    chains.set_state(state);
    const uint64_t before = chains.counts().second_after_small.accepted;
    chains.advance(1);
    if (chains.counts().second_after_small.accepted == before) continue;
    for (int lane = 0; lane < kLanes; ++lane) {
      const double x = from[lane][0] * 0x1p-32 - 0.5, y = from[lane][1] * 0x1p-32 - 0.5;
      if (std::hypot(x, y) < HoleTarget::kHole) continue;
      const auto at = chains.sample().stored(lane)[0];
      const Sector a = sector_of(from[lane][0], from[lane][1]);
      const Sector b = sector_of(at.first, at.second);
      out.to_diagonal += a == Sector::kAxis && b == Sector::kDiagonal;
      out.to_axis += a == Sector::kDiagonal && b == Sector::kAxis;
    }
  }
  return out;
}

Proposals around_the_hole(KernelKind kernel, SecondMove move, AcceptanceRule rule) {
  Proposals p = with(kernel, move, rule);
  p.kernel.large_step_probability = 1e-9;
  p.kernel.s1 = 0.0002;
  p.kernel.sigma = p.kernel.half_width = 0.012;
  p.kernel.scale = 0.0015;
  p.delayed_rejection.concentration = 0.5;
  p.delayed_rejection.local_scale = 1;
  return p;
}

constexpr KernelKind kAllKernels[] = {KernelKind::kKelemenPair, KernelKind::kGaussian,
                                      KernelKind::kKelemenCoordinate, KernelKind::kWrappedCauchy,
                                      KernelKind::kUniform};
constexpr SecondMove kAllMoves[] = {SecondMove::kOrbital, SecondMove::kLocal};
constexpr AcceptanceRule kAllRules[] = {AcceptanceRule::kOrbital, AcceptanceRule::kTierneyMira,
                                        AcceptanceRule::kGreenMira};

// H0: the flux between the sectors is the same both ways, for every combination that is allowed;
// but Green and Mira's reverse proposals hardly ever meet so small a hole, and whole chains test
// them. 480,000 steps each, rate 1e-5 each. Moves of the first stage count too and are balanced
// anyway.
TEST(Flux, BalancesWhereverItIsAllowed) {
  int allowed = 0;
  for (KernelKind kernel : kAllKernels) {
    for (SecondMove move : kAllMoves) {
      for (AcceptanceRule rule : kAllRules) {
        const Proposals p = around_the_hole(kernel, move, rule);
        if (problem_with(p) || rule == AcceptanceRule::kGreenMira) continue;
        ++allowed;
        const Fluxes f = fluxes(p, 60000);
        EXPECT_GT(f.to_diagonal + f.to_axis, 100);
        EXPECT_GT(test::normal_p(f.z()), kFalseAlarm)
            << static_cast<int>(kernel) << static_cast<int>(move) << static_cast<int>(rule)
            << ": ratio " << f.ratio();
      }
    }
  }
  EXPECT_EQ(allowed, 12);
}

// What is refused for its kernel would really be wrong: the same test with the same H0 tells it at
// a rate of 1e-9.
TEST(Flux, IsLostWhereItIsRefused) {
  for (KernelKind kernel : kAllKernels) {
    const Proposals p = around_the_hole(kernel, SecondMove::kOrbital, AcceptanceRule::kOrbital);
    if (!problem_with(p)) continue;
    const Fluxes f = fluxes(p, 100000);
    RecordProperty("ratio_" + std::to_string(static_cast<int>(kernel)), std::to_string(f.ratio()));
    EXPECT_LT(test::normal_p(f.z()), 1e-9) << static_cast<int>(kernel) << ": ratio " << f.ratio();
  }
}

std::string complaint(KernelKind kernel, SecondMove move, AcceptanceRule rule) {
  const auto problem = problem_with(with(kernel, move, rule));
  return problem ? problem->message : "";
}

TEST(Proposals, RefusesWhatBreaksDetailedBalance) {
  const auto orbital = [](KernelKind kernel) {
    return complaint(kernel, SecondMove::kOrbital, AcceptanceRule::kOrbital);
  };
  EXPECT_EQ(orbital(KernelKind::kKelemenPair), "");
  EXPECT_EQ(orbital(KernelKind::kGaussian), "");
  EXPECT_NE(orbital(KernelKind::kWrappedCauchy).find("wrapped_cauchy"), std::string::npos);
  EXPECT_NE(orbital(KernelKind::kWrappedCauchy).find("use tierney_mira"), std::string::npos);
  EXPECT_NE(orbital(KernelKind::kKelemenCoordinate).find("kelemen_coordinate"), std::string::npos);
  EXPECT_NE(orbital(KernelKind::kUniform).find("not isotropic"), std::string::npos);
  for (KernelKind kernel : kAllKernels) {
    EXPECT_EQ(complaint(kernel, SecondMove::kOrbital, AcceptanceRule::kTierneyMira), "");
    EXPECT_EQ(complaint(kernel, SecondMove::kLocal, AcceptanceRule::kTierneyMira), "");
    EXPECT_EQ(complaint(kernel, SecondMove::kLocal, AcceptanceRule::kGreenMira), "");
    EXPECT_NE(complaint(kernel, SecondMove::kOrbital, AcceptanceRule::kGreenMira), "");
    EXPECT_NE(complaint(kernel, SecondMove::kLocal, AcceptanceRule::kOrbital), "");
  }
}

TEST(Proposals, RefusesSizesOutOfRange) {
  const auto complains = [](auto edit) {
    Proposals p = with(KernelKind::kGaussian, SecondMove::kOrbital, AcceptanceRule::kOrbital);
    edit(p);
    return problem_with(p).has_value();
  };
  EXPECT_FALSE(complains([](Proposals&) {}));
  for (double bad : {-0.1, 1.0, std::nan("")})
    EXPECT_TRUE(complains([bad](Proposals& p) { p.delayed_rejection.concentration = bad; }));
  for (double bad : {0.0, 1.5, std::nan("")})
    EXPECT_TRUE(complains([bad](Proposals& p) { p.delayed_rejection.local_scale = bad; }));
  for (double bad : {0.0, 0.25, std::nan("")}) {
    EXPECT_TRUE(complains([bad](Proposals& p) { p.kernel.sigma = bad; }));
    EXPECT_TRUE(complains([bad](Proposals& p) {
      p = with(KernelKind::kWrappedCauchy, SecondMove::kNone, AcceptanceRule::kOrbital);
      p.kernel.scale = bad;
    }));
  }
  for (double bad : {0.0, 0.5, std::nan("")})
    EXPECT_TRUE(complains([bad](Proposals& p) {
      p = with(KernelKind::kUniform, SecondMove::kNone, AcceptanceRule::kOrbital);
      p.kernel.half_width = bad;
    }));
  EXPECT_TRUE(complains([](Proposals& p) {
    p.delayed_rejection.angle_law = AngleLaw::kVonMises;
    p.delayed_rejection.concentration = 10001;
  }));
}

}  // namespace
}  // namespace metrofarm::metropolis
