#include "rpc/metrics_server.h"

#include <CivetServer.h>
#include <prometheus/collectable.h>
#include <prometheus/text_serializer.h>

#include <utility>

namespace metrofarm::rpc {

namespace {

// One handler for one path: prometheus-cpp's own server has no room for others.
class Page : public CivetHandler {
 public:
  using Answer = std::function<std::pair<int, std::string>()>;
  explicit Page(Answer answer) : answer_(std::move(answer)) {}

  bool handleGet(CivetServer* /*server*/, mg_connection* connection) override {
    const auto [status, body] = answer_();
    mg_printf(connection,
              "HTTP/1.1 %d %s\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\n"
              "Content-Length: %zu\r\nConnection: close\r\n\r\n",
              status, mg_get_response_code_text(connection, status), body.size());
    mg_write(connection, body.data(), body.size());
    return true;
  }

 private:
  Answer answer_;
};

}  // namespace

struct MetricsServer::Impl {
  Page metrics, health, ready;
  CivetServer server;  // last: ends first

  Impl(const std::string& address, std::shared_ptr<prometheus::Collectable> source,
       std::function<bool()> is_ready)
      : metrics([source = std::move(source)] {
          return std::pair(200, prometheus::TextSerializer().Serialize(source->Collect()));
        }),
        health([] { return std::pair(200, std::string("ok\n")); }),
        ready([is_ready = std::move(is_ready)] {
          return is_ready() ? std::pair(200, std::string("ready\n"))
                            : std::pair(503, std::string("no coordinator answers\n"));
        }),
        server(std::vector<std::string>{"listening_ports", address, "num_threads", "2"}) {
    server.addHandler("/metrics", &metrics);
    server.addHandler("/healthz", &health);
    server.addHandler("/readyz", &ready);
  }
};

Result<std::unique_ptr<MetricsServer>> MetricsServer::start(
    const std::string& address, std::shared_ptr<prometheus::Collectable> metrics,
    std::function<bool()> ready) {
  try {
    auto impl = std::make_unique<Impl>(address, std::move(metrics), std::move(ready));
    return std::unique_ptr<MetricsServer>(new MetricsServer(std::move(impl)));
  } catch (const CivetException&) {
    return Error{"cannot listen on " + address +
                 ": it should be HOST:PORT with a numeric address "
                 "of this machine and a free port"};
  }
}

MetricsServer::MetricsServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

MetricsServer::~MetricsServer() = default;

int MetricsServer::port() const {
  const auto ports = impl_->server.getListeningPorts();
  return ports.empty() ? 0 : ports.front();
}

}  // namespace metrofarm::rpc
