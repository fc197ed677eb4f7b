// Sums and digests don't depend on order or threads.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "base/parallel.h"
#include "film/film.h"
#include "math/rng.h"
#include "tests/support/film_values.h"

namespace metrofarm::film {
namespace {

struct Splat {
  Destination to;
  float x, y;
  float rgb[3];
  uint64_t noise;
};

constexpr FilmShape kShape{50, 37, 2};

std::vector<Splat> random_splats(int count) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  std::vector<Splat> splats(count);
  for (Splat& s : splats) {
    s.to = {static_cast<int>(random() % 2), static_cast<int>(random() % 2),
            static_cast<int>(random() % 16)};
    s.x = uniform(random) * 54 - 2;
    s.y = uniform(random) * 41 - 2;
    for (float& c : s.rgb) c = uniform(random) * 10 - 2;
    s.noise = random();
  }
  return splats;
}

Filter gaussian() {
  return Filter(scene::Film{});
}

// Splats everything on `threads` threads and returns the sum of their digests.
uint64_t splat_all(Film& film, const std::vector<Splat>& splats, int threads) {
  const Filter filter = gaussian();
  constexpr size_t kPart = 100;
  std::vector<uint64_t> digests(splats.size() / kPart);
  parallel_for(digests.size(), threads, [&](size_t part, int) {
    Splatter splatter(film, filter);
    for (size_t i = part * kPart; i < (part + 1) * kPart; ++i)
      splatter.splat(splats[i].to, splats[i].x, splats[i].y, splats[i].rgb, splats[i].noise);
    digests[part] = splatter.digest();
  });
  uint64_t sum = 0;
  for (uint64_t d : digests) sum += d;
  return sum;
}

TEST(Digest, EqualsTheDigestOfThePlanes) {
  Film film(kShape);
  const uint64_t digest = splat_all(film, random_splats(5000), 1);
  EXPECT_EQ(digest, test::digest_from_planes(film));
}

TEST(Digest, NeitherOrderNorThreadsChangeASum) {
  std::vector<Splat> splats = random_splats(20000);
  Film reference(kShape);
  const uint64_t digest = splat_all(reference, splats, 1);
  std::shuffle(splats.begin(), splats.end(), std::mt19937_64(9));
  for (int threads : {1, 4}) {
    Film film(kShape);
    EXPECT_EQ(splat_all(film, splats, threads), digest);
    EXPECT_EQ(test::all_values(film), test::all_values(reference));
  }
}

TEST(Digest, TellsChangesApart) {
  std::vector<Splat> splats = random_splats(100);
  Film film(kShape);
  const uint64_t digest = splat_all(film, splats, 1);
  splats[50].x = 20.5F;
  splats[50].y = 20.5F;
  std::swap(splats[50].rgb[0], splats[50].rgb[2]);
  Film other(kShape);
  const uint64_t changed = splat_all(other, splats, 1);
  EXPECT_NE(changed, digest);
  EXPECT_EQ(changed, test::digest_from_planes(other));
}

TEST(Digest, SumsWrapModulo64Bits) {
  Film film({1, 1, 1});
  const int64_t large[3] = {INT64_MAX, -5, 1};
  uint64_t digest = film.add_full(0, 0, large);
  digest += film.add_full(0, 0, large);
  EXPECT_EQ(test::full_plane(film, 0)[0], -2);
  EXPECT_EQ(digest, test::digest_from_planes(film));
}

TEST(Splatter, ResetForgetsTheDigestOnly) {
  Film film(kShape);
  const Filter filter = gaussian();
  Splatter splatter(film, filter);
  const float rgb[3] = {1, 1, 1};
  splatter.splat({}, 5, 5, rgb, 1);
  splatter.reset_digest();
  EXPECT_EQ(splatter.digest(), 0U);
  EXPECT_NE(test::digest_from_planes(film), 0U);
}

}  // namespace
}  // namespace metrofarm::film
