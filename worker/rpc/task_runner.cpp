#include "rpc/task_runner.h"

#include <ctime>

#include <algorithm>
#include <mutex>

#include "base/parallel.h"

namespace metrofarm::rpc {

using farm::v1::Task;
using work_unit::Context;

namespace {

double thread_cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

void fill_lease(const Task& task, farm::v1::LeaseRef& lease) {
  lease.set_task_id(task.task_id());
  lease.set_epoch(task.epoch());
}

farm::v1::ReportRequest failure_report(const Task& task, farm::v1::FailureReason reason,
                                       const std::string& message) {
  farm::v1::ReportRequest report;
  fill_lease(task, *report.mutable_lease());
  report.mutable_failure()->set_reason(reason);
  report.mutable_failure()->set_message(message);
  return report;
}

// A film's largest splat is under 2^4 units in 2^32 steps; so many mutations stay below 2^62.
constexpr uint64_t kMutationsPerFilm = uint64_t{1} << 26;

}  // namespace

struct TaskRunner::Segment {
  const Task* task = nullptr;
  uint32_t number = 0;
  uint32_t round = 0;
  const farm::v1::ChainGroupState* chains = nullptr;  // null: independent paths
  uint64_t size = 0;                                  // mutations per chain or samples per pixel
  uint64_t first_sample = 0;                          // independent paths

  bool done = false;
  std::string failure;
  work_unit::SegmentOutput output;
  work_unit::ChainGroup group;
  double cpu_seconds = 0;
};

TaskRunner::TaskRunner(SceneCache& scenes, Leases& leases, int threads)
    : scenes_(scenes), leases_(leases), threads_(threads) {}

TaskResults TaskRunner::fail_all(const std::vector<Task>& tasks, farm::v1::FailureReason reason,
                                 const std::string& message) {
  TaskResults results;
  for (const Task& task : tasks) results.reports.push_back(failure_report(task, reason, message));
  return results;
}

TaskResults TaskRunner::run(const std::vector<Task>& tasks) {
  const Task& first = tasks.front();
  leases_.set_activity("loading the scene");
  const auto loaded = scenes_.get(first.scene(), [&](double fraction, std::string_view what) {
    leases_.set_activity(std::string(what));
    leases_.set_fraction(first.task_id(), fraction);
  });
  if (!loaded) return fail_all(tasks, farm::v1::FAILURE_REASON_SCENE, loaded.error().to_string());
  const LoadedScene& scene = *loaded.value();

  TaskResults results;
  if (first.has_inspect()) {
    farm::v1::ReportRequest report;
    fill_lease(first, *report.mutable_lease());
    *report.mutable_scene() = to_report(*scene.scene, scene.times);
    results.reports.push_back(std::move(report));
    return results;
  }
  leases_.set_activity("rendering");
  const auto spec = to_spec(first.spec(), scene.scene->description());
  if (!spec) return fail_all(tasks, farm::v1::FAILURE_REASON_WORKER, spec.error().to_string());
  const Context context(*scene.scene, spec.value());
  if (first.has_bootstrap()) {
    for (const Task& task : tasks) run_bootstrap(context, task, results);
  } else {
    run_segments(context, segments_of(tasks), results);
  }
  return results;
}

void TaskRunner::run_bootstrap(const Context& context, const Task& task, TaskResults& results) {
  const farm::v1::BootstrapTask& range = task.bootstrap();
  if (range.first_index() % kLanes != 0 || range.count() % kLanes != 0 || range.count() > 65536) {
    results.reports.push_back(failure_report(task, farm::v1::FAILURE_REASON_WORKER,
                                             "bootstrap range is not made of whole packs"));
    return;
  }
  constexpr uint32_t kChunk = 512;
  const size_t chunks = (range.count() + kChunk - 1) / kChunk;
  std::vector<work_unit::BootstrapOutput> outputs(chunks);
  std::vector<double> cpu(chunks);
  parallel_for(chunks, threads_, [&](size_t i, int) {
    const double start = thread_cpu_seconds();
    const auto offset = static_cast<uint32_t>(i * kChunk);
    outputs[i] = work_unit::run_bootstrap(context, range.first_index() + offset,
                                          std::min(kChunk, range.count() - offset));
    cpu[i] = thread_cpu_seconds() - start;
  });

  farm::v1::ReportRequest report;
  fill_lease(task, *report.mutable_lease());
  farm::v1::BootstrapResult& result = *report.mutable_bootstrap();
  result.set_first_index(range.first_index());
  diagnostics::AnomalyLog anomalies;
  for (size_t i = 0; i < chunks; ++i) {
    for (float f : outputs[i].values) result.add_values(f);
    result.set_rays(result.rays() + outputs[i].rays);
    result.set_cpu_seconds(result.cpu_seconds() + cpu[i]);
    anomalies.merge(outputs[i].anomalies);
  }
  for (uint64_t n : anomalies.counts()) result.add_anomaly_counts(n);
  for (const auto& sample : anomalies.samples()) fill_anomaly(sample, *result.add_anomalies());
  results.reports.push_back(std::move(report));
}

std::vector<TaskRunner::Segment> TaskRunner::segments_of(const std::vector<Task>& tasks) const {
  std::vector<Segment> segments;
  for (const Task& task : tasks) {
    const auto size_of = [&](uint32_t round) {
      const auto rounds = static_cast<uint32_t>(task.spec().round_sizes_size());
      return round < rounds ? task.spec().round_sizes(static_cast<int>(round)) : 0;
    };
    Segment s;
    s.task = &task;
    if (task.has_chains()) {
      s.round = task.chains().round();
      s.size = size_of(s.round);
      for (const auto& group : task.chains().groups()) {
        s.number = group.group();
        s.chains = &group;
        segments.push_back(s);
      }
    } else if (task.has_paths()) {
      s.round = task.paths().round();
      s.size = size_of(s.round);
      s.first_sample = task.paths().first_sample();
      for (uint32_t i = 0; i < task.paths().segment_count(); ++i) {
        s.number = task.paths().first_segment() + i;
        segments.push_back(s);
      }
    }
  }
  return segments;
}

void TaskRunner::render(const Context& context, film::Film& film, Segment& s) {
  if (leases_.abandoned(s.task->task_id())) return;
  const double start = thread_cpu_seconds();
  if (s.chains == nullptr) {
    s.output = work_unit::run_path_segment(context, {s.number, s.first_sample, s.size}, film);
  } else {
    const bool fresh = s.chains->state().empty();
    auto state =
        fresh ? work_unit::start_chains(
                    context, {{s.chains->seed_indices().begin(), s.chains->seed_indices().end()},
                              {s.chains->seed_values().begin(), s.chains->seed_values().end()}})
              : work_unit::parse_group_state(s.chains->state());
    if (!state) {
      s.failure = state.error().message;
      return;
    }
    s.group = {s.number, std::move(state.value())};
    s.output = work_unit::run_chain_segment(context, s.group, s.size, film);
  }
  s.cpu_seconds = thread_cpu_seconds() - start;
  s.done = true;
}

namespace {

void fill_sums(const work_unit::ChainGroup& group, farm::v1::SegmentResult& result) {
  for (const work_unit::PackState& pack : group.state) {
    for (const metropolis::LargeStepSums& sums : pack.chains.sums) {
      farm::v1::LargeStepSums& out = *result.add_large_step_sums();
      out.set_count(sums.count);
      out.set_sum(sums.sum);
      out.set_sum_squares(sums.sum_squares);
    }
  }
}

}  // namespace

void TaskRunner::run_segments(const Context& context, std::vector<Segment> segments,
                              TaskResults& results) {
  size_t begin = 0;
  while (begin < segments.size()) {
    // As many segments of one round as a film can hold without overflow.
    size_t end = begin;
    uint64_t mutations = 0;
    do {
      mutations += segments[end].size * work_unit::kGroupSize;
      ++end;
    } while (end < segments.size() && segments[end].round == segments[begin].round &&
             mutations + segments[end].size * work_unit::kGroupSize < kMutationsPerFilm);

    film::Film film(context.film_shape());
    parallel_for(end - begin, threads_,
                 [&](size_t i, int) { render(context, film, segments[begin + i]); });
    farm::v1::BatchHeader header;
    header.set_job_id(segments[begin].task->job_id());
    header.set_round(segments[begin].round);
    diagnostics::AnomalyLog anomalies;
    for (size_t i = begin; i < end; ++i) {
      const Segment& s = segments[i];
      if (!s.failure.empty())
        results.reports.push_back(
            failure_report(*s.task, farm::v1::FAILURE_REASON_REPLAY, s.failure));
      if (!s.done) continue;
      farm::v1::SegmentResult& result = *header.add_segments();
      result.set_segment(s.number);
      fill_lease(*s.task, *result.mutable_lease());
      result.set_digest(s.output.digest);
      fill_counts(s.output, *result.mutable_counts());
      header.set_cpu_seconds(header.cpu_seconds() + s.cpu_seconds);
      anomalies.merge(s.output.anomalies);
      if (s.chains == nullptr) continue;
      result.set_state(work_unit::serialize(s.group.state));
      fill_sums(s.group, result);
    }
    for (const auto& sample : anomalies.samples()) fill_anomaly(sample, *header.add_anomalies());
    if (header.segments_size() > 0)
      results.batches.push_back(seal(std::move(header), film, threads_));
    begin = end;
  }
}

}  // namespace metrofarm::rpc
