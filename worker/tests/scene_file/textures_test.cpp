// Textures and their images, in both generations of the format.
#include "material_support.h"

namespace metrofarm::scene_file::test {
namespace {

using scene::Rgb;
using scene::UvMatrix;

// An uncompressed BMP file of 2 x 1 pixels: red and half of blue.
std::string two_pixels() {
  std::string file("BM\x3e\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\x02\0\0\0\x01\0\0\0\x01\0\x18\0", 30);
  file += std::string("\0\0\0\0\x08\0\0\0", 8) + std::string(16, '\0');
  return file + std::string("\0\0\xff\x80\0\0\0\0", 8);  // blue, green, red; padded to 8 bytes
}

class Textures : public testing::Test {
 protected:
  Textures() {
    directory.write("a.bmp", two_pixels());
    directory.write("b.bmp", two_pixels());
  }

  static std::string bitmap(const std::string& name, const std::string& content,
                            const std::string& file = "a.bmp") {
    return "<texture type=\"bitmap\" name=\"" + name + "\">\n" +
           parameter("string", "filename", file) + content + "</texture>";
  }

  scene::SceneDescription load(const std::string& content, std::string_view version = "3.0.0") {
    auto scene = load_text(directory, scene_around(content, version));
    EXPECT_TRUE(scene) << scene.error().to_string();
    return scene ? scene.value() : scene::SceneDescription{};
  }

  scene::BitmapTexture load_bitmap(const std::string& content, std::string_view version = "3.0.0") {
    const auto scene = load(bsdf("diffuse", bitmap("reflectance", content)), version);
    return scene.textures.empty() ? scene::BitmapTexture{}
                                  : std::get<scene::BitmapTexture>(scene.textures[0].model);
  }

  std::string error(const std::string& content) {
    return error_of(directory, bsdf("diffuse", bitmap("reflectance", content)));
  }

  Directory directory;
};

TEST_F(Textures, BitmapDefaults) {
  const auto scene = load(bsdf("diffuse", bitmap("reflectance", "")));
  ASSERT_EQ(scene.images.size(), 1U);
  const scene::Image& image = scene.images[0];
  EXPECT_EQ(image.width, 2);
  EXPECT_EQ(image.height, 1);
  EXPECT_TRUE(image.srgb);
  const auto* bytes = std::get_if<std::vector<uint8_t>>(&image.pixels);
  ASSERT_NE(bytes, nullptr);
  EXPECT_EQ(*bytes, (std::vector<uint8_t>{255, 0, 0, 0, 0, 128}));
  ASSERT_EQ(scene.textures.size(), 1U);
  const auto& texture = std::get<scene::BitmapTexture>(scene.textures[0].model);
  EXPECT_EQ(texture.image, 0);
  EXPECT_EQ(texture.filter, scene::TextureFilter::kBilinear);
  EXPECT_EQ(texture.wrap, scene::TextureWrap::kRepeat);
  // Mitsuba's v runs down from the top of the image, ours up from its bottom.
  EXPECT_EQ(texture.to_uv, (UvMatrix{1, 0, 0, 0, -1, 1}));
}

TEST_F(Textures, BitmapParameters) {
  const auto texture = load_bitmap(
      parameter("string", "filter_type", "nearest") + parameter("string", "wrap_mode", "mirror") +
      parameter("boolean", "accel", "false") + parameter("string", "format", "fp16") +
      "<transform name=\"to_uv\"><scale x=\"2\" y=\"3\"/>"
      "<translate x=\"0.5\" y=\"0.25\"/></transform>");
  EXPECT_EQ(texture.filter, scene::TextureFilter::kNearest);
  EXPECT_EQ(texture.wrap, scene::TextureWrap::kMirror);
  // Mitsuba looks up (2 u + 0.5, 3 v + 0.25).
  EXPECT_EQ(texture.to_uv, (UvMatrix{2, 0, 0.5F, 0, -3, 0.75F}));
}

TEST_F(Textures, OldBitmapParameters) {
  const auto texture = load_bitmap(
      parameter("string", "filterType", "trilinear") + parameter("string", "wrapMode", "clamp") +
          parameter("float", "uscale", "2") + parameter("float", "vscale", "3") +
          parameter("float", "uoffset", "0.5") + parameter("float", "voffset", "0.25") +
          parameter("float", "maxAnisotropy", "8") + parameter("boolean", "cache", "true"),
      "0.6.0");
  EXPECT_EQ(texture.filter, scene::TextureFilter::kBilinear);
  EXPECT_EQ(texture.wrap, scene::TextureWrap::kClamp);
  EXPECT_EQ(texture.to_uv, (UvMatrix{2, 0, 0.5F, 0, -3, 0.75F}));
  const auto both = load_bitmap(parameter("float", "uvscale", "4"), "0.5.0");
  EXPECT_EQ(both.to_uv, (UvMatrix{4, 0, 0, 0, -4, 1}));
  const auto wrapped = load_bitmap(
      parameter("string", "wrapModeU", "mirror") + parameter("string", "wrapModeV", "mirror"),
      "0.6.0");
  EXPECT_EQ(wrapped.wrap, scene::TextureWrap::kMirror);
}

TEST_F(Textures, ImagesAreDecodedAsAsked) {
  const auto image = [&](const std::string& content, std::string_view version) {
    const auto scene = load(bsdf("diffuse", bitmap("reflectance", content)), version);
    return scene.images.empty() ? scene::Image{} : scene.images[0];
  };
  EXPECT_FALSE(image(parameter("boolean", "raw", "true"), "3.0.0").srgb);
  EXPECT_TRUE(image(parameter("float", "gamma", "-1"), "0.6.0").srgb);
  const scene::Image linear = image(parameter("float", "gamma", "1"), "0.6.0");
  EXPECT_FALSE(linear.srgb);
  EXPECT_TRUE(std::holds_alternative<std::vector<uint8_t>>(linear.pixels));
  const scene::Image power = image(parameter("float", "gamma", "2"), "0.6.0");
  EXPECT_FALSE(power.srgb);
  const auto* values = std::get_if<std::vector<float>>(&power.pixels);
  ASSERT_NE(values, nullptr);
  EXPECT_FLOAT_EQ(values->at(0), 1);
  EXPECT_FLOAT_EQ(values->at(5), 0.2519646F);  // (128 / 255)^2
  const scene::Image blue = image(parameter("string", "channel", "b"), "0.6.0");
  EXPECT_EQ(blue.channels, 1);
  EXPECT_EQ(std::get<std::vector<uint8_t>>(blue.pixels), (std::vector<uint8_t>{0, 128}));
}

TEST_F(Textures, FilesAreLoadedOncePerDecoding) {
  const std::string raw = parameter("boolean", "raw", "true");
  const auto scene = load(bsdf("diffuse", bitmap("reflectance", "")) +
                          bsdf("diffuse", bitmap("reflectance", "", "./a.bmp")) +
                          bsdf("diffuse", bitmap("reflectance", raw)) +
                          bsdf("diffuse", bitmap("reflectance", "", "b.bmp")));
  EXPECT_EQ(scene.textures.size(), 4U);
  EXPECT_EQ(scene.images.size(), 3U);
}

TEST_F(Textures, AreSharedByReference) {
  const auto scene =
      load("<texture type=\"bitmap\" id=\"t\">" + parameter("string", "filename", "a.bmp") +
           "</texture>" + bsdf("diffuse", "<ref name=\"reflectance\" id=\"t\"/>") +
           bsdf("plastic", "<ref name=\"diffuse_reflectance\" id=\"t\"/>"));
  ASSERT_EQ(scene.textures.size(), 1U);
  EXPECT_EQ(scene.textures[0].id, "t");
  EXPECT_EQ(first_model<scene::Plastic>(scene).diffuse_reflectance.texture, 0);
}

TEST_F(Textures, MayBeWrittenAsSpectra) {
  const auto scene =
      load(bsdf("diffuse", "<spectrum type=\"bitmap\" name=\"reflectance\">" +
                               parameter("string", "filename", "a.bmp") + "</spectrum>"));
  EXPECT_EQ(first_model<scene::Diffuse>(scene).reflectance.texture, 0);
}

TEST_F(Textures, MayBeSpectraWithoutAName) {
  const auto scene = load("<spectrum type=\"checkerboard\" id=\"t\"/>" +
                          bsdf("bumpmap",
                               "<spectrum type=\"checkerboard\"/><bsdf "
                               "type=\"diffuse\"><ref name=\"reflectance\" "
                               "id=\"t\"/></bsdf>"));
  EXPECT_EQ(scene.textures.size(), 2U);
}

TEST_F(Textures, Checkerboard) {
  const auto scene = load(bsdf(
      "diffuse", "<texture type=\"checkerboard\" name=\"reflectance\">" +
                     parameter("rgb", "color0", "0.1, 0.2, 0.3") + bitmap("color1", "") +
                     "<transform name=\"to_uv\"><scale x=\"5\" y=\"6\"/></transform></texture>"));
  ASSERT_EQ(scene.textures.size(), 2U);
  EXPECT_EQ(first_model<scene::Diffuse>(scene).reflectance.texture, 1);
  const auto& checkerboard = std::get<scene::CheckerboardTexture>(scene.textures[1].model);
  EXPECT_EQ(checkerboard.colour0.value, (Rgb{0.1F, 0.2F, 0.3F}));
  EXPECT_EQ(checkerboard.colour1.texture, 0);
  EXPECT_EQ(checkerboard.to_uv, (UvMatrix{5, 0, 0, 0, 6, 0}));
  const auto old = load(bsdf("diffuse", "<texture type=\"checkerboard\" name=\"reflectance\">" +
                                            parameter("float", "uscale", "10") +
                                            parameter("float", "voffset", "0.5") + "</texture>"),
                        "0.6.0");
  const auto& plain = std::get<scene::CheckerboardTexture>(old.textures.at(0).model);
  EXPECT_EQ(plain.to_uv, (UvMatrix{10, 0, 0, 0, 1, 0.5F}));
  EXPECT_EQ(plain.colour0.value, (Rgb{0.4F, 0.4F, 0.4F}));
  EXPECT_EQ(plain.colour1.value, (Rgb{0.2F, 0.2F, 0.2F}));
}

TEST_F(Textures, ScaleMultiplies) {
  const auto scene = load(bsdf("diffuse", "<texture type=\"scale\" name=\"reflectance\">" +
                                              parameter("rgb", "scale", "0.5, 2, 3") +
                                              bitmap("any", "") + "</texture>"),
                          "0.6.0");
  const auto& reflectance = first_model<scene::Diffuse>(scene).reflectance;
  EXPECT_EQ(reflectance.texture, 0);
  EXPECT_EQ(reflectance.value, (Rgb{0.5F, 2, 3}));
}

TEST_F(Textures, MeshAttributes) {
  const auto attribute = [&](const std::string& type, const std::string& content) {
    const auto scene = load(bsdf("diffuse", "<texture type=\"" + type + "\" name=\"reflectance\">" +
                                                content + "</texture>"));
    return std::get<scene::AttributeTexture>(scene.textures.at(0).model).name;
  };
  EXPECT_EQ(attribute("mesh_attribute", parameter("string", "name", "face_shade")), "face_shade");
  EXPECT_EQ(attribute("vertexcolors", ""), "vertex_color");
  EXPECT_NE(error_of(bsdf("diffuse", "<texture type=\"mesh_attribute\" name=\"reflectance\"/>"))
                .find("begins with \"vertex_\" or \"face_\""),
            std::string::npos);
}

TEST_F(Textures, UnknownChoicesFallBackUnderLeniency) {
  LoadOptions lenient;
  lenient.lenient = true;
  const auto scene =
      load_text(directory,
                scene_around(bsdf(
                    "diffuse", bitmap("reflectance", parameter("string", "wrap_mode", "border")))),
                lenient);
  ASSERT_TRUE(scene) << scene.error().to_string();
  EXPECT_EQ(std::get<scene::BitmapTexture>(scene.value().textures.at(0).model).wrap,
            scene::TextureWrap::kRepeat);
}

TEST_F(Textures, Errors) {
  EXPECT_EQ(
      error(parameter("string", "filter_type", "cubic")),
      "scene.xml:4: unknown filter_type \"cubic\" of texture \"bitmap\"; supported: bilinear, "
      "nearest");
  EXPECT_EQ(error(parameter("string", "wrap_mode", "repaet")),
            "scene.xml:4: unknown wrap_mode \"repaet\" of texture \"bitmap\"; did you mean "
            "\"repeat\"? (supported: repeat, mirror, clamp)");
  EXPECT_EQ(error(parameter("float", "gamma", "1")).substr(0, 58),
            "scene.xml:4: unknown parameter \"gamma\" of texture \"bitmap\"");
  EXPECT_EQ(error_of(directory, bsdf("diffuse", bitmap("reflectance", "", "c.bmp"))).substr(0, 38),
            "scene.xml:4: file \"c.bmp\" not found; l");
  EXPECT_EQ(error_of(bsdf("diffuse", "<texture type=\"bitmap\" name=\"reflectance\"/>")),
            "scene.xml:3: texture \"bitmap\" needs a filename");
  EXPECT_EQ(
      error_of(bsdf("diffuse", "<texture type=\"bitmpa\" name=\"reflectance\"/>")),
      "scene.xml:3: texture \"bitmpa\" is not supported; did you mean \"bitmap\"? (supported: "
      "bitmap, checkerboard, scale, mesh_attribute, vertexcolors)");
  EXPECT_EQ(error_of("<texture type=\"checkerboard\" id=\"t\"><ref name=\"color0\" id=\"t\"/>"
                     "</texture>" +
                     bsdf("diffuse", "<ref name=\"reflectance\" id=\"t\"/>")),
            "scene.xml:2: texture \"checkerboard\" contains itself");
  directory.write("a.bmp", "BM, but no image");
  EXPECT_EQ(error("").substr(0, 12), "scene.xml:4:");
}

TEST_F(Textures, StayInsideTheRoot) {
  const LoadOptions options{.root = directory.path() / "inside"};
  const auto file = directory.write(
      "inside/scene.xml", scene_around(bsdf("diffuse", bitmap("reflectance", "", "../a.bmp"))));
  const auto scene = load_scene(file, options);
  ASSERT_FALSE(scene);
  EXPECT_NE(scene.error().message.find("lies outside"), std::string::npos);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
