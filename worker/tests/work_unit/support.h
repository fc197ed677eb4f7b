// A small job: the room, and seeds for one group of its chains.
#pragma once

#include <gtest/gtest.h>

#include "base/parallel.h"
#include "tests/support/room.h"
#include "work_unit/units.h"

namespace metrofarm::work_unit::test {

struct Job {
  explicit Job(Integrator integrator, scene::SceneDescription description = metrofarm::test::room())
      : scene(std::move(description), "avx2"), context(scene, spec_of(integrator)) {}

  static Spec spec_of(Integrator integrator) {
    Spec spec;
    spec.integrator = integrator;
    spec.width = 40;
    spec.height = 36;
    spec.seed = 77;
    spec.unit = 0.5;
    spec.path.max_depth = 8;
    return spec;
  }

  FlushDenormals flush;
  transport::Scene scene;
  Context context;
};

// The first 64 samples with f > 0 after `first` (no draw in proportion to f, but good enough here).
inline ChainSeeds seeds_from(const Context& context, uint64_t first) {
  const BootstrapOutput bootstrap = run_bootstrap(context, first, 1024);
  ChainSeeds seeds;
  for (size_t i = 0; i < bootstrap.values.size() && seeds.indices.size() < kGroupSize; ++i) {
    if (!(bootstrap.values[i] > 0)) continue;
    seeds.indices.push_back(first + i);
    seeds.values.push_back(bootstrap.values[i]);
  }
  EXPECT_EQ(seeds.indices.size(), size_t{kGroupSize});
  return seeds;
}

}  // namespace metrofarm::work_unit::test
