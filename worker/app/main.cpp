// metrofarm-worker: renders for a coordinator, or helps on the command line.
#include <cstdio>
#include <string>
#include <vector>

#include "app/bench.h"

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  const std::string command = words.empty() ? "" : words[0];
  if (command == "bench") return metrofarm::app::run_bench({words.begin() + 1, words.end()});
  std::fprintf(stderr, "usage: metrofarm-worker bench SCENE.xml\n");
  return 2;
}
