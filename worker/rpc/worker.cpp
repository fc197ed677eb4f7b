#include "rpc/worker.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <deque>
#include <random>
#include <thread>

#include "rpc/task_runner.h"

namespace metrofarm::rpc {

namespace {

using Clock = std::chrono::steady_clock;

// A batch should take about this long: long enough to be worth a film, short enough to lose.
constexpr double kBatchSeconds = 1.5;
constexpr double kLeaseWaitSeconds = 5;
constexpr size_t kDeliveriesInFlight = 2;

// Identity only; no image depends on it.
std::string random_instance() {
  std::random_device device;
  std::string out;
  char word[9];
  for (int i = 0; i < 4; ++i) {
    std::snprintf(word, sizeof word, "%08x", device());
    out += word;
  }
  return out;
}

// Sends results in the background while the next tasks run; at most two wait.
class Courier {
 public:
  Courier(FarmClient& client, Leases& leases, SceneCache& scenes)
      : client_(client), leases_(leases), scenes_(scenes), thread_([this] { work(); }) {}

  ~Courier() {
    {
      const std::lock_guard lock(mutex_);
      closing_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  void send(TaskResults results) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return queue_.size() < kDeliveriesInFlight; });
    queue_.push_back(std::move(results));
    changed_.notify_all();
  }

 private:
  void work() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return closing_ || !queue_.empty(); });
      if (queue_.empty()) return;
      // Stays in the queue while it is sent, so that it counts as in flight.
      TaskResults& results = queue_.front();
      lock.unlock();
      deliver(results);
      lock.lock();
      queue_.pop_front();
      changed_.notify_all();
    }
  }

  void deliver(const TaskResults& results) {
    for (const farm::v1::ReportRequest& report : results.reports) {
      farm::v1::ReportResponse response;
      if (client_.report(report, response)) note(response.outcome(), response.message());
      leases_.release(report.lease().task_id());
    }
    for (const Batch& batch : results.batches) {
      farm::v1::DeliverResponse response;
      if (client_.deliver(batch, response)) note(response.outcome(), response.message());
      for (const auto& segment : batch.header.segments())
        leases_.release(segment.lease().task_id());
    }
  }

  void note(farm::v1::Outcome outcome, const std::string& message) {
    if (outcome == farm::v1::OUTCOME_CONFLICT) scenes_.clear();
    if (outcome == farm::v1::OUTCOME_CONFLICT || outcome == farm::v1::OUTCOME_REJECTED)
      std::fprintf(stderr, "metrofarm-worker: result refused: %s\n", message.c_str());
  }

  FarmClient& client_;
  Leases& leases_;
  SceneCache& scenes_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<TaskResults> queue_;
  bool closing_ = false;
  std::thread thread_;
};

// How many segments to ask for, from how long the last ones took. Scheduling only: the image does
// not depend on it.
class BatchSize {
 public:
  explicit BatchSize(int threads) : threads_(threads), segments_(static_cast<uint32_t>(threads)) {}

  uint32_t segments() const { return segments_; }
  void observe(size_t segments, double seconds) {
    const double ideal = kBatchSeconds * double(segments) / std::max(seconds, 1e-3);
    // At most double at once: a quick first answer may be a cheap corner of the image.
    const double next = std::min(ideal, 2.0 * segments_);
    segments_ = static_cast<uint32_t>(std::clamp(next, double(threads_), 4096.0));
  }

 private:
  int threads_;
  uint32_t segments_;
};

size_t segments_in(const std::vector<farm::v1::Task>& tasks) {
  size_t n = 0;
  for (const farm::v1::Task& task : tasks) {
    if (task.has_chains()) n += static_cast<size_t>(task.chains().groups_size());
    if (task.has_paths()) n += task.paths().segment_count();
  }
  return n;
}

void run_tasks(const std::vector<farm::v1::Task>& tasks, TaskRunner& runner, Leases& leases,
               Courier& courier, BatchSize& size) {
  for (const farm::v1::Task& task : tasks) leases.hold(task);
  const auto start = Clock::now();
  TaskResults results = runner.run(tasks);
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  if (const size_t segments = segments_in(tasks); segments > 0) size.observe(segments, seconds);
  // Abandoned tasks bring nothing back.
  for (const farm::v1::Task& task : tasks)
    if (leases.abandoned(task.task_id())) leases.release(task.task_id());
  courier.send(std::move(results));
}

}  // namespace

int run_worker(const WorkerOptions& options, const std::function<bool()>& stop_requested) {
  FarmClient client(
      options.coordinator,
      {options.name, options.version, static_cast<uint32_t>(options.threads), random_instance()});
  std::jthread watcher([&](const std::stop_token& done) {
    while (!done.stop_requested() && !stop_requested())
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    // Idle calls end at once; a delivery under way still gets through before connections close.
    if (stop_requested()) client.stop();
  });
  if (!client.connect()) return 0;
  SceneCache scenes(options.cache, options.isa, [&](const std::string& digest, BundleWriter& w) {
    return client.fetch_bundle(digest, w);
  });
  Leases leases(client);
  TaskRunner runner(scenes, leases, options.threads);
  BatchSize size(options.threads);
  {
    Courier courier(client, leases, scenes);
    while (!stop_requested() && !leases.drain_requested()) {
      farm::v1::LeaseResponse response;
      if (!client.lease(size.segments(), kLeaseWaitSeconds, response)) {
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        continue;
      }
      const std::vector<farm::v1::Task> tasks(response.tasks().begin(), response.tasks().end());
      if (!tasks.empty()) run_tasks(tasks, runner, leases, courier, size);
      if (response.drain()) break;
    }
  }
  return 0;
}

}  // namespace metrofarm::rpc
