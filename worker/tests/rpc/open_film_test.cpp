#include "rpc/open_film.h"

#include <gtest/gtest.h>

namespace metrofarm::rpc {
namespace {

constexpr film::FilmShape kShape{32, 32, 1};

struct Film {
  std::vector<Batch> delivered;
  size_t given_back = 0;
  OpenFilm film{
      kShape,
      "job",
      3,
      {this, [this](Batch batch) { delivered.push_back(std::move(batch)); },
       [this](const std::vector<farm::v1::LeaseRef>& refs) { given_back += refs.size(); }}};
  void add_segment(const std::string& task) {
    film.add_segment(0.5).mutable_lease()->set_task_id(task);
  }
  void splat(int64_t value) {
    const int64_t v[3] = {0, value, 0};
    film.film().add_full(0, 5, v);
  }
};

TEST(OpenFilm, TakesWhatBelongsTogether) {
  Film f;
  EXPECT_TRUE(f.film.is_for(kShape, "job", 3, &f));
  EXPECT_FALSE(f.film.is_for({32, 32, 2}, "job", 3, &f));
  EXPECT_FALSE(f.film.is_for(kShape, "other", 3, &f));
  EXPECT_FALSE(f.film.is_for(kShape, "job", 4, &f));
  EXPECT_FALSE(f.film.is_for(kShape, "job", 3, nullptr));
}

TEST(OpenFilm, WhatIsInItCountsForWhatItIs) {
  Film f;
  EXPECT_TRUE(f.film.reserve(OpenFilm::kMutations - 1));
  EXPECT_FALSE(f.film.reserve(1)) << "nothing is known of the segments that are to come";
  f.add_segment("a");
  f.splat(int64_t{1} << 50);
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(f.film.reserve(OpenFilm::kMutations / 2));
}

TEST(OpenFilm, IsFullBeforeValuesOverflow) {
  Film f;
  EXPECT_TRUE(f.film.reserve(OpenFilm::kMutations / 2));
  f.add_segment("a");
  f.splat(-(int64_t{3} << 60));  // three quarters of 2^62
  EXPECT_FALSE(f.film.reserve(OpenFilm::kMutations / 2));
  EXPECT_TRUE(f.film.reserve(OpenFilm::kMutations / 8));
}

TEST(OpenFilm, ASegmentOfAnySizeFindsRoomInAnEmptyOne) {
  Film f;
  EXPECT_TRUE(f.film.reserve(10 * OpenFilm::kMutations));
}

TEST(OpenFilm, IsDueByAgeAndByTheLengthOfItsHeader) {
  Film f;
  EXPECT_FALSE(f.film.due(600, 1));
  EXPECT_TRUE(f.film.due(600, 1300)) << "nearer now than after another such lease";
  EXPECT_TRUE(f.film.due(0, 0));
  for (int i = 0; i < 40; ++i) f.film.add_segment(0).set_state(std::string(1 << 20, 'x'));
  EXPECT_TRUE(f.film.due(600, 1));
}

TEST(OpenFilm, IsDeliveredOnceOrGivenBack) {
  Film f;
  f.film.seal(1);
  EXPECT_TRUE(f.delivered.empty()) << "there is nothing in it";
  f.add_segment("a");
  f.add_segment("b");
  f.splat(7);
  f.film.seal(1);
  ASSERT_EQ(f.delivered.size(), 1U);
  EXPECT_EQ(f.delivered[0].header.segments_size(), 2);
  EXPECT_EQ(f.delivered[0].header.round(), 3U);
  EXPECT_EQ(f.delivered[0].header.tile_count(), 1U);
  EXPECT_EQ(f.delivered[0].header.cpu_seconds(), 1.0);
  Film lost;
  lost.add_segment("a");
  lost.film.discard();
  EXPECT_EQ(lost.given_back, 1U);
  lost.film.seal(1);
  EXPECT_TRUE(lost.delivered.empty());
}

}  // namespace
}  // namespace metrofarm::rpc
