// Short ways to write materials in tests of the importer.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "support.h"

namespace metrofarm::scene_file::test {

inline std::string bsdf(const std::string& type, const std::string& content) {
  return "<bsdf type=\"" + type + "\">\n" + content + "</bsdf>";
}

// <tag name="name" value="value"/>
inline std::string parameter(const std::string& tag, const std::string& name,
                             const std::string& value) {
  return "<" + tag + " name=\"" + name + "\" value=\"" + value + "\"/>";
}

// Like load_valid and error_of for a file of Mitsuba 0.6; content begins on line 2.
inline scene::SceneDescription load_legacy(const Directory& directory, const std::string& content) {
  auto scene = load_text(directory, scene_around(content, "0.6.0"));
  EXPECT_TRUE(scene) << scene.error().to_string();
  return scene ? scene.value() : scene::SceneDescription{};
}

inline scene::SceneDescription load_legacy(const std::string& content) {
  return load_legacy(Directory(), content);
}

inline std::string legacy_error_of(const std::string& content) {
  const Directory directory;
  const auto scene = load_text(directory, scene_around(content, "0.6.0"));
  if (scene) return "";
  return scene.error().to_string().substr(directory.path().string().size() + 1);
}

// The first material that is a Model; the test fails if there is none.
template <class Model>
Model first_model(const scene::SceneDescription& scene) {
  for (const scene::Bsdf& material : scene.bsdfs) {
    if (const auto* model = std::get_if<Model>(&material.model)) return *model;
  }
  ADD_FAILURE() << "no such material among " << scene.bsdfs.size();
  return {};
}

template <class Model>
Model load_bsdf(const std::string& type, const std::string& content) {
  return first_model<Model>(load_valid(bsdf(type, content)));
}

template <class Model>
Model load_legacy_bsdf(const std::string& type, const std::string& content) {
  return first_model<Model>(load_legacy(bsdf(type, content)));
}

inline void expect_near(const scene::Rgb& actual, const scene::Rgb& expected,
                        float relative = 1e-5F) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(actual[i], expected[i], relative * expected[i]) << i;
}

}  // namespace metrofarm::scene_file::test
