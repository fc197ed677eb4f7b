// The tasks that come before rendering: independent samples, and trials of kernels.
#include <algorithm>

#include "base/parallel.h"
#include "rpc/reports.h"
#include "rpc/task_runner.h"

namespace metrofarm::rpc {

using farm::v1::Task;
using work_unit::Context;

namespace {

void add_map(const std::vector<double>& map, google::protobuf::RepeatedField<double>& sums) {
  if (sums.empty()) sums.Resize(static_cast<int>(map.size()), 0);
  for (size_t i = 0; i < map.size(); ++i) sums[static_cast<int>(i)] += map[i];
}

}  // namespace

farm::v1::ReportRequest TaskRunner::run_bootstrap(const Context& context, const Task& task) {
  const farm::v1::BootstrapTask& range = task.bootstrap();
  if (range.first_index() % kLanes != 0 || range.count() % kLanes != 0 || range.count() > 65536) {
    return failure_report(task, farm::v1::FAILURE_REASON_WORKER,
                          "bootstrap range is not made of whole packs");
  }
  constexpr uint32_t kChunk = 512;
  const size_t chunks = (range.count() + kChunk - 1) / kChunk;
  std::vector<work_unit::BootstrapOutput> outputs(chunks);
  std::vector<double> cpu(chunks);
  parallel_for(chunks, threads_, [&](size_t i, int) {
    const BusyThread busy(metrics_);
    const double start = thread_cpu_seconds();
    const auto offset = static_cast<uint32_t>(i * kChunk);
    outputs[i] =
        work_unit::run_bootstrap(context, range.first_index() + offset,
                                 std::min(kChunk, range.count() - offset), range.wants_map());
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
    if (range.wants_map()) add_map(outputs[i].map, *result.mutable_map());
  }
  for (uint64_t n : anomalies.counts()) result.add_anomaly_counts(n);
  for (const auto& sample : anomalies.samples()) fill_anomaly(sample, *result.add_anomalies());
  metrics_.rendered(0, result.rays(), result.cpu_seconds());
  return report;
}

farm::v1::ReportRequest TaskRunner::run_kernel_trials(const Context& context, const Task& task) {
  constexpr uint64_t kMostMutations = 65536;
  const farm::v1::KernelTrialsTask& work = task.kernel_trials();
  std::vector<Result<work_unit::SegmentOutput>> outputs(work.kernels_size(), Error{"not tried"});
  std::vector<double> cpu(outputs.size());
  parallel_for(outputs.size(), threads_, [&](size_t i, int) {
    const BusyThread busy(metrics_);
    const double start = thread_cpu_seconds();
    const auto kernel = to_kernel(work.kernels(static_cast<int>(i)));
    if (!kernel) {
      outputs[i] = kernel.error();
    } else {
      outputs[i] = work_unit::try_kernel(context, kernel.value(), seeds_of(work.group()),
                                         std::min(work.mutations(), kMostMutations));
    }
    cpu[i] = thread_cpu_seconds() - start;
  });
  farm::v1::ReportRequest report;
  fill_lease(task, *report.mutable_lease());
  farm::v1::KernelTrialsResult& result = *report.mutable_kernel_trials();
  for (size_t i = 0; i < outputs.size(); ++i) {
    if (!outputs[i])
      return failure_report(task, farm::v1::FAILURE_REASON_REPLAY, outputs[i].error().message);
    fill_counts(outputs[i].value(), *result.add_trials());
    result.set_cpu_seconds(result.cpu_seconds() + cpu[i]);
    metrics_.rendered(outputs[i].value().counts.mutations, outputs[i].value().counts.rays, cpu[i]);
  }
  return report;
}

}  // namespace metrofarm::rpc
