#include "scene_file/mitsuba/images.h"

#include <cmath>
#include <span>

#include "image_io/read_image.h"
#include "scene_file/mitsuba/textures.h"
#include "scene_file/names.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Image;
using scene::Index;

ImageChannels read_channels(Properties& properties) {
  const std::string name = lower_case(properties.text("channel", "all"));
  if (name == "all" || name.empty()) return ImageChannels::kAll;
  if (name == "r" || name == "x") return ImageChannels::kRed;
  if (name == "g" || name == "y") return ImageChannels::kGreen;
  if (name == "b" || name == "z") return ImageChannels::kBlue;
  if (name == "a") return ImageChannels::kAlpha;
  properties.problems().unsupported(
      "unknown channel \"" + name + "\"" + suggestion(name, {"r", "g", "b", "a", "x", "y", "z"}),
      properties.find("channel")->where);
  return ImageChannels::kAll;
}

template <class Value>
std::vector<Value> every_nth(const std::vector<Value>& values, int first, int step) {
  std::vector<Value> picked;
  picked.reserve(values.size() / static_cast<size_t>(step));
  for (size_t i = static_cast<size_t>(first); i < values.size(); i += static_cast<size_t>(step)) {
    picked.push_back(values[i]);
  }
  return picked;
}

// The channel's place among those of the image; nothing if it has no such channel.
std::optional<int> channel_index(const Image& image, ImageChannels channel) {
  if (channel == ImageChannels::kAlpha) {
    return image.channels == 4 ? std::optional(3) : std::nullopt;
  }
  if (image.channels == 1) return 0;
  return static_cast<int>(channel) - static_cast<int>(ImageChannels::kRed);
}

Image single_channel(const Image& image, int channel) {
  Image single;
  single.width = image.width;
  single.height = image.height;
  single.channels = 1;
  single.srgb = image.srgb && channel != 3;
  std::visit(
      [&](const auto& values) { single.pixels = every_nth(values, channel, image.channels); },
      image.pixels);
  return single;
}

// The bytes of the image as they are, raised to a power.
void apply_gamma(double gamma, Image& image) {
  const auto* bytes = std::get_if<std::vector<uint8_t>>(&image.pixels);
  if (!bytes || gamma == 1) return;
  std::vector<float> values(bytes->size());
  for (size_t i = 0; i < values.size(); ++i) {
    const bool is_alpha = image.channels == 4 && i % 4 == 3;
    const double value = (*bytes)[i] / 255.0;
    values[i] = static_cast<float>(is_alpha ? value : std::pow(value, gamma));
  }
  image.pixels = std::move(values);
}

Result<Image> read(const std::filesystem::path& path, const ImageDecoding& decoding,
                   Context& context) {
  const Result<FileBytes> bytes = context.files.read(path);
  if (!bytes) return bytes.error();
  const std::string& content = *bytes.value();
  Result<Image> image = image_io::read_image(
      {reinterpret_cast<const uint8_t*>(content.data()), content.size()}, path.string(),
      decoding.srgb ? image_io::Encoding::kSrgb : image_io::Encoding::kLinear,
      context.files.memory().for_file(content.size()));
  if (!image) return image;
  apply_gamma(decoding.gamma, image.value());
  if (decoding.channels == ImageChannels::kAll) return image;
  const std::optional<int> channel = channel_index(image.value(), decoding.channels);
  if (!channel) return Error{"image \"" + path.string() + "\" has no alpha channel"};
  return single_channel(image.value(), *channel);
}

std::string key_of(const std::filesystem::path& path, const ImageDecoding& decoding) {
  return path.lexically_normal().string() + "|" + (decoding.srgb ? "srgb" : "linear") + "|" +
         std::to_string(decoding.gamma) + "|" + std::to_string(static_cast<int>(decoding.channels));
}

}  // namespace

ImageDecoding read_decoding(Properties& properties) {
  ImageDecoding decoding;
  // What they choose is how images lie in memory and how fast they are looked up.
  properties.ignore({"accel", "format"});
  decoding.srgb = !properties.boolean("raw", false);
  if (!properties.element().legacy) return decoding;
  properties.ignore({"cache", "max_anisotropy"});
  decoding.channels = read_channels(properties);
  const double gamma = properties.number_in("gamma", 0, -1, 10);
  if (gamma <= 0) return decoding;  // as the file says
  decoding.srgb = false;
  decoding.gamma = gamma;
  return decoding;
}

Index load_image(Properties& properties, const ImageDecoding& decoding, Context& context) {
  const Element* name = properties.find("filename");
  const SourceLocation& where = name ? name->where : properties.element().where;
  if (!name) {
    context.problems.fail(properties.element().describe() + " needs a filename", where);
    return scene::kNone;
  }
  const auto path = context.files.find(properties.text("filename", ""));
  if (!path) {
    context.problems.fail(path.error().message, where);
    return scene::kNone;
  }
  const auto [it, is_new] = context.images.emplace(key_of(path.value(), decoding), scene::kNone);
  if (!is_new) return it->second;
  Result<Image> image = read(path.value(), decoding, context);
  if (!image) {
    context.problems.fail(image.error().message, where);
    return scene::kNone;
  }
  if (std::optional<Error> error = context.files.memory().take(image.value())) {
    context.problems.fail(path.value().string() + ": " + error->message, where);
    return scene::kNone;
  }
  context.scene.images.push_back(std::move(image.value()));
  it->second = static_cast<Index>(context.scene.images.size() - 1);
  return it->second;
}

Index load_image(Properties& properties, bool srgb, Context& context) {
  return load_image(properties, ImageDecoding{.srgb = srgb}, context);
}

}  // namespace metrofarm::scene_file::mitsuba
