#include "rpc/intake.h"

#include <algorithm>
#include <utility>

namespace metrofarm::rpc {

namespace {

using namespace std::chrono_literals;

constexpr double kLongCallSeconds = 5;
// One that takes longer to say what it has is not waited for.
constexpr auto kPatience = 250ms;

}  // namespace

Intake::Seat Intake::join() {
  const std::lock_guard lock(mutex_);
  seats_[++last_seat_];
  changed_.notify_all();
  return last_seat_;
}

void Intake::leave(Seat seat) {
  const std::lock_guard lock(mutex_);
  seats_.erase(seat);
  changed_.notify_all();
}

bool Intake::passed_over(const State& s) const {
  return s.had_none || (s.asking && (s.waiting || Clock::now() - s.asked_at >= kPatience));
}

// Requires: mutex_.
std::optional<Turn> Intake::turn_of(Seat seat, uint32_t batch) const {
  const auto it = seats_.find(seat);
  if (!idle_ || !queue_.empty() || it == seats_.end()) return std::nullopt;
  const State& mine = it->second;
  if (only_ != 0) {
    if (only_ != seat || mine.had_none) return std::nullopt;
    return Turn{batch, 0};
  }
  if (seats_.size() == 1) return Turn{batch, kLongCallSeconds};
  for (const auto& [other_seat, other] : seats_) {
    if (other_seat == seat || passed_over(other)) continue;
    if (other.asking || mine.had_none) return std::nullopt;
    if (std::pair(other.served, other_seat) < std::pair(mine.served, seat)) return std::nullopt;
  }
  return mine.had_none ? Turn{threads_, kLongCallSeconds} : Turn{batch, 0};
}

std::optional<Turn> Intake::await_turn(Seat seat, uint32_t batch) {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (closed_) return std::nullopt;
    if (const auto turn = turn_of(seat, batch)) {
      State& mine = seats_[seat];
      mine.asking = true;
      mine.waiting = turn->wait_seconds > 0;
      mine.asked_at = Clock::now();
      return turn;
    }
    // Patience ends by itself while others are asked; nothing else does.
    if (idle_) {
      changed_.wait_for(lock, kPatience);
    } else {
      changed_.wait(lock);
    }
  }
}

bool Intake::answer(Seat seat, Leased leased) {
  const std::lock_guard lock(mutex_);
  const auto it = seats_.find(seat);
  if (it != seats_.end()) {
    it->second.asking = it->second.waiting = false;
    it->second.had_none = leased.tasks.empty();
    if (!leased.tasks.empty()) it->second.served = ++last_served_;
  }
  changed_.notify_all();
  if (leased.tasks.empty()) return true;
  if (closed_) return false;
  leased.seat = seat;
  queue_.push_back(std::move(leased));
  return true;
}

std::optional<Leased> Intake::next() {
  std::unique_lock lock(mutex_);
  if (queue_.empty()) {
    idle_ = true;
    for (auto& [seat, state] : seats_) state.had_none = false;
    changed_.notify_all();
    changed_.wait(lock, [&] { return closed_ || !queue_.empty(); });
    idle_ = false;
  }
  return take();
}

std::optional<Leased> Intake::more(Seat seat) {
  std::unique_lock lock(mutex_);
  const auto it = seats_.find(seat);
  if (queue_.empty() && it != seats_.end()) {
    idle_ = true;
    only_ = seat;
    it->second.had_none = false;
    changed_.notify_all();
    changed_.wait_for(lock, kPatience, [&] {
      const auto now = seats_.find(seat);
      return closed_ || !queue_.empty() || now == seats_.end() || now->second.had_none;
    });
    idle_ = false;
    only_ = 0;
  }
  return take();
}

// Requires: mutex_.
std::optional<Leased> Intake::take() {
  if (closed_ || queue_.empty()) return std::nullopt;
  Leased leased = std::move(queue_.front());
  queue_.pop_front();
  return leased;
}

std::vector<Leased> Intake::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  changed_.notify_all();
  std::vector<Leased> left(std::make_move_iterator(queue_.begin()),
                           std::make_move_iterator(queue_.end()));
  queue_.clear();
  return left;
}

}  // namespace metrofarm::rpc
