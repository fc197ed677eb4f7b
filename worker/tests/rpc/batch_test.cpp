#include "rpc/batch.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <tuple>

#include "math/rng.h"
#include "tests/support/film_values.h"
#include "tests/support/tiles.h"

namespace metrofarm::rpc {
namespace {

// A film with splats of two segments, announced with their digests.
farm::v1::BatchHeader splat_some(film::Film& film, float width, float height) {
  const film::Filter filter{scene::Film{}};
  farm::v1::BatchHeader header;
  std::mt19937_64 random(4);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (uint32_t segment = 0; segment < 2; ++segment) {
    film::Splatter splatter(film, filter);
    for (int i = 0; i < 3000; ++i) {
      const float rgb[3] = {uniform(random), uniform(random), uniform(random)};
      splatter.splat({i % 2, static_cast<int>(segment), 3}, uniform(random) * width,
                     uniform(random) * height, rgb, random());
    }
    auto* result = header.add_segments();
    result->set_segment(segment);
    result->set_digest(splatter.digest());
  }
  return header;
}

// Adds the decoded tiles of a batch to an empty film and returns the film's digest.
uint64_t digest_of_tiles(const Batch& batch, const film::FilmShape& shape) {
  film::Film film(shape);
  uint64_t digest = 0;
  for (const auto& message : batch.tiles)
    for (const farm::v1::Tile& tile : message.tiles()) digest += test::add_tile(tile, film);
  return digest;
}

TEST(Batch, TilesAddUpToTheDigest) {
  const film::FilmShape shape{100, 70, 2};
  film::Film film(shape);
  const farm::v1::BatchHeader header = splat_some(film, 100, 70);
  for (int threads : {1, 3}) {
    const Batch batch = seal(header, film, threads);
    EXPECT_EQ(batch.header.digest(), test::digest_from_planes(film));
    EXPECT_EQ(digest_of_tiles(batch, shape), batch.header.digest());
  }
}

TEST(Batch, EmptyTilesAreNotSentAndNoneTwice) {
  film::Film film({300, 200, 2});
  const Batch batch = seal(splat_some(film, 20, 20), film, 2);
  std::set<std::tuple<bool, uint32_t, uint32_t, uint32_t>> seen;
  for (const auto& message : batch.tiles) {
    for (const farm::v1::Tile& tile : message.tiles()) {
      EXPECT_TRUE(seen.insert({tile.low(), tile.plane(), tile.x(), tile.y()}).second);
      EXPECT_TRUE(tile.x() == 0 && tile.y() == 0);
    }
  }
  EXPECT_EQ(seen.size(), batch.header.tile_count());
  EXPECT_EQ(seen.size(), 6U) << "four full planes, two low planes of group 3";
}

TEST(Batch, MessagesStayUnderAMebibyte) {
  film::Film film({700, 500, 2});
  std::mt19937_64 random(9);
  for (int plane = 0; plane < 4; ++plane) {
    for (size_t pixel = 0; pixel < film.shape().pixels(); ++pixel) {
      const int64_t noise[3] = {int64_t(random()), int64_t(random()), int64_t(random())};
      film.add_full(plane, pixel, noise);
    }
  }
  const Batch batch = seal({}, film, 2);
  EXPECT_GT(batch.tiles.size(), 10U);
  for (const auto& message : batch.tiles) EXPECT_LT(message.ByteSizeLong(), size_t{1} << 20);
}

TEST(Batch, AnEmptyFilmHasNoTiles) {
  const Batch batch = seal({}, film::Film({64, 64, 1}), 1);
  EXPECT_EQ(batch.header.tile_count(), 0U);
  EXPECT_TRUE(batch.tiles.empty());
  EXPECT_EQ(batch.header.digest(), 0U);
}

}  // namespace
}  // namespace metrofarm::rpc
