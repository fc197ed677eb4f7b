#include "rpc/task_runner.h"

#include <algorithm>
#include <new>
#include <stdexcept>

#include "base/parallel.h"
#include "rpc/batch_size.h"
#include "rpc/checksum.h"
#include "rpc/reports.h"

namespace metrofarm::rpc {

using farm::v1::Task;
using work_unit::Context;

namespace {

constexpr char kNoMemory[] = "the worker's memory does not suffice for this task";

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

TaskRunner::TaskRunner(SceneCache& scenes, Metrics& metrics, int threads)
    : scenes_(scenes), metrics_(metrics), threads_(threads) {}

void TaskRunner::settle(const Order& order, farm::v1::ReportRequest report) {
  settled_.insert(report.lease().task_id());
  if (report.has_failure()) metrics_.segments_left("failed", 1);
  order.report(std::move(report));
}

// Fails what has no result yet.
void TaskRunner::fail(const Order& order, farm::v1::FailureReason reason,
                      const std::string& message) {
  for (const Task& task : order.tasks)
    if (!settled_.contains(task.task_id())) settle(order, failure_report(task, reason, message));
}

std::vector<farm::v1::LeaseRef> TaskRunner::run(const Order& order) {
  settled_.clear();
  try {
    SceneCache::Scene scene;
    const auto fault = load(order, scene);
    if (!fault) {
      run_loaded(order, *scene);
    } else if (fault->kind != LoadFault::Kind::kAway) {
      const bool scene_is_bad = fault->kind == LoadFault::Kind::kScene;
      fail(order, scene_is_bad ? farm::v1::FAILURE_REASON_SCENE : farm::v1::FAILURE_REASON_WORKER,
           fault->message);
    }
  } catch (const std::bad_alloc&) {
    out_of_memory();
    fail(order, farm::v1::FAILURE_REASON_WORKER, kNoMemory);
  } catch (const std::length_error&) {  // the standard library's word for absurd sizes
    out_of_memory();
    fail(order, farm::v1::FAILURE_REASON_WORKER, kNoMemory);
  }
  std::vector<farm::v1::LeaseRef> left;
  for (const Task& task : order.tasks) {
    if (settled_.contains(task.task_id())) continue;
    fill_lease(task, left.emplace_back());
  }
  return left;
}

// What was rendered in part is in the film.
void TaskRunner::out_of_memory() {
  loading_ = false;
  scenes_.clear();
  discard_film();
}

void TaskRunner::discard_film() {
  if (const auto film = std::move(film_)) film->discard();
}

void TaskRunner::seal() {
  if (const auto film = std::move(film_)) film->seal(threads_);
}

std::optional<LoadFault> TaskRunner::load(const Order& order, SceneCache::Scene& scene) {
  if (stopped_) return LoadFault{LoadFault::Kind::kAway};
  const Task& first = order.tasks.front();
  order.leases.set_activity("loading the scene");
  loading_ = true;
  const auto progress = [&](double fraction, std::string_view what) {
    order.leases.set_activity(std::string(what));
    order.leases.set_fraction(first.task_id(), fraction);
  };
  auto fault = scenes_.get(first.scene(), order.fetch, progress, scene);
  loading_ = false;
  return fault;
}

void TaskRunner::run_loaded(const Order& order, const LoadedScene& scene) {
  const Task& first = order.tasks.front();
  if (first.has_inspect()) return settle(order, run_inspect(scene, first));
  order.leases.set_activity("rendering");
  const auto spec = to_spec(first.spec(), scene.scene().description());
  if (!spec) return fail(order, farm::v1::FAILURE_REASON_WORKER, spec.error().to_string());
  std::shared_ptr<const transport::Scene> at_that_time;
  if (auto fault = scenes_.during(scene, work_unit::interval_of(spec.value()), at_that_time))
    return fail(order, farm::v1::FAILURE_REASON_WORKER, fault->message);
  const Context context(*at_that_time, spec.value());
  if (!first.has_bootstrap() && !first.has_kernel_trials())
    return run_segments(context, segments_of(order.tasks), order);
  for (const Task& task : order.tasks) {
    if (stopped_) return;
    settle(order,
           task.has_bootstrap() ? run_bootstrap(context, task) : run_kernel_trials(context, task));
  }
}

farm::v1::ReportRequest TaskRunner::run_inspect(const LoadedScene& scene, const Task& task) {
  farm::v1::ReportRequest report;
  fill_lease(task, *report.mutable_lease());
  *report.mutable_scene() = to_report(scene.scene(), scene.times);
  return report;
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

// Work that was begun and is wanted is finished; what was not begun is left to others after much
// longer than a lease should take.
bool TaskRunner::enough(const Order& order) const {
  const std::chrono::duration<double> time = std::chrono::steady_clock::now() - render_start_;
  return stopped_ || time.count() > 4 * lease_seconds(order.seal_seconds);
}

void TaskRunner::render(const Context& context, Segment& s, const Order& order) {
  const std::string& task = s.task->task_id();
  if (enough(order) || order.leases.abandoned(task) || film_->spoiled().stop_requested()) return;
  const std::stop_callback spoil(order.leases.interruption(task), [this] { film_->spoil(); });
  const BusyThread busy(metrics_);
  const double start = thread_cpu_seconds();
  run_segment(context, s);
  s.cpu_seconds = thread_cpu_seconds() - start;
  metrics_.rendered(s.output.counts.mutations, s.output.counts.rays, s.cpu_seconds);
}

void TaskRunner::run_segment(const Context& context, Segment& s) {
  film::Film& film = film_->film();
  const std::stop_token stop = film_->spoiled();
  if (s.chains == nullptr) {
    s.output = work_unit::run_path_segment(context, s.number, s.samples, film, stop);
  } else {
    const bool fresh = s.chains->state().empty();
    auto state = fresh ? work_unit::start_chains(context, seeds_of(*s.chains))
                       : work_unit::parse_group_state(s.chains->state());
    if (!state) {
      s.failure = state.error().message;
      return;
    }
    s.group = {s.number, std::move(state.value())};
    s.output = work_unit::run_chain_segment(context, s.group, s.size, film, stop);
    if (context.spec().direct_apart)
      s.output.add(work_unit::run_direct_segment(context, s.number, s.samples, film, stop));
  }
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

size_t TaskRunner::open_film(const film::FilmShape& shape, const Segment* begin, const Segment* end,
                             const Order& order) {
  const std::string& job = begin->task->job_id();
  if (film_ && !film_->is_for(shape, job, begin->round, order.receiver.coordinator)) seal();
  for (;;) {
    if (!film_) film_ = std::make_unique<OpenFilm>(shape, job, begin->round, order.receiver);
    const Segment* next = begin;
    while (next != end && next->round == begin->round &&
           film_->reserve(next->size * work_unit::kGroupSize))
      ++next;
    if (next != begin) return static_cast<size_t>(next - begin);
    seal();  // full; a fresh one takes any segment
  }
}

void TaskRunner::run_segments(const Context& context, std::vector<Segment> segments,
                              const Order& order) {
  render_start_ = std::chrono::steady_clock::now();
  Segment* const end = segments.data() + segments.size();
  for (Segment* begin = segments.data();
       begin != end && (begin == segments.data() || !enough(order));) {
    const size_t count = open_film(context.film_shape(), begin, end, order);
    parallel_for(count, threads_, [&](size_t i, int) { render(context, begin[i], order); });
    if (film_->spoiled().stop_requested()) return discard_film();
    collect(begin, begin + count, order);
    begin += count;
  }
  const std::chrono::duration<double> time = std::chrono::steady_clock::now() - render_start_;
  if (film_ && film_->due(order.seal_seconds, time.count())) seal();
}

void TaskRunner::collect(Segment* begin, Segment* end, const Order& order) {
  for (Segment* s = begin; s != end; ++s) {
    if (!s->failure.empty())
      settle(order, failure_report(*s->task, farm::v1::FAILURE_REASON_REPLAY, s->failure));
    if (!s->done) continue;
    settled_.insert(s->task->task_id());
    farm::v1::SegmentResult& result = film_->add_segment(s->cpu_seconds);
    result.set_segment(s->number);
    fill_lease(*s->task, *result.mutable_lease());
    result.set_digest(s->output.digest);
    fill_counts(s->output, *result.mutable_counts());
    film_->add_anomalies(s->output.anomalies);
    if (s->chains != nullptr) {
      result.set_state(work_unit::serialize(s->group.state));
      fill_sums(s->group, result);
    }
    result.set_checksum(checksum(result));
  }
}

}  // namespace metrofarm::rpc
