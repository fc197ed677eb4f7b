// Runs leased tasks: decides nothing, knows no clock but the statistics'.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "rpc/leases.h"
#include "rpc/metrics.h"
#include "rpc/open_film.h"
#include "rpc/scene_cache.h"

namespace metrofarm::rpc {

// Tasks to be run, and what goes with them. All belong to one job and one phase.
struct Order {
  const std::vector<farm::v1::Task>& tasks;
  Leases& leases;
  SceneCache::Fetch fetch;
  // Takes reports as they are ready; may block.
  std::function<void(farm::v1::ReportRequest)> report;
  // What segments go to, at once or with those of later orders.
  Receiver receiver;
  // How long to collect them.
  double seal_seconds = 0;
};

class TaskRunner {
 public:
  TaskRunner(SceneCache& scenes, Metrics& metrics, int threads);

  // Returns the tasks that came to nothing: not begun when stop() was called or when the order took
  // much longer than a lease should, lost because their coordinator does not answer, or abandoned,
  // with what was rendered beside them. Where memory runs out the tasks at hand fail, not the
  // worker.
  std::vector<farm::v1::LeaseRef> run(const Order& order);
  // Whether a film is open: it goes on with the next order for the same round, else it is sealed.
  bool collecting() const { return film_ != nullptr; }
  void seal();
  // The leases of an open film are given back elsewhere.
  void drop_film() { film_ = nullptr; }
  // Begins nothing more, for good: what is under way is finished. From any thread.
  void stop() { stopped_ = true; }
  // Whether it is busy with a scene that is not loaded yet.
  bool loading() const { return loading_; }

 private:
  struct Segment;  // one segment to be rendered, and its outcome

  void run_loaded(const Order& order, const LoadedScene& scene);
  std::optional<LoadFault> load(const Order& order, SceneCache::Scene& scene);
  void fail(const Order& order, farm::v1::FailureReason reason, const std::string& message);
  void settle(const Order& order, farm::v1::ReportRequest report);
  farm::v1::ReportRequest run_inspect(const LoadedScene& scene, const farm::v1::Task& task);
  farm::v1::ReportRequest run_bootstrap(const work_unit::Context& context,
                                        const farm::v1::Task& task);
  farm::v1::ReportRequest run_kernel_trials(const work_unit::Context& context,
                                            const farm::v1::Task& task);
  std::vector<Segment> segments_of(const std::vector<farm::v1::Task>& tasks) const;
  void render(const work_unit::Context& context, Segment& segment, const Order& order);
  void run_segment(const work_unit::Context& context, Segment& segment);
  void run_segments(const work_unit::Context& context, std::vector<Segment> segments,
                    const Order& order);
  // Opens a film that can take the first segments of these, unless one is open; returns how many.
  size_t open_film(const film::FilmShape& shape, const Segment* begin, const Segment* end,
                   const Order& order);
  void collect(Segment* begin, Segment* end, const Order& order);
  void out_of_memory();
  void discard_film();
  bool enough(const Order& order) const;

  SceneCache& scenes_;
  Metrics& metrics_;
  int threads_;
  std::atomic<bool> stopped_{false}, loading_{false};
  std::chrono::steady_clock::time_point render_start_;
  std::set<std::string> settled_;  // tasks of this order that were reported or are in the film
  std::unique_ptr<OpenFilm> film_;
};

}  // namespace metrofarm::rpc
