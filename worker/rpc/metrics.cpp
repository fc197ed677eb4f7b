#include "rpc/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/registry.h>

#include <algorithm>
#include <cctype>

namespace metrofarm::rpc {

using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Registry;

namespace {

const std::string kPrefix = "metrofarm_worker_";

Family<Counter>& counters(Registry& registry, const std::string& name, const std::string& help) {
  return prometheus::BuildCounter().Name(kPrefix + name).Help(help).Register(registry);
}

Counter& counter(Registry& registry, const std::string& name, const std::string& help) {
  return counters(registry, name, help).Add({});
}

Gauge& gauge(Registry& registry, const std::string& name, const std::string& help) {
  return prometheus::BuildGauge().Name(kPrefix + name).Help(help).Register(registry).Add({});
}

}  // namespace

struct Metrics::Impl {
  std::shared_ptr<Registry> registry = std::make_shared<Registry>();
  Registry& r = *registry;
  Family<Counter>& segments =
      counters(r, "segments_total", "Segments leased, by what became of them.");
  Family<Counter>& batches = counters(r, "batches_total", "Batches sent, by the answer.");
  Family<Counter>& sent =
      counters(r, "sent_bytes_total", "Bytes of the batches sent, by the answer.");
  Counter& mutations =
      counter(r, "mutations_total", "Mutations proposed, or samples of independent paths taken.");
  Counter& rays = counter(r, "rays_total", "Rays traced.");
  Counter& cpu = counter(r, "render_cpu_seconds_total", "CPU time of rendering.");
  Counter& hits = counter(r, "cache_hits_total", "Scene bundles found on disk.");
  Counter& misses = counter(r, "cache_misses_total", "Scene bundles fetched.");
  Counter& evictions =
      counter(r, "cache_evictions_total", "Scene bundles removed from disk to make room.");
  Counter& damaged =
      counter(r, "cache_damaged_total", "Scene bundles found damaged on disk and removed.");
  Gauge& cache_bytes = gauge(r, "cache_bytes", "Size of the scene bundles on disk.");
  Gauge& scenes = gauge(r, "loaded_scenes", "Scenes in memory.");
  Gauge& scene_bytes = gauge(r, "loaded_scene_bytes", "Size of the scenes in memory.");
  Gauge& threads = gauge(r, "threads", "Render threads.");
  Gauge& busy = gauge(r, "threads_busy", "Render threads that render.");
  Gauge& known = gauge(r, "coordinators", "Coordinators known.");
  Gauge& connected =
      gauge(r, "coordinators_connected", "Coordinators that this worker takes work from.");
  Gauge& leases = gauge(r, "leases", "Leases held.");
  Gauge& parcels = gauge(r, "deliveries_in_flight", "Results that wait for an answer.");
};

Metrics::Metrics(const std::string& version, const std::string& isa, int threads)
    : impl_(std::make_unique<Impl>()) {
  prometheus::BuildGauge()
      .Name(kPrefix + "build_info")
      .Help("Always 1; the version of the worker.")
      .Register(impl_->r)
      .Add({{"version", version}, {"isa", isa}})
      .Set(1);
  impl_->threads.Set(threads);
  // From the start, so that rates have something to begin with.
  for (const char* outcome :
       {"committed", "duplicate", "superseded", "conflict", "rejected", "lost"})
    batch(outcome, 0, 0);
  for (const char* outcome : {"released", "abandoned", "failed"}) segments_left(outcome, 0);
}

Metrics::~Metrics() = default;

void Metrics::batch(const std::string& outcome, size_t segments, uint64_t bytes) {
  impl_->segments.Add({{"outcome", outcome}}).Increment(double(segments));
  impl_->batches.Add({{"reply", outcome}}).Increment(segments > 0 ? 1 : 0);
  impl_->sent.Add({{"reply", outcome}}).Increment(double(bytes));
}

void Metrics::segments_left(const std::string& outcome, size_t segments) {
  impl_->segments.Add({{"outcome", outcome}}).Increment(double(segments));
}

void Metrics::rendered(uint64_t mutations, uint64_t rays, double cpu_seconds) {
  impl_->mutations.Increment(double(mutations));
  impl_->rays.Increment(double(rays));
  impl_->cpu.Increment(cpu_seconds);
}

void Metrics::thread_busy(int change) {
  impl_->busy.Increment(change);
}

void Metrics::bundle_hit() {
  impl_->hits.Increment();
}

void Metrics::bundle_missed() {
  impl_->misses.Increment();
}

void Metrics::bundle_evicted() {
  impl_->evictions.Increment();
}

void Metrics::bundle_damaged() {
  impl_->damaged.Increment();
}

void Metrics::bundle_bytes(uint64_t bytes) {
  impl_->cache_bytes.Set(double(bytes));
}

void Metrics::loaded_scenes(size_t scenes, uint64_t bytes) {
  impl_->scenes.Set(double(scenes));
  impl_->scene_bytes.Set(double(bytes));
}

void Metrics::coordinators(size_t known, size_t connected) {
  impl_->known.Set(double(known));
  impl_->connected.Set(double(connected));
}

void Metrics::leases(size_t held) {
  impl_->leases.Set(double(held));
}

void Metrics::parcels(size_t waiting) {
  impl_->parcels.Set(double(waiting));
}

std::shared_ptr<prometheus::Collectable> Metrics::collectable() const {
  return impl_->registry;
}

std::string outcome_name(farm::v1::Outcome outcome) {
  const std::string prefix = "OUTCOME_";
  std::string name = farm::v1::Outcome_Name(outcome);
  if (!name.starts_with(prefix)) return "unspecified";
  name.erase(0, prefix.size());
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name;
}

}  // namespace metrofarm::rpc
