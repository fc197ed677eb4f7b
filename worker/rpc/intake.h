// Shares the asking for work between coordinators.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "metrofarm/farm/v1/task.pb.h"

namespace metrofarm::rpc {

class Link;

// Tasks of one lease answer, and who gave them.
struct Leased {
  std::shared_ptr<Link> from = nullptr;
  std::vector<farm::v1::Task> tasks = {};
  double seal_seconds = 0;  // how long to collect before delivering
  uint64_t seat = 0;        // filled in by the intake
};

// One lease call that a coordinator's thread is to make.
struct Turn {
  uint32_t max_segments = 1;
  double wait_seconds = 0;
};

// Decides which coordinator is asked for how much, so that all of them are served alike and the
// worker never holds much more than it renders at once:
// - nobody is asked while the worker renders;
// - then they are asked in turn for a whole batch without waiting, whoever was served longest ago
//   first, until one has work; one that is slow to answer is passed over;
// - if none has any, all of them are asked at once, waiting, for one segment per thread: whatever
//   comes of that is rendered soon.
// A single coordinator is asked for a whole batch and waited for. Thread-safe.
class Intake {
 public:
  using Seat = uint64_t;

  explicit Intake(uint32_t threads) : threads_(threads) {}

  // A coordinator that can be asked takes a seat, and leaves it when it is away. In any order.
  Seat join();
  void leave(Seat seat);

  // Waits until the coordinator of this seat is to be asked, for `batch` segments if it is for a
  // whole batch; nothing when closed. Every turn must be followed by answer() or leave().
  std::optional<Turn> await_turn(Seat seat, uint32_t batch);
  // What it had: perhaps no tasks. False: closed meanwhile, the tasks are not taken.
  bool answer(Seat seat, Leased leased);

  // For the rendering thread: waits for work; nothing when closed.
  std::optional<Leased> next();
  // The same for more work from the coordinator of this seat, which alone is asked: nothing where
  // it has none, or does not say so soon.
  std::optional<Leased> more(Seat seat);
  // Ends all waiting; returns the work that nobody has begun.
  std::vector<Leased> close();

 private:
  using Clock = std::chrono::steady_clock;
  struct State {
    bool asking = false, waiting = false;  // waiting: with a long call
    bool had_none = false;                 // when asked last, since the worker became idle
    uint64_t served = 0;
    Clock::time_point asked_at = {};
  };

  std::optional<Leased> take();
  std::optional<Turn> turn_of(Seat seat, uint32_t batch) const;
  bool passed_over(const State& state) const;

  const uint32_t threads_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<Seat, State> seats_;
  std::deque<Leased> queue_;
  bool idle_ = false;  // the rendering thread waits
  Seat only_ = 0;      // for this one, if not 0
  bool closed_ = false;
  Seat last_seat_ = 0;
  uint64_t last_served_ = 0;
};

}  // namespace metrofarm::rpc
