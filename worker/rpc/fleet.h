// All coordinators that this worker knows.
#pragma once

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "rpc/addresses.h"
#include "rpc/link.h"

namespace metrofarm::rpc {

struct FleetOptions {
  std::vector<HostPort> coordinators;
  double resolve_seconds = 5;  // between two looks at what is behind the names
  std::shared_ptr<grpc::ChannelCredentials> credentials;
  WorkerIdentity identity;
  Resolve resolve;
};

// Keeps a link to every endpoint behind every name, from time to time looked up anew: coordinators
// come and go. Thread-safe.
class Fleet {
 public:
  Fleet(FleetOptions options, const Shared& shared);
  ~Fleet();

  void start();
  // Asks for no more work, for good.
  void stop_leasing();
  // Gives all leases back, to all coordinators that can be reached at once.
  void leave();

  size_t connected() const;
  size_t leases() const;
  bool drain_requested() const;
  // Nobody answers there, and did not for a while, but elsewhere somebody does.
  bool hopeless(const Link* link) const;

 private:
  void look_up_until_stopped();
  void look_up();
  void retire_gone(const std::map<std::string, std::set<Endpoint>>& found);
  void retire_doubles();
  void publish() const;

  const FleetOptions options_;
  const Shared shared_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::map<Endpoint, std::shared_ptr<Link>> links_;
  std::vector<std::shared_ptr<Link>> retired_;  // that deliver what they have left
  std::set<Endpoint> doubles_;                  // other addresses of coordinators in links_
  std::set<std::string> unresolved_;            // names that were complained about
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace metrofarm::rpc
