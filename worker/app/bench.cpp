#include "app/bench.h"

#include <ctime>

#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <numeric>
#include <optional>

#include "base/parallel.h"
#include "math/rng.h"
#include "math/warp.h"
#include "primary_space/sample_source.h"
#include "scene_file/load.h"
#include "work_unit/units.h"

namespace metrofarm::app {
namespace {

using work_unit::Context;
using work_unit::Integrator;
using work_unit::Spec;

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

double wall_seconds() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(now).count();
}

struct Options {
  std::string scene;
  scene_file::LoadOptions load;
  Integrator integrator = Integrator::kPath;
  work_unit::Under under = work_unit::Under::kPath;
  transport::LightSampling light_sampling = transport::LightSampling::kMis;
  uint64_t per_pixel = 16;
  uint64_t width = 0, height = 0, threads = 1, seed = 1;
};

// Sets `into` to the value that the option names, else says what would be right.
template <class Value>
std::optional<Error> choose(const Arguments& a, const char* option,
                            const std::map<std::string, Value>& values, Value& into) {
  const auto given = a.options.find(option);
  if (given == a.options.end()) return std::nullopt;
  const auto found = values.find(given->second.back());
  if (found != values.end()) {
    into = found->second;
    return std::nullopt;
  }
  std::string names;
  for (const auto& [name, value] : values) names += (names.empty() ? "" : ", ") + name;
  return Error{std::string("--") + option + ": '" + given->second.back() + "' is not one of " +
               names};
}

std::optional<Error> read_choices(const Arguments& a, Options& o) {
  using transport::LightSampling;
  using work_unit::Under;
  if (auto problem = choose<Integrator>(a, "integrator",
                                        {{"path", Integrator::kPath},
                                         {"pssmlt", Integrator::kPssmlt},
                                         {"bdpt", Integrator::kBdpt}},
                                        o.integrator))
    return problem;
  if (auto problem =
          choose<Under>(a, "under", {{"path", Under::kPath}, {"bdpt", Under::kBdpt}}, o.under))
    return problem;
  return choose<LightSampling>(a, "light-sampling",
                               {{"mis", LightSampling::kMis},
                                {"emitter", LightSampling::kEmitter},
                                {"bsdf", LightSampling::kBsdf}},
                               o.light_sampling);
}

Result<Options> read_options(const std::vector<std::string>& words) {
  const auto parsed = parse_arguments(words,
                                      {"integrator", "under", "light-sampling", "per-pixel",
                                       "width", "height", "threads", "seed", "set"},
                                      {"lenient"});
  if (!parsed) return parsed.error();
  const Arguments& a = parsed.value();
  if (a.positional.size() != 1) return Error{"usage: metrofarm-worker bench SCENE [options]"};
  Options o;
  o.scene = a.positional[0];
  if (auto problem = read_choices(a, o)) return *problem;
  const auto defaults = a.assignments("set");
  if (!defaults) return defaults.error();
  o.load.defaults = defaults.value();
  o.load.lenient = a.has("lenient");
  const auto read = [&](const char* name, uint64_t& into, uint64_t low, uint64_t high) {
    const auto value = a.number(name, into, low, high);
    if (value) into = value.value();
    return value;
  };
  for (const auto& result :
       {read("per-pixel", o.per_pixel, 1, 1 << 20), read("width", o.width, 1, 32768),
        read("height", o.height, 1, 32768), read("threads", o.threads, 1, 1024),
        read("seed", o.seed, 0, UINT64_MAX)}) {
    if (!result) return result.error();
  }
  return o;
}

Spec spec_of(const Options& o, const scene::SceneDescription& d) {
  Spec spec;
  spec.integrator = o.integrator;
  spec.under = o.under;
  spec.path = {o.light_sampling, d.integrator.max_depth, d.integrator.rr_depth,
               d.integrator.hide_emitters};
  spec.shutter.open = d.sensor.shutter_open;
  spec.shutter.close = d.sensor.shutter_close;
  spec.width = o.width > 0 ? static_cast<int>(o.width) : d.film.image_width();
  spec.height = o.height > 0 ? static_cast<int>(o.height) : d.film.image_height();
  spec.seed = o.seed;
  return spec;
}

struct Figures {
  uint64_t samples = 0, rays = 0;
  double cpu_seconds = 0, wall_seconds = 0;
};

Figures render_paths(const Context& context, const Options& o, film::Film& film) {
  const uint64_t segments = context.blocks();
  std::vector<work_unit::SegmentOutput> outputs(segments);
  Figures f;
  const double cpu = cpu_seconds(), wall = wall_seconds();
  parallel_for(segments, static_cast<int>(o.threads), [&](size_t i, int) {
    outputs[i] =
        work_unit::run_path_segment(context, static_cast<uint32_t>(i), {0, o.per_pixel}, film);
  });
  f.cpu_seconds = cpu_seconds() - cpu;
  f.wall_seconds = wall_seconds() - wall;
  for (const auto& out : outputs) {
    f.samples += out.counts.mutations;
    f.rays += out.counts.rays;
  }
  return f;
}

constexpr uint64_t kBootstrapSamples = 65536;
constexpr uint32_t kGroups = 32;

double bootstrap_mean(const Context& context, const Options& o, std::vector<float>& values) {
  constexpr uint32_t kChunk = 1024;
  values.resize(kBootstrapSamples);
  parallel_for(kBootstrapSamples / kChunk, static_cast<int>(o.threads), [&](size_t i, int) {
    const auto out = work_unit::run_bootstrap(context, i * kChunk, kChunk);
    std::copy(out.values.begin(), out.values.end(), values.begin() + long(i * kChunk));
  });
  return std::accumulate(values.begin(), values.end(), 0.0) / kBootstrapSamples;
}

// Seeds in proportion to f, taken at even steps of the cumulative sum.
work_unit::ChainSeeds draw_seeds(const std::vector<float>& values, double mean, uint32_t group) {
  work_unit::ChainSeeds seeds;
  const double step = mean * kBootstrapSamples / (kGroups * work_unit::kGroupSize);
  double target = (group * work_unit::kGroupSize + 0.5) * step, sum = 0;
  for (size_t i = 0; i < values.size() && seeds.indices.size() < work_unit::kGroupSize; ++i) {
    sum += values[i];
    while (sum > target && seeds.indices.size() < work_unit::kGroupSize) {
      seeds.indices.push_back(i);
      seeds.values.push_back(values[i]);
      target += step;
    }
  }
  return seeds;
}

Result<Figures> render_chains(const Context& context, const Options& o,
                              const std::vector<float>& values, film::Film& film) {
  const uint64_t pixels = uint64_t(context.spec().width) * context.spec().height;
  const uint64_t mutations = o.per_pixel * pixels / (uint64_t{kGroups} * work_unit::kGroupSize) + 1;
  std::vector<work_unit::ChainGroup> groups(kGroups);
  for (uint32_t g = 0; g < kGroups; ++g) {
    auto state = work_unit::start_chains(context, draw_seeds(values, context.spec().unit, g));
    if (!state) return state.error();
    groups[g] = {g, std::move(state.value())};
  }
  std::vector<work_unit::SegmentOutput> outputs(kGroups);
  Figures f;
  const double cpu = cpu_seconds(), wall = wall_seconds();
  parallel_for(kGroups, static_cast<int>(o.threads), [&](size_t g, int) {
    outputs[g] = work_unit::run_chain_segment(context, groups[g], mutations, film);
  });
  f.cpu_seconds = cpu_seconds() - cpu;
  f.wall_seconds = wall_seconds() - wall;
  for (const auto& out : outputs) {
    f.samples += out.counts.mutations;
    f.rays += out.counts.rays;
  }
  return f;
}

// Keeps the rays of some paths, to trace them again with nothing around them.
struct RecordedRays {
  std::vector<Vec3> origin, direction;
  std::vector<Float> time;
  std::vector<Mask> active;
};

RecordedRays record_rays(const Context& context) {
  RecordedRays rays;
  primary_space::IndependentSource source(rng_key(context.spec().seed, RngDomain::kTest));
  const transport::Scene& scene = context.scene();
  for (uint64_t first = 0; first < 8192; first += kLanes) {
    source.begin(first);
    const auto film = source.pair(primary_space::kFilmSlot, all_lanes());
    const auto window = context.whole_raster();
    const Float time = transport::sample_time(context.camera(), source, window, all_lanes());
    auto ray = context.camera().ray(window.x + film.first * window.width,
                                    window.y + film.second * window.height,
                                    {Float(0.5F), Float(0.5F)}, time);
    Mask active = all_lanes();
    for (int bounce = 0; bounce < 6 && any(active); ++bounce) {
      rays.origin.push_back(ray.origin);
      rays.direction.push_back(ray.direction);
      rays.time.push_back(time);
      rays.active.push_back(active);
      const auto hits = scene.tracer().intersect(active, ray.origin, ray.direction, time);
      active = hits.hit;
      const auto surface = geometry::surface_at(scene.primitives(), scene.placements(), hits,
                                                ray.origin, ray.direction, {});
      const auto u =
          source.pair(primary_space::eye_slot(bounce, primary_space::Decision::kDirection), active);
      const Float side = xsimd::copysign(Float(1.F), -dot(surface.geometric_normal, ray.direction));
      const Frame frame = frame_around(surface.geometric_normal * side);
      ray.direction = frame.to_world(square_to_cosine_hemisphere({u.first, u.second}));
      ray.origin = geometry::offset_origin(surface.position, surface.geometric_normal,
                                           surface.offset, ray.direction);
    }
  }
  return rays;
}

// Rays per CPU second of the bare ray tracer on cosine-scattered paths of the scene.
double raw_rays_per_second(const Context& context) {
  const RecordedRays rays = record_rays(context);
  uint64_t traced = 0;
  const double start = cpu_seconds();
  while (cpu_seconds() - start < 1) {
    for (size_t i = 0; i < rays.origin.size(); ++i) {
      context.scene().tracer().intersect(rays.active[i], rays.origin[i], rays.direction[i],
                                         rays.time[i]);
      traced += __builtin_popcount(bits(rays.active[i]));
    }
  }
  return double(traced) / (cpu_seconds() - start);
}

const char* name_of(Integrator integrator) {
  switch (integrator) {
    case Integrator::kPath:
      return "path";
    case Integrator::kPssmlt:
      return "pssmlt";
    case Integrator::kBdpt:
      return "bdpt";
    case Integrator::kMmlt:
      return "mmlt";
  }
  return "";
}

int fail(const Error& error) {
  std::fprintf(stderr, "metrofarm-worker: %s\n", error.to_string().c_str());
  return 1;
}

}  // namespace

int run_bench(const std::vector<std::string>& words) {
  const auto options = read_options(words);
  if (!options) return fail(options.error());
  const Options& o = options.value();
  const double load_start = wall_seconds();
  auto description = scene_file::load_scene(o.scene, o.load);
  if (!description) return fail(description.error());
  Spec spec = spec_of(o, description.value());
  if (const std::string problem = work_unit::problem_with(spec); !problem.empty())
    return fail({problem});
  const transport::Scene scene(std::move(description.value()), "avx2");
  const double load_time = wall_seconds() - load_start;

  const FlushDenormals flush;
  std::vector<float> values;
  if (work_unit::runs_chains(spec.integrator))
    spec.unit = bootstrap_mean(Context(scene, spec), o, values);
  if (!(spec.unit > 0)) return fail({"no bootstrap sample found any light"});
  const Context context(scene, spec);
  film::Film film(context.film_shape());
  Figures f;
  if (!work_unit::runs_chains(spec.integrator)) {
    f = render_paths(context, o, film);
  } else {
    auto rendered = render_chains(context, o, values, film);
    if (!rendered) return fail(rendered.error());
    f = rendered.value();
  }
  std::printf(
      "{\"integrator\": \"%s\", \"samples\": %llu, \"rays\": %llu, \"cpu_seconds\": %.4f, "
      "\"wall_seconds\": %.4f, \"samples_per_cpu_second\": %.0f, "
      "\"rays_per_cpu_second\": %.0f, \"raw_rays_per_cpu_second\": %.0f, "
      "\"load_seconds\": %.4f, \"memory_bytes\": %llu}\n",
      name_of(spec.integrator), static_cast<unsigned long long>(f.samples),
      static_cast<unsigned long long>(f.rays), f.cpu_seconds, f.wall_seconds,
      double(f.samples) / f.cpu_seconds, double(f.rays) / f.cpu_seconds,
      raw_rays_per_second(context), load_time,
      static_cast<unsigned long long>(scene.bytes().total()));
  return 0;
}

}  // namespace metrofarm::app
