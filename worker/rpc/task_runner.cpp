#include "rpc/task_runner.h"

#include <algorithm>

#include "base/parallel.h"
#include "rpc/reports.h"

namespace metrofarm::rpc {

using farm::v1::Task;
using work_unit::Context;

namespace {

// A film's largest splat is under 2^4 units in 2^32 steps; so many mutations stay below 2^62.
constexpr uint64_t kMutationsPerFilm = uint64_t{1} << 26;

}  // namespace

struct TaskRunner::Segment {
  const Task* task = nullptr;
  uint32_t number = 0;
  uint32_t round = 0;
  const farm::v1::ChainGroupState* chains = nullptr;  // null: independent paths
  uint64_t size = 0;                                  // mutations per chain or samples per pixel
  work_unit::SampleRange samples;                     // independent paths

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
  } else if (first.has_kernel_trials()) {
    for (const Task& task : tasks) run_kernel_trials(context, task, results);
  } else {
    run_segments(context, segments_of(tasks), results);
  }
  return results;
}

namespace {

work_unit::SampleRange direct_samples(const Task& task) {
  const auto round = static_cast<int>(task.chains().round());
  const bool apart = round < task.spec().direct_sizes_size();
  return {task.chains().direct_first_sample(), apart ? task.spec().direct_sizes(round) : 0};
}

}  // namespace

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
      s.samples = direct_samples(task);
      for (const auto& group : task.chains().groups()) {
        s.number = group.group();
        s.chains = &group;
        segments.push_back(s);
      }
    } else if (task.has_paths()) {
      s.round = task.paths().round();
      s.size = size_of(s.round);
      s.samples = {task.paths().first_sample(), s.size};
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
    s.output = work_unit::run_path_segment(context, s.number, s.samples, film);
  } else {
    const bool fresh = s.chains->state().empty();
    auto state = fresh ? work_unit::start_chains(context, seeds_of(*s.chains))
                       : work_unit::parse_group_state(s.chains->state());
    if (!state) {
      s.failure = state.error().message;
      return;
    }
    s.group = {s.number, std::move(state.value())};
    s.output = work_unit::run_chain_segment(context, s.group, s.size, film);
    if (context.spec().direct_apart)
      s.output.add(work_unit::run_direct_segment(context, s.number, s.samples, film));
  }
  s.cpu_seconds = thread_cpu_seconds() - start;
  s.done = true;
}

namespace {

void fill_sums(const work_unit::ChainGroup& group, farm::v1::SegmentResult& result) {
  for (const metropolis::LargeStepSums& sums : work_unit::large_step_sums(group.state)) {
    farm::v1::LargeStepSums& out = *result.add_large_step_sums();
    out.set_count(sums.count);
    out.set_sum(sums.sum);
    out.set_sum_squares(sums.sum_squares);
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
