#include "pbrt_support.h"

#include <gtest/gtest.h>

namespace metrofarm::scene_file::test {

scene::SceneDescription valid_pbrt(std::string_view world, std::string_view options,
                                   const LoadOptions& load_options) {
  const Directory directory;
  Result<scene::SceneDescription> scene =
      load_pbrt(directory, pbrt_around(world, options), load_options);
  EXPECT_TRUE(scene) << (scene ? "" : scene.error().to_string());
  return scene ? std::move(scene.value()) : scene::SceneDescription{};
}

std::string pbrt_error(std::string_view text, const LoadOptions& options) {
  const Directory directory;
  const auto scene = load_pbrt(directory, text, options);
  if (scene) return "";
  std::string message = scene.error().to_string();
  const std::string prefix = directory.path().string() + "/";
  for (size_t at = message.find(prefix); at != std::string::npos; at = message.find(prefix)) {
    message.erase(at, prefix.size());
  }
  return message;
}

}  // namespace metrofarm::scene_file::test
