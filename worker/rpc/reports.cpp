#include "rpc/reports.h"

#include <ctime>

namespace metrofarm::rpc {

using farm::v1::Task;

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

work_unit::ChainSeeds seeds_of(const farm::v1::ChainGroupState& group) {
  return {{group.seed_indices().begin(), group.seed_indices().end()},
          {group.seed_values().begin(), group.seed_values().end()}};
}

}  // namespace metrofarm::rpc
