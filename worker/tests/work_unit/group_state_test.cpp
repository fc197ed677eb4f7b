#include "work_unit/group_state.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <random>

namespace metrofarm::work_unit {
namespace {

GroupState random_state(uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<float> uniform(0.01F, 10);
  GroupState state;
  std::array<uint8_t, kGroupSize> members;
  std::iota(members.begin(), members.end(), uint8_t{0});
  std::shuffle(members.begin(), members.end(), random);
  const uint64_t iteration = random();
  for (PackState& pack : state) {
    pack.chains.iteration = iteration;
    pack.chains.serial = random();
    for (int lane = 0; lane < kLanes; ++lane) {
      pack.members[lane] = members[(&pack - state.data()) * kLanes + lane];
      pack.chains.f[lane] = uniform(random);
      pack.chains.sums[lane] = {random(), double(uniform(random)), double(uniform(random))};
      pack.chains.stays[lane] = static_cast<int32_t>(random() >> 33);
      pack.payload[lane].light_vertices = static_cast<int32_t>(random() % 33);
      for (uint64_t i = 1 + random() % 5; i > 0; --i) {
        pack.payload[lane].splats.push_back({uniform(random),
                                             uniform(random),
                                             {uniform(random), uniform(random), uniform(random)}});
      }
      for (uint64_t i = random() % 20; i > 0; --i)
        pack.pairs[lane].push_back({static_cast<int>(random() % primary_space::kSlotCount),
                                    static_cast<uint32_t>(random()),
                                    static_cast<uint32_t>(random())});
    }
  }
  return state;
}

TEST(GroupState, SurvivesTheRoundTrip) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const GroupState state = random_state(seed);
    const std::string bytes = serialize(state);
    const auto parsed = parse_group_state(bytes);
    ASSERT_TRUE(parsed.ok());
    EXPECT_EQ(serialize(parsed.value()), bytes);
    EXPECT_EQ(parsed.value()[3].chains.iteration, state[3].chains.iteration);
    EXPECT_EQ(parsed.value()[7].payload[5].splats.back().rgb[2],
              state[7].payload[5].splats.back().rgb[2]);
    EXPECT_EQ(parsed.value()[7].payload[5].light_vertices, state[7].payload[5].light_vertices);
    EXPECT_EQ(parsed.value()[2].chains.stays, state[2].chains.stays);
    ASSERT_EQ(parsed.value()[1].pairs[2].size(), state[1].pairs[2].size());
  }
}

TEST(GroupState, EveryTruncationAndEverySurplusIsRefused) {
  const std::string bytes = serialize(random_state(1));
  for (size_t length = 0; length < bytes.size(); ++length)
    EXPECT_FALSE(parse_group_state(std::string_view(bytes).substr(0, length)).ok());
  EXPECT_FALSE(parse_group_state(bytes + '\0').ok());
  EXPECT_FALSE(parse_group_state("").ok());
}

TEST(GroupState, RandomDamageIsRefusedOrHarmless) {
  const std::string bytes = serialize(random_state(2));
  std::mt19937_64 random(3);
  int refused = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string damaged = bytes;
    for (uint64_t flips = 1 + random() % 4; flips > 0; --flips)
      damaged[random() % damaged.size()] ^= static_cast<char>(1U << random() % 8);
    if (random() % 4 == 0) damaged.resize(random() % damaged.size());
    const auto parsed = parse_group_state(damaged);
    refused += parsed.ok() ? 0 : 1;
    if (!parsed.ok()) continue;
    for (const PackState& pack : parsed.value()) {
      for (int lane = 0; lane < kLanes; ++lane) {
        EXPECT_GT(pack.chains.f[lane], 0);
        for (const auto& pair : pack.pairs[lane]) EXPECT_LT(pair.slot, primary_space::kSlotCount);
      }
    }
  }
  EXPECT_GT(refused, 4000);
}

TEST(GroupState, StatesThatNoChainHasAreRefused) {
  const GroupState good = random_state(4);
  for (float f : {0.F, -1.F, std::numeric_limits<float>::infinity(),
                  std::numeric_limits<float>::quiet_NaN()}) {
    GroupState bad = good;
    bad[2].chains.f[3] = f;
    EXPECT_FALSE(parse_group_state(serialize(bad)).ok()) << "f = " << f;
    if (f >= -1) continue;
    bad = good;
    bad[2].payload[3].splats[0].x = f;
    EXPECT_FALSE(parse_group_state(serialize(bad)).ok()) << "x = " << f;
  }
  for (float v :
       {-1.F, std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
    GroupState bad = good;
    bad[2].payload[3].splats.back().rgb[1] = v;
    EXPECT_FALSE(parse_group_state(serialize(bad)).ok()) << "radiance " << v;
  }
}

TEST(GroupState, EveryChainIsInOnePackAndAllAreAsFar) {
  GroupState bad = random_state(6);
  bad[1].members[0] = bad[2].members[0];
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
  bad = random_state(6);
  bad[1].members[0] = kGroupSize;
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
  bad = random_state(6);
  ++bad[4].chains.iteration;
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
}

int light_pairs(const std::vector<primary_space::StoredPair>& pairs) {
  return static_cast<int>(std::count_if(pairs.begin(), pairs.end(), [](const auto& p) {
    return primary_space::stream_of(p.slot) == primary_space::Stream::kLight;
  }));
}

// Dealing moves whole chains, sorts them, and comes to the same whatever the packs were before.
TEST(Deal, SortsChainsByTheirSubpaths) {
  GroupState state = random_state(7);
  std::vector<std::pair<float, double>> before(kGroupSize);
  for (const PackState& pack : state)
    for (int lane = 0; lane < kLanes; ++lane)
      before[pack.members[lane]] = {pack.chains.f[lane], pack.chains.sums[lane].sum};
  GroupState other = state;
  std::swap(other[0].members, other[5].members);
  std::swap(other[0].payload, other[5].payload);
  std::swap(other[0].pairs, other[5].pairs);
  std::swap(other[0].chains.f, other[5].chains.f);
  std::swap(other[0].chains.sums, other[5].chains.sums);
  deal(state);
  deal(other);
  int previous = 0, moved = 0;
  for (int i = 0; i < kGroupSize; ++i) {
    const PackState& pack = state[i / kLanes];
    const int lane = i % kLanes, member = pack.members[lane];
    EXPECT_EQ(member, other[i / kLanes].members[lane]);
    EXPECT_EQ(pack.chains.f[lane], before[member].first);
    EXPECT_EQ(pack.chains.sums[lane].sum, before[member].second);
    const int light = light_pairs(pack.pairs[lane]);
    EXPECT_GE(light, previous);
    previous = light;
    moved += member != i;
  }
  EXPECT_GT(moved, kGroupSize / 2);
  const auto sums = large_step_sums(state);
  for (int member = 0; member < kGroupSize; ++member)
    EXPECT_EQ(sums[member].sum, before[member].second);
}

TEST(GroupState, NegativeCountsAreRefused) {
  GroupState bad = random_state(6);
  bad[1].chains.stays[2] = -1;
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
  bad = random_state(6);
  bad[1].payload[2].light_vertices = -1;
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
}

TEST(GroupState, SlotsBeyondTheSpaceAreRefused) {
  GroupState bad = random_state(5);
  bad[0].pairs[0] = {{primary_space::kSlotCount, 1, 2}};
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
  bad[0].pairs[0] = {{-1, 1, 2}};
  EXPECT_FALSE(parse_group_state(serialize(bad)).ok());
}

}  // namespace
}  // namespace metrofarm::work_unit
