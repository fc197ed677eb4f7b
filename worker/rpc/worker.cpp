#include "rpc/worker.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <thread>

#include "rpc/fleet.h"
#include "rpc/intake.h"
#include "rpc/metrics_server.h"
#include "rpc/outbox.h"
#include "rpc/reports.h"
#include "rpc/task_runner.h"

namespace metrofarm::rpc {

namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

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

size_t segments_in(const std::vector<farm::v1::Task>& tasks) {
  size_t n = 0;
  for (const farm::v1::Task& task : tasks) {
    if (task.has_chains()) n += static_cast<size_t>(task.chains().groups_size());
    if (task.has_paths()) n += task.paths().segment_count();
  }
  return n;
}

// The parts of a worker, and the thread that renders.
class Worker {
 public:
  Worker(const WorkerOptions& options, Log& log)
      : options_(options),
        log_(log),
        metrics_(options.version, options.scenes.isa, options.threads),
        scenes_(options.scenes, metrics_, log),
        runner_(scenes_, metrics_, options.threads),
        intake_(static_cast<uint32_t>(options.threads)),
        outbox_([this](const Link* link) { return fleet_.hopeless(link); }),
        fleet_({options.coordinators,
                options.resolve_seconds,
                options.credentials,
                {options.name, options.version, static_cast<uint32_t>(options.threads),
                 random_instance()},
                options.resolve},
               {log, metrics_, intake_, outbox_, [this] { scenes_.clear(); }}) {}

  ~Worker() {
    intake_.close();
    fetching_.cancel();
    outbox_.close();
    if (renderer_.joinable()) renderer_.join();
  }

  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  int run(const std::function<int()>& stop_requests) {
    std::unique_ptr<MetricsServer> server;
    if (!options_.metrics.empty()) {
      auto started = MetricsServer::start(options_.metrics, metrics_.collectable(),
                                          [this] { return fleet_.connected() > 0; });
      if (!started) {
        log_.error("--metrics: " + started.error().message);
        return 1;
      }
      server = std::move(started.value());
    }
    fleet_.start();
    renderer_ = std::thread([this] { render(); });
    while (stop_requests() == 0 && !fleet_.drain_requested()) std::this_thread::sleep_for(20ms);
    wind_down(stop_requests);
    if (!rendered_) {
      // Its leases are given back already. A scene that is being loaded could not be interrupted.
      log_.warn("left before the work at hand was done");
      std::fflush(nullptr);
      std::_Exit(0);
    }
    return 0;
  }

 private:
  void wind_down(const std::function<int()>& stop_requests) {
    const bool drained = stop_requests() == 0;
    log_.info(drained ? "drained: finishing what is held"
                      : "stopping: finishing what is under way");
    fleet_.stop_leasing();
    for (const Leased& unbegun : intake_.close()) give_back(unbegun);
    auto stop = Clock::now();
    while (!rendered_ || outbox_.size() > 0) {
      std::this_thread::sleep_for(5ms);
      const int requests = stop_requests();
      if (requests > 0) runner_.stop();
      if (requests == 0) stop = Clock::now();  // only drained: as long as it takes
      const std::chrono::duration<double> since = Clock::now() - stop;
      if (requests > 1 || since.count() >= options_.grace_seconds) break;
      // While it loads a scene nothing of value is under way.
      if (requests > 0 && runner_.loading() && outbox_.size() == 0) break;
    }
    fetching_.cancel();
    outbox_.close();
    fleet_.leave();
  }

  void render() {
    while (outbox_.wait_for_room()) {
      const auto leased = runner_.collecting() ? intake_.more(seat_) : intake_.next();
      if (leased) {
        render(*leased);
      } else if (runner_.collecting()) {
        runner_.seal();
      } else {
        break;
      }
    }
    runner_.drop_film();
    rendered_ = true;
  }

  void render(const Leased& leased) {
    Link& link = *leased.from;
    seat_ = leased.seat;
    const auto start = Clock::now();
    const Order order{
        leased.tasks,
        link.leases(),
        [&](const std::string& digest, BundleWriter& writer, std::string& problem) {
          return link.client().fetch_bundle(digest, writer, problem, fetching_);
        },
        [&](farm::v1::ReportRequest report) { outbox_.put(&link, {{std::move(report)}, {}}); },
        receiver(leased.from),
        leased.seal_seconds};
    const std::vector<farm::v1::LeaseRef> left = runner_.run(order);
    const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
    const size_t segments = segments_in(leased.tasks);
    if (segments > left.size())
      link.batch_size().observe(segments - left.size(), seconds,
                                lease_seconds(leased.seal_seconds));
    give_back(link, left);
  }

  // Leases on what was not rendered, or in vain: those that the coordinator still knows.
  void give_back(Link& link, const std::vector<farm::v1::LeaseRef>& left) {
    std::vector<farm::v1::LeaseRef> unused;
    size_t abandoned = 0;
    for (const farm::v1::LeaseRef& ref : left) {
      if (link.leases().abandoned(ref.task_id())) {
        link.leases().forget(ref.task_id());
        ++abandoned;
      } else {
        unused.push_back(ref);
      }
    }
    metrics_.segments_left("abandoned", abandoned);
    metrics_.segments_left("released", unused.size());
    link.give_back(unused);
  }

  // Outlives the order: a film may stay open for later ones.
  Receiver receiver(const std::shared_ptr<Link>& link) {
    return {
        link.get(),
        [this, link](Batch batch) {
          TaskResults results;
          results.batches.push_back(std::move(batch));
          outbox_.put(link.get(), std::move(results));
        },
        [this, link](const std::vector<farm::v1::LeaseRef>& leases) { give_back(*link, leases); }};
  }

  void give_back(const Leased& leased) {
    std::vector<farm::v1::LeaseRef> refs;
    for (const farm::v1::Task& task : leased.tasks) fill_lease(task, refs.emplace_back());
    metrics_.segments_left("released", refs.size());
    leased.from->give_back(refs);
  }

  const WorkerOptions& options_;
  Log& log_;
  Metrics metrics_;
  SceneCache scenes_;
  TaskRunner runner_;
  Intake intake_;
  Outbox outbox_;
  Fleet fleet_;
  Cancellation fetching_;
  Intake::Seat seat_ = 0;  // of the coordinator that gave work last
  std::atomic<bool> rendered_{false};
  std::thread renderer_;
};

}  // namespace

int run_worker(const WorkerOptions& options, Log& log, const std::function<int()>& stop_requests) {
  Worker worker(options, log);
  return worker.run(stop_requests);
}

}  // namespace metrofarm::rpc
