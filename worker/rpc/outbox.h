// Results on their way to coordinators.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <set>
#include <vector>

#include "rpc/batch.h"
#include "rpc/cancellation.h"

namespace metrofarm::rpc {

class Link;

// What came of tasks: reports, or a batch, or both.
struct TaskResults {
  std::vector<farm::v1::ReportRequest> reports;
  std::vector<Batch> batches;
};

// Results for one coordinator, sent together.
struct Parcel {
  const Link* to = nullptr;
  TaskResults results = {};
  Cancellation cancellation = {};  // given up
};

// Holds at most kParcels parcels, for all coordinators together, so that the worker's memory is
// bounded whatever becomes of them. When it is full of parcels for a coordinator that is away and
// another one could be served, the oldest of them is given up. Thread-safe.
class Outbox {
 public:
  static constexpr size_t kParcels = 2;

  // hopeless: nobody has answered there for so long that the leases are lost soon, and elsewhere
  // somebody does.
  explicit Outbox(std::function<bool(const Link*)> hopeless) : hopeless_(std::move(hopeless)) {}

  // Waits until there is room; false: closed before.
  bool wait_for_room();
  // Puts a parcel in, waiting for room. Nothing happens when closed.
  void put(const Link* to, TaskResults results);
  // The next parcel for a coordinator, which keeps its place until it is done; null when closed,
  // for all or for this coordinator.
  std::shared_ptr<Parcel> take(const Link* to);
  void done(const std::shared_ptr<Parcel>& parcel);

  size_t size() const;
  size_t count_for(const Link* to) const;
  // Gives everything up that is still here, and takes nothing more.
  void close();
  // The same for what goes to one coordinator; until forget() takes the word back, once nobody
  // waits for it any more.
  void close(const Link* to);
  void forget(const Link* to);

 private:
  void wait_for_room(std::unique_lock<std::mutex>& lock);
  void give_up_one(std::unique_lock<std::mutex>& lock);

  const std::function<bool(const Link*)> hopeless_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  struct Place {
    std::shared_ptr<Parcel> parcel;
    bool taken = false;
  };
  std::list<Place> places_;  // by age
  std::set<const Link*> ended_;
  bool closed_ = false;
};

}  // namespace metrofarm::rpc
