#include "rpc/addresses.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <charconv>
#include <memory>
#include <sstream>

namespace metrofarm::rpc {

namespace {

bool is_port(const std::string& text) {
  int port = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), port);
  return failure == std::errc{} && end == text.data() + text.size() && port > 0 && port < 65536;
}

Result<HostPort> parse_one(std::string text) {
  const Error wrong{"--coordinator: '" + text +
                    "' should read HOST:PORT, with an IPv6 address in brackets"};
  if (text.starts_with("dns:")) text.erase(0, 4);
  const size_t colon = text.rfind(':');
  if (colon == std::string::npos || !is_port(text.substr(colon + 1))) return wrong;
  HostPort result{text.substr(0, colon), text.substr(colon + 1)};
  const bool bracketed = result.host.starts_with('[') && result.host.ends_with(']');
  if (bracketed) {
    result.host = result.host.substr(1, result.host.size() - 2);
    in6_addr address{};
    if (inet_pton(AF_INET6, result.host.c_str(), &address) != 1) return wrong;
  }
  const bool odd = result.host.find_first_of("/[] \t") != std::string::npos ||
                   (!bracketed && result.host.find(':') != std::string::npos);
  if (result.host.empty() || odd) return wrong;
  return result;
}

std::string numeric(const addrinfo& info) {
  char host[NI_MAXHOST], port[NI_MAXSERV];
  const int failure = getnameinfo(info.ai_addr, info.ai_addrlen, host, sizeof host, port,
                                  sizeof port, NI_NUMERICHOST | NI_NUMERICSERV);
  return failure == 0 ? HostPort{host, port}.to_string() : "";
}

}  // namespace

std::string HostPort::to_string() const {
  return host.find(':') == std::string::npos ? host + ":" + port : "[" + host + "]:" + port;
}

bool HostPort::is_loopback() const {
  in_addr v4{};
  in6_addr v6{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == 127;
  if (inet_pton(AF_INET6, host.c_str(), &v6) == 1) return IN6_IS_ADDR_LOOPBACK(&v6);
  return host == "localhost";
}

Result<std::vector<HostPort>> parse_coordinators(const std::string& text) {
  std::vector<HostPort> all;
  std::istringstream in(text);
  for (std::string item; std::getline(in, item, ',');) {
    auto one = parse_one(item);
    if (!one) return one.error();
    all.push_back(std::move(one.value()));
  }
  if (all.empty()) return Error{"--coordinator HOST:PORT[,HOST:PORT...] is required"};
  return all;
}

Result<std::set<Endpoint>> resolve(const HostPort& name) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  const int failure = getaddrinfo(name.host.c_str(), name.port.c_str(), &hints, &list);
  if (failure != 0) return Error{name.to_string() + ": " + gai_strerror(failure)};
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(list, freeaddrinfo);
  std::set<Endpoint> endpoints;
  for (const addrinfo* info = list; info != nullptr; info = info->ai_next) {
    const std::string address = numeric(*info);
    if (!address.empty()) endpoints.insert({address, name.to_string()});
  }
  return endpoints;
}

}  // namespace metrofarm::rpc
