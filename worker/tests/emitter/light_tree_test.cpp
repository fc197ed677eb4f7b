// The tree's probabilities are whole numbers, so what it states can be compared with what it does
// exactly: choosing every step once gives every light as often as steps_of() says.
#include "emitter/light_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>

#include "tests/support/lane_tools.h"

namespace metrofarm::emitter {
namespace {

constexpr int32_t kSteps = 1 << 16;

double uniform(test::UniformLanes& random) {
  return lane_value(random.next(), 0);
}

// Small lights in a cube of size 10, facing all ways, of strengths over six orders of magnitude.
std::vector<LightTree::Leaf> scattered(int count, uint64_t seed) {
  test::UniformLanes random(seed);
  std::vector<LightTree::Leaf> leaves;
  for (int i = 0; i < count; ++i) {
    LightTree::Leaf leaf;
    for (int k = 0; k < 3; ++k) {
      leaf.bounds.lower[k] = 10 * uniform(random);
      leaf.bounds.upper[k] = leaf.bounds.lower[k] + (i % 3 == k ? 0.0 : 0.1 * uniform(random));
    }
    leaf.bounds.intensity = std::pow(10, 6 * uniform(random) - 3);
    const auto axis = test::lane_of(random.direction(), 0);
    leaf.bounds.normals = {{axis.x, axis.y, axis.z},
                           i % 7 == 0 ? kAllDirections : 1 - 0.1 * (i % 5)};
    leaf.bounds.cos_spread = i % 11 == 0 ? 0.9 : 0;
    leaf.light = i;
    leaves.push_back(leaf);
  }
  return leaves;
}

LightTree::Leaf small_light(int32_t number, Double3 at, Double3 normal, double intensity = 1) {
  LightTree::Leaf leaf;
  leaf.light = number;
  for (int k = 0; k < 3; ++k) {
    leaf.bounds.lower[k] = at[k] - 0.01;
    leaf.bounds.upper[k] = at[k] + 0.01;
  }
  leaf.bounds.normals = {normal, 1};
  leaf.bounds.intensity = intensity;
  return leaf;
}

Int eight_from(int32_t first) {
  return Int(first) + Int(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
}

std::vector<int32_t> stated_steps(const LightTree& tree, int count, const Receiver& receiver) {
  std::vector<int32_t> steps;
  for (int first = 0; first < count; first += kLanes) {
    const Mask lanes = first_lanes(std::min(kLanes, count - first));
    const Int s = tree.steps_of(eight_from(first), kSteps, receiver, lanes);
    for (int i = 0; i < kLanes && first + i < count; ++i)
      steps.push_back(static_cast<int32_t>(lane_word(as_uint(s), i)));
  }
  return steps;
}

// Chooses every step; expects that a light's are consecutive and that it states their number.
std::vector<int32_t> taken_steps(const LightTree& tree, int count, const Receiver& receiver) {
  std::vector<int32_t> steps(count, 0), stated(count, 0);
  int32_t last = -1;
  for (int32_t first = 0; first < kSteps; first += kLanes) {
    const auto c = tree.choose(eight_from(first), kSteps, receiver, all_lanes());
    for (int i = 0; i < kLanes; ++i) {
      const auto light = static_cast<int32_t>(lane_word(as_uint(c.light), i));
      if (light < 0 || light >= count) {
        ADD_FAILURE() << "no light: " << light;
        return steps;
      }
      if (light != last) {
        EXPECT_EQ(steps[light], 0) << "light " << light << " in two places";
      }
      last = light;
      ++steps[light];
      stated[light] = static_cast<int32_t>(lane_word(as_uint(c.steps), i));
    }
  }
  EXPECT_EQ(stated, steps);
  return steps;
}

std::vector<Receiver> receivers() {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  return {{splat(5, 5, 5), splat(0.F)},       {splat(1, 9, 2), splat(0, -1, 0)},
          {splat(-50, 3, 7), splat(1, 0, 0)}, {splat(1e30F, 0, 0), splat(0, 0, 1)},
          {splat(nan, 1, 1), splat(0.F)},     {splat(1, 1, 1), splat(nan, 0, 1)},
          {splat(infinity, 0, 0), splat(0.F)}};
}

TEST(LightTree, ChoosesEveryLightAsOftenAsItStates) {
  for (int count : {2, 3, 8, 37, 1000}) {
    const LightTree tree(scattered(count, 5), count);
    EXPECT_EQ(tree.leaf_count(), count);
    for (const Receiver& receiver : receivers()) {
      const std::vector<int32_t> taken = taken_steps(tree, count, receiver);
      EXPECT_EQ(stated_steps(tree, count, receiver), taken);
      for (int32_t steps : taken) EXPECT_GE(steps, 1);
    }
  }
}

TEST(LightTree, HasAStepForEachLightWhereThereIsNoneToSpare) {
  const LightTree tree(scattered(kSteps, 6), kSteps);
  for (int32_t steps : stated_steps(tree, 4096, receivers()[0])) EXPECT_EQ(steps, 1);
}

// Lights that no plane parts, in a row, in one place and with strengths that vanish beside others.
TEST(LightTree, HoldsDegenerateLights) {
  for (double spacing : {0.0, 1e-30, 1.0, 1e30}) {
    std::vector<LightTree::Leaf> leaves;
    for (int i = 0; i < 300; ++i) {
      LightTree::Leaf leaf =
          small_light(i, {spacing * i, 0, 0}, {0, 0, 1}, std::pow(10, 2 * i - 300));
      leaf.bounds.upper = leaf.bounds.lower;
      leaves.push_back(leaf);
    }
    const LightTree tree(leaves, leaves.size());
    for (const Receiver& receiver : {Receiver{splat(0.F), splat(0.F)}, receivers()[1]})
      EXPECT_EQ(stated_steps(tree, 300, receiver), taken_steps(tree, 300, receiver));
  }
}

TEST(LightTree, AnswersForLightsThatItDoesNotHold) {
  std::vector<LightTree::Leaf> leaves = scattered(5, 8);
  leaves[4].light = 6;
  const std::vector<int32_t> steps = stated_steps(LightTree(leaves, 8), 8, receivers()[0]);
  EXPECT_EQ(steps[4], 0);
  EXPECT_EQ(steps[5], 0);
  EXPECT_EQ(steps[7], 0);
  EXPECT_EQ(std::accumulate(steps.begin(), steps.end(), 0), kSteps);
}

TEST(LightTree, PrefersTheNearTheStrongAndTheFacing) {
  const Receiver receiver{splat(0.F), splat(0, 0, 1)};
  const auto shares = [&](const LightTree::Leaf& a, const LightTree::Leaf& b) {
    const auto steps = stated_steps(LightTree({a, b}, 2), 2, receiver);
    return double(steps[0]) / steps[1];
  };
  const LightTree::Leaf down = small_light(0, {0, 0, 2}, {0, 0, -1});
  EXPECT_NEAR(shares(down, small_light(1, {0, 0, 6}, {0, 0, -1})), 9, 0.1);
  EXPECT_NEAR(shares(down, small_light(1, {0, 0, 2}, {0, 0, -1}, 0.2)), 5, 0.1);
  EXPECT_GT(shares(down, small_light(1, {0, 0, 2}, {0, 0, 1})), 100);
  EXPECT_GT(shares(down, small_light(1, {0, 0, -2}, {0, 0, 1})), 100);
  // 60 degrees from the normals of both.
  const double x = 2 * std::sin(std::numbers::pi / 3), z = 2 * std::cos(std::numbers::pi / 3);
  EXPECT_NEAR(shares(down, small_light(1, {x, 0, z}, {0, 0, -1})), 4, 0.2);
}

// A lane's choice does not depend on what the others ask.
TEST(LightTree, LanesAreIndependent) {
  const LightTree tree(scattered(200, 9), 200);
  test::UniformLanes random(10);
  for (int i = 0; i < 200; ++i) {
    const Receiver receiver{random.direction() * Float(8.F), random.direction()};
    const Int step = truncate(random.next() * Float(float(kSteps)));
    const auto together = tree.choose(step, kSteps, receiver, all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      const auto alone = tree.choose(step, kSteps, receiver, mask_from_bits(1U << lane));
      EXPECT_EQ(lane_word(as_uint(alone.light), lane), lane_word(as_uint(together.light), lane));
      EXPECT_EQ(lane_word(as_uint(alone.steps), lane), lane_word(as_uint(together.steps), lane));
    }
  }
}

// A cone around two holds every direction of both.
TEST(LightBounds, AConeAroundConesHoldsThem) {
  test::UniformLanes random(11);
  const auto direction = [&]() -> Double3 {
    const auto d = test::lane_of(random.direction(), 0);
    const double length = std::hypot(d.x, d.y, d.z);
    return {d.x / length, d.y / length, d.z / length};
  };
  const auto cosine = [](const Double3& a, const Double3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  };
  int checked = 0;
  for (int i = 0; i < 2000; ++i) {
    const Cone a{direction(), std::cos(3 * uniform(random) * uniform(random))};
    const Cone b{direction(), std::cos(3 * uniform(random) * uniform(random))};
    const Cone both = cone_around(a, b);
    EXPECT_NEAR(cosine(both.axis, both.axis), 1, 1e-9);
    for (int k = 0; k < 50; ++k) {
      const Double3 d = direction();
      if (cosine(d, a.axis) < a.cosine && cosine(d, b.axis) < b.cosine) continue;
      ++checked;
      EXPECT_GE(cosine(d, both.axis), both.cosine - 1e-7);
    }
  }
  EXPECT_GT(checked, 10000);
  const Cone opposite = cone_around(Cone{{0, 0, 1}, 0.9}, Cone{{0, 0, -1}, 0.9});
  EXPECT_EQ(opposite.cosine, kAllDirections);
}

}  // namespace
}  // namespace metrofarm::emitter
