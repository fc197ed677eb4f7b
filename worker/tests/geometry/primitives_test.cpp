#include "geometry/primitives.h"

#include <gtest/gtest.h>

#include <numbers>

#include "tests/geometry/world.h"

namespace metrofarm::geometry {
namespace {

TEST(Primitives, AreasAreExact) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(scene::Sphere{{1, 2, 3}, 2}, grey)
      .shape(test::quad({0, 0, 0}, {3, 0, 0}, {1, 2, 0}), grey)
      .shape(scene::Disk{{2, 0, 0, 5, 0, 3, 0, 5, 0, 0, 1, 5, 0, 0, 0, 1}}, grey)
      .shape(scene::Cylinder{{0, 0, 3, 5, 2, 0, 0, 5, 0, 2, 0, 5, 0, 0, 0, 1}}, grey);
  const World world(b);
  EXPECT_NEAR(area_of(world.primitives, 0), 3, 1e-6);
  EXPECT_NEAR(area_of(world.primitives, 2), 16 * std::numbers::pi, 1e-5);
  EXPECT_NEAR(area_of(world.primitives, 3), 6 * std::numbers::pi, 1e-5);
  EXPECT_NEAR(area_of(world.primitives, 4), 12 * std::numbers::pi, 1e-5);
  EXPECT_EQ(world.primitives.shape_of, (std::vector<int32_t>{1, 1, 0, 2, 3}));
}

scene::TriangleMesh with_attribute(scene::MeshAttribute attribute) {
  scene::TriangleMesh mesh = smooth_triangle();
  mesh.attributes.push_back(std::move(attribute));
  return mesh;
}

class AttributeTest : public testing::Test {
 protected:
  void look_up(const char* name) {
    b_.description().textures.push_back({scene::AttributeTexture{name}, "", {}});
  }
  Primitives build() {
    scene_ = b_.take();
    return build_primitives(scene_);
  }
  // The table without the spare floats.
  static std::vector<float> values(const AttributeTable& table) {
    return {table.values.begin(), table.values.end() - kSpareFloats};
  }

  test::SceneBuilder b_;
  scene::Index grey_ = b_.diffuse(0.5F);
  scene::SceneDescription scene_;
};

TEST_F(AttributeTest, TablesAreDenseAndZeroElsewhere) {
  look_up("vertex_color");
  look_up("face_weight");
  b_.shape(smooth_triangle(), grey_)
      .shape(with_attribute({"vertex_color", 3, false, {1, 2, 3, 4, 5, 6, 7, 8, 9}}), grey_)
      .shape(with_attribute({"face_weight", 1, true, {0.5F}}), grey_);
  const Primitives p = build();
  ASSERT_EQ(p.attributes.size(), 2U);
  EXPECT_EQ(p.attributes[0].name, "vertex_color");
  EXPECT_EQ(p.attributes[0].channels, 3);
  EXPECT_FALSE(p.attributes[0].per_face);
  EXPECT_EQ(values(p.attributes[0]), (std::vector<float>{0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5,
                                                         6, 7, 8, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_TRUE(p.attributes[1].per_face);
  EXPECT_EQ(values(p.attributes[1]), (std::vector<float>{0, 0, 0.5F}));
}

TEST_F(AttributeTest, OneChannelBecomesThreeWhereMeshesDisagree) {
  look_up("vertex_a");
  b_.shape(with_attribute({"vertex_a", 1, false, {1, 2, 3}}), grey_)
      .shape(with_attribute({"vertex_a", 3, false, {1, 2, 3, 4, 5, 6, 7, 8, 9}}), grey_)
      .shape(with_attribute({"vertex_a", 1, false, {7, 8, 9}}), grey_);
  const Primitives p = build();
  ASSERT_EQ(p.attributes.size(), 1U);
  EXPECT_EQ(values(p.attributes[0]), (std::vector<float>{1, 1, 1, 2, 2, 2, 3, 3, 3, 1, 2, 3, 4, 5,
                                                         6, 7, 8, 9, 7, 7, 7, 8, 8, 8, 9, 9, 9}));
}

TEST_F(AttributeTest, WhatNoTextureNamesTakesNoMemory) {
  b_.shape(with_attribute({"vertex_color", 1, false, {1, 2, 3}}), grey_);
  EXPECT_TRUE(build().attributes.empty());
}

// The attribute follows its mesh where groups change the order.
TEST_F(AttributeTest, GroupsKeepTheirValues) {
  look_up("face_a");
  b_.shape(with_attribute({"face_a", 1, true, {5}}), grey_);
  b_.description().shapes.back().group = 0;
  b_.shape(with_attribute({"face_a", 1, true, {6}}), grey_);
  const Primitives p = build();
  EXPECT_EQ(values(p.attributes[0]), (std::vector<float>{6, 5}));
  EXPECT_EQ(p.shape_of, (std::vector<int32_t>{1, 0}));
}

}  // namespace
}  // namespace metrofarm::geometry
