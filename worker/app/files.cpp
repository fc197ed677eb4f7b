#include "app/files.h"

#include <cstdio>
#include <filesystem>
#include <set>

#include "app/arguments.h"
#include "scene_file/load.h"

namespace metrofarm::app {

int run_files(const std::vector<std::string>& words) {
  const auto fail = [](const Error& error, int code) {
    std::fprintf(stderr, "%s\n", error.to_string().c_str());
    return code;
  };
  const auto parsed = parse_arguments(words, {"set"}, {"lenient"});
  if (!parsed) return fail(parsed.error(), 2);
  if (parsed.value().positional.size() != 1)
    return fail({"usage: metrofarm-worker files SCENE [--set NAME=VALUE]... [--lenient]"}, 2);
  const auto defaults = parsed.value().assignments("set");
  if (!defaults) return fail(defaults.error(), 2);

  std::set<std::string> files;
  scene_file::LoadOptions options;
  options.defaults = defaults.value();
  options.lenient = parsed.value().has("lenient");
  options.file_read = [&](const std::filesystem::path& file) {
    files.insert(std::filesystem::absolute(file).lexically_normal().string());
  };
  // With a slash at the end: the bundle's root must hold them too.
  options.folder_added = [&](const std::filesystem::path& folder) {
    files.insert((std::filesystem::absolute(folder) / "").lexically_normal().string());
  };
  const auto loaded = scene_file::load_scene(parsed.value().positional[0], options);
  if (!loaded) return fail(loaded.error(), 1);
  for (const std::string& file : files) std::printf("%s\n", file.c_str());
  return 0;
}

}  // namespace metrofarm::app
