#include "app/inspect.h"

#include <google/protobuf/util/json_util.h>

#include <chrono>
#include <cstdio>

#include "app/arguments.h"
#include "rpc/convert.h"
#include "scene_file/load.h"

namespace metrofarm::app {
namespace {

int fail(const Error& error, int code) {
  std::fprintf(stderr, "%s\n", error.to_string().c_str());
  return code;
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

int run_inspect(const std::vector<std::string>& words) {
  const auto parsed = parse_arguments(words, {"set"}, {"lenient"});
  if (!parsed) return fail(parsed.error(), 2);
  if (parsed.value().positional.size() != 1)
    return fail({"usage: metrofarm-worker inspect SCENE [--set NAME=VALUE]... [--lenient]"}, 2);
  const auto defaults = parsed.value().assignments("set");
  if (!defaults) return fail(defaults.error(), 2);
  scene_file::LoadOptions options;
  options.defaults = defaults.value();
  options.lenient = parsed.value().has("lenient");

  const auto start = std::chrono::steady_clock::now();
  auto loaded = scene_file::load_scene(parsed.value().positional[0], options);
  if (!loaded) return fail(loaded.error(), 1);
  const auto read = std::chrono::steady_clock::now();
  const double load_seconds = seconds_since(start);
  const transport::Scene scene(std::move(loaded.value()), "avx2");

  std::string json;
  google::protobuf::util::JsonPrintOptions print;
  print.always_print_primitive_fields = true;
  print.preserve_proto_field_names = true;
  const auto status = google::protobuf::util::MessageToJsonString(
      rpc::to_report(scene, {load_seconds, seconds_since(read)}), &json, print);
  METROFARM_CHECK(status.ok());
  std::printf("%s\n", json.c_str());
  return 0;
}

}  // namespace metrofarm::app
