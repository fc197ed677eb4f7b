// metrofarm-worker: renders for a coordinator, or helps on the command line.
#include <cstdio>
#include <string>
#include <vector>

#include "app/bench.h"
#include "app/files.h"
#include "app/inspect.h"
#include "app/serve.h"

namespace {

constexpr char kUsage[] =
    "usage: metrofarm-worker --coordinator HOST:PORT[,HOST:PORT...] [--threads N] [--isa avx2]\n"
    "                        [--name NAME] [--cache DIR] [--cache-size BYTES]\n"
    "                        [--scene-memory BYTES] [--grace SECONDS] [--metrics HOST:PORT]\n"
    "                        [--log-format text|json] [--insecure | --tls-ca FILE\n"
    "                        [--tls-cert FILE --tls-key FILE]]\n"
    "       metrofarm-worker files SCENE [--set NAME=VALUE]... [--lenient]\n"
    "       metrofarm-worker inspect SCENE [--set NAME=VALUE]... [--lenient]\n"
    "       metrofarm-worker bench SCENE [--integrator path|pssmlt] [--per-pixel N]\n"
    "                        [--width N] [--height N] [--threads N] [--seed N]\n"
    "                        [--set NAME=VALUE]... [--lenient]\n"
    "--scene-memory: default half of what its control group or the machine has, the smaller\n";

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  const std::string command = words.empty() ? "--help" : words[0];
  if (command == "--help" || command == "-h") {
    std::fputs(kUsage, stdout);
    return words.empty() ? 2 : 0;
  }
  const std::vector<std::string> rest(words.begin() + 1, words.end());
  if (command == "bench") return metrofarm::app::run_bench(rest);
  if (command == "inspect") return metrofarm::app::run_inspect(rest);
  if (command == "files") return metrofarm::app::run_files(rest);
  return metrofarm::app::run_serve(words);
}
