// Materials made of other materials, in both generations of the format.
#include "material_support.h"

namespace metrofarm::scene_file::test {
namespace {

const std::string kCheckerboard = "<texture type=\"checkerboard\" name=\"";

std::string checkerboard(const std::string& name) {
  return kCheckerboard + name + "\"/>";
}

const std::string kDiffuse = "<bsdf type=\"diffuse\"/>";
const std::string kMetal = "<bsdf type=\"conductor\"/>";
const std::string kGlass = "<bsdf type=\"dielectric\"/>";

template <class Model>
bool is(const scene::SceneDescription& scene, scene::Index bsdf) {
  return std::holds_alternative<Model>(scene.bsdfs.at(static_cast<size_t>(bsdf)).model);
}

TEST(TwoSided, HasOneOrTwoReflectiveSides) {
  const auto scene = load_valid(bsdf("twosided", kDiffuse + kMetal) + bsdf("twosided", kDiffuse));
  ASSERT_EQ(scene.bsdfs.size(), 6U);  // and the sphere's default
  const auto& both = std::get<scene::TwoSided>(scene.bsdfs[2].model);
  EXPECT_TRUE(is<scene::Diffuse>(scene, both.front));
  EXPECT_TRUE(is<scene::Conductor>(scene, both.back));
  const auto& same = std::get<scene::TwoSided>(scene.bsdfs[4].model);
  EXPECT_EQ(same.front, same.back);
  EXPECT_EQ(
      error_of(bsdf("twosided", "")),
      "scene.xml:2: a twosided bsdf needs one or two nested bsdfs, for the front and the back");
}

TEST(TwoSided, RefusesMaterialsThatTransmit) {
  EXPECT_EQ(
      error_of(bsdf("twosided", kGlass)),
      "scene.xml:2: a bsdf inside twosided must only reflect: bsdf \"dielectric\" already has "
      "two sides, use it without twosided");
  const std::string opaque_blend =
      bsdf("blendbsdf", parameter("float", "weight", "0.5") + kDiffuse + kMetal);
  const std::string blend =
      bsdf("blendbsdf", parameter("float", "weight", "0.5") + kDiffuse + kGlass);
  EXPECT_EQ(error_of(bsdf("twosided", opaque_blend)), "");
  for (const std::string& inside :
       {blend, bsdf("mask", kDiffuse), std::string("<bsdf type=\"thindielectric\"/>"),
        std::string("<bsdf type=\"roughdielectric\"/>"), std::string("<bsdf type=\"null\"/>"),
        std::string("<bsdf type=\"difftrans\"/>"), bsdf("bumpmap", checkerboard("map") + kGlass),
        bsdf("principled", parameter("float", "spec_trans", "0.5"))}) {
    EXPECT_NE(error_of(bsdf("twosided", inside)).find("must only reflect"), std::string::npos)
        << inside;
  }
}

TEST(Mask, ReadsOpacity) {
  const auto plain = load_valid(bsdf("mask", kMetal));
  const auto mask = first_model<scene::Mask>(plain);
  EXPECT_EQ(mask.opacity.value, 0.5F);
  EXPECT_TRUE(is<scene::Conductor>(plain, mask.nested));
  // The mean of a colour counts.
  EXPECT_FLOAT_EQ(
      load_bsdf<scene::Mask>("mask", parameter("rgb", "opacity", "0.1, 0.2, 0.6") + kMetal)
          .opacity.value,
      0.3F);
  EXPECT_EQ(load_bsdf<scene::Mask>("mask", checkerboard("opacity") + kMetal).opacity.texture, 0);
  EXPECT_EQ(error_of(bsdf("mask", "")), "scene.xml:2: bsdf \"mask\" needs a nested bsdf");
  EXPECT_EQ(error_of(bsdf("mask", parameter("float", "opacity", "2") + kMetal)),
            "scene.xml:3: parameter \"opacity\" of bsdf \"mask\" must be between 0 and 1, not 2");
}

TEST(Blend, ReadsWeightAndOrder) {
  const auto scene =
      load_valid(bsdf("blendbsdf", parameter("float", "weight", "0.3") + kDiffuse + kMetal));
  const auto blend = first_model<scene::Blend>(scene);
  EXPECT_EQ(blend.weight.value, 0.3F);
  EXPECT_TRUE(is<scene::Diffuse>(scene, blend.first));
  EXPECT_TRUE(is<scene::Conductor>(scene, blend.second));
  EXPECT_EQ(load_bsdf<scene::Blend>("blendbsdf", checkerboard("weight") + kDiffuse + kMetal)
                .weight.texture,
            0);
  EXPECT_EQ(error_of(bsdf("blendbsdf", parameter("float", "weight", "0.3") + kDiffuse)),
            "scene.xml:2: bsdf \"blendbsdf\" needs two nested bsdfs, not 1");
  EXPECT_NE(error_of(bsdf("blendbsdf", kDiffuse + kMetal)).find("needs a weight"),
            std::string::npos);
}

// The share of each material of a chain of blends.
void add_shares(const scene::SceneDescription& scene, scene::Index index, double share,
                std::vector<std::pair<size_t, double>>& shares) {
  const auto& model = scene.bsdfs.at(static_cast<size_t>(index)).model;
  const auto* blend = std::get_if<scene::Blend>(&model);
  if (!blend) return shares.emplace_back(model.index(), share), void();
  add_shares(scene, blend->first, share * (1 - blend->weight.value), shares);
  add_shares(scene, blend->second, share * blend->weight.value, shares);
}

std::vector<std::pair<size_t, double>> shares_of(const std::string& weights) {
  const auto scene = load_legacy(
      "<shape type=\"sphere\">" +
      bsdf("mixturebsdf", parameter("string", "weights", weights) + kDiffuse + kMetal + kGlass) +
      "</shape>");
  std::vector<std::pair<size_t, double>> shares;
  add_shares(scene, scene.shapes.at(0).bsdf, 1, shares);
  return shares;
}

TEST(Mixture, IsAChainOfBlends) {
  const auto full = shares_of("0.2, 0.3, 0.5");
  ASSERT_EQ(full.size(), 3U);
  const double expected[] = {0.2, 0.3, 0.5};
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(full[i].second, expected[i], 1e-6);
  EXPECT_NE(full[0].first, full[1].first);
  EXPECT_NE(full[1].first, full[2].first);

  const auto absorbing = shares_of("0.2, 0.3, 0.1");
  ASSERT_EQ(absorbing.size(), 4U);
  EXPECT_NEAR(absorbing[0].second, 0.2, 1e-6);
  EXPECT_NEAR(absorbing[3].second, 0.4, 1e-6);

  const auto too_much = shares_of("1, 2, 1");
  EXPECT_NEAR(too_much[1].second, 0.5, 1e-6);
  EXPECT_EQ(
      legacy_error_of(bsdf("mixturebsdf", parameter("string", "weights", "1") + kDiffuse + kMetal)),
      "scene.xml:3: bsdf \"mixturebsdf\" needs as many weights of 0 or more as nested bsdfs (2), "
      "as in <string name=\"weights\" value=\"0.3, 0.7\"/>");
}

TEST(BumpMap, ReadsTextureAndScale) {
  const auto scene =
      load_valid(bsdf("bumpmap", checkerboard("any") + parameter("float", "scale", "3") + kMetal));
  const auto bump = first_model<scene::BumpMap>(scene);
  EXPECT_EQ(bump.displacement.texture, 0);
  EXPECT_EQ(bump.displacement.value, 3);
  EXPECT_TRUE(is<scene::Conductor>(scene, bump.nested));
  const auto old = load_legacy_bsdf<scene::BumpMap>(
      "bumpmap", "<texture type=\"scale\">" + parameter("float", "scale", "0.25") +
                     "<texture type=\"checkerboard\"/></texture>" + kMetal);
  EXPECT_EQ(old.displacement.texture, 0);
  EXPECT_EQ(old.displacement.value, 0.25F);
  EXPECT_EQ(error_of(bsdf("bumpmap", kMetal)),
            "scene.xml:2: bsdf \"bumpmap\" needs a nested texture of displacements");
  EXPECT_EQ(error_of(bsdf("bumpmap", checkerboard("a") + checkerboard("b") + kMetal)),
            "scene.xml:3: bsdf \"bumpmap\" takes only one texture");
}

TEST(NormalMap, ReadsTexture) {
  const auto map = load_bsdf<scene::NormalMap>("normalmap", checkerboard("normalmap") + kMetal);
  EXPECT_EQ(map.normals, 0);
  const auto old =
      load_legacy_bsdf<scene::NormalMap>("normalmap", "<texture type=\"checkerboard\"/>" + kMetal);
  EXPECT_EQ(old.normals, 0);
  EXPECT_EQ(error_of(bsdf("normalmap", kMetal)),
            "scene.xml:2: bsdf \"normalmap\" needs a texture: <texture name=\"normalmap\" "
            "type=\"bitmap\">");
}

TEST(NestedMaterials, AreSharedAndLimited) {
  const auto scene =
      load_valid("<bsdf type=\"diffuse\" id=\"a\"/>" + bsdf("twosided", "<ref id=\"a\"/>") +
                 bsdf("mask", "<ref id=\"a\"/>"));
  EXPECT_EQ(scene.bsdfs.size(), 4U);
  EXPECT_EQ(error_of("<bsdf type=\"mask\" id=\"a\"><ref id=\"a\"/></bsdf>"),
            "scene.xml:2: bsdf \"mask\" contains itself");
  std::string deep = kDiffuse;
  for (int i = 0; i < 20; ++i) deep = "<bsdf type=\"mask\">" + deep + "</bsdf>";
  EXPECT_EQ(error_of(deep), "scene.xml:2: bsdfs are nested more than 16 deep");
}

}  // namespace
}  // namespace metrofarm::scene_file::test
