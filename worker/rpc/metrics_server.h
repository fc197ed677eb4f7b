// Serves /metrics, /healthz and /readyz over HTTP.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "base/result.h"

namespace prometheus {
class Collectable;
}

namespace metrofarm::rpc {

// Answers 200 on /healthz while it lives, and on /readyz while ready() does; else 503.
class MetricsServer {
 public:
  // address: HOST:PORT. The error names it.
  static Result<std::unique_ptr<MetricsServer>> start(
      const std::string& address, std::shared_ptr<prometheus::Collectable> metrics,
      std::function<bool()> ready);
  ~MetricsServer();

  int port() const;

 private:
  struct Impl;
  explicit MetricsServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace metrofarm::rpc
