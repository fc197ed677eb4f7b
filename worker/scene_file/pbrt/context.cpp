#include "scene_file/pbrt/context.h"

#include <array>
#include <span>

#include "image_io/read_image.h"
#include "motion/track.h"
#include "scene_file/names.h"

namespace metrofarm::scene_file::pbrt {
namespace {

// Names of pbrt-v3 and what they are called now.
constexpr auto kOldNames = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"matte", "diffuse"},
    {"glass", "dielectric"},
    {"mirror", "conductor"},
    {"metal", "conductor"},
    {"plastic", "coateddiffuse"},
    {"uber", "coateddiffuse"},
    {"substrate", "coateddiffuse"},
    {"translucent", "diffusetransmission"},
    {"none", "interface"},
    {"image", "rgb"},
    {"exinfinite", "infinite"},
});

std::string hint_for(std::string_view type) {
  for (const auto& [old_name, new_name] : kOldNames) {
    if (old_name != type) continue;
    return "; this is a name of pbrt-v3, in pbrt-v4 use \"" + std::string(new_name) +
           "\" (pbrt --upgrade converts files)";
  }
  return "";
}

}  // namespace

scene::Motion motion_between(const std::array<Matrix, 2>& transforms, const SourceLocation& where,
                             Context& context) {
  if (transforms[0] == transforms[1]) return {};
  scene::Motion motion;
  for (size_t i = 0; i < 2; ++i) motion.keys.push_back({context.transform_times[i], transforms[i]});
  if (const std::optional<std::string> problem = motion::Track::problem_with(motion)) {
    context.problems.fail(*problem, where);
    return {};
  }
  return motion;
}

void report_unknown_plugin(std::string_view what, const Entity& entity,
                           const std::vector<std::string_view>& supported, std::string_view instead,
                           Problems& problems) {
  std::string message = std::string(what) + " \"" + entity.type + "\" is not supported" +
                        hint_for(entity.type) + suggestion(entity.type, supported);
  if (problems.lenient()) message += "; " + std::string(instead);
  problems.unsupported(std::move(message), entity.where());
}

FileBytes read_named_file(const std::string& name, const SourceLocation& where, Context& context) {
  const Result<std::filesystem::path> path = context.files.find(name);
  if (!path) {
    context.problems.fail(path.error().message, where);
    return nullptr;
  }
  Result<FileBytes> bytes = context.files.read(path.value());
  if (!bytes) {
    context.problems.fail(bytes.error().message, where);
    return nullptr;
  }
  return bytes.value();
}

scene::Index read_named_image(const std::string& name, bool linear, const SourceLocation& where,
                              Context& context) {
  const FileBytes bytes = read_named_file(name, where, context);
  if (!bytes) return scene::kNone;
  const std::span<const uint8_t> pixels(reinterpret_cast<const uint8_t*>(bytes->data()),
                                        bytes->size());
  const auto encoding = linear ? image_io::Encoding::kLinear : image_io::Encoding::kSrgb;
  Result<scene::Image> image =
      image_io::read_image(pixels, name, encoding, context.files.memory().for_file(pixels.size()));
  if (!image) {
    Error error = image.error();
    error.message = error.to_string();
    error.where = where;
    context.problems.fail(std::move(error));
    return scene::kNone;
  }
  if (std::optional<Error> error = context.files.memory().take(image.value())) {
    context.problems.fail("\"" + name + "\": " + error->message, where);
    return scene::kNone;
  }
  return append(context.scene.images, std::move(image.value()));
}

}  // namespace metrofarm::scene_file::pbrt
