// Runs leased tasks: decides nothing, knows no clock but the statistics'.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "rpc/batch.h"
#include "rpc/bundle_cache.h"
#include "rpc/leases.h"

namespace metrofarm::rpc {

// What came of the tasks of one lease answer.
struct TaskResults {
  std::vector<farm::v1::ReportRequest> reports;
  std::vector<Batch> batches;
};

class TaskRunner {
 public:
  TaskRunner(SceneCache& scenes, Leases& leases, int threads);

  // All tasks belong to one job and one phase.
  TaskResults run(const std::vector<farm::v1::Task>& tasks);

 private:
  struct Segment;  // one segment to be rendered, and its outcome

  TaskResults fail_all(const std::vector<farm::v1::Task>& tasks, farm::v1::FailureReason reason,
                       const std::string& message);
  void run_bootstrap(const work_unit::Context& context, const farm::v1::Task& task,
                     TaskResults& results);
  void run_kernel_trials(const work_unit::Context& context, const farm::v1::Task& task,
                         TaskResults& results);
  std::vector<Segment> segments_of(const std::vector<farm::v1::Task>& tasks) const;
  void render(const work_unit::Context& context, film::Film& film, Segment& segment);
  void run_segments(const work_unit::Context& context, std::vector<Segment> segments,
                    TaskResults& results);

  SceneCache& scenes_;
  Leases& leases_;
  int threads_;
};

}  // namespace metrofarm::rpc
