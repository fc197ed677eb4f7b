// Names of coordinators, and where they are.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "base/result.h"
#include "rpc/farm_client.h"

namespace metrofarm::rpc {

// One item of --coordinator.
struct HostPort {
  std::string host;  // a name or a numeric address, without brackets
  std::string port;

  // For certificates and logs; IPv6 addresses in brackets.
  std::string to_string() const;
  // "localhost" or a numeric loopback address.
  bool is_loopback() const;
};

// Reads "HOST:PORT[,HOST:PORT...]"; an IPv6 address stands in brackets, "dns:" before a name is
// allowed and changes nothing.
Result<std::vector<HostPort>> parse_coordinators(const std::string& text);

// All endpoints behind a name, or what the resolver says is wrong.
using Resolve = std::function<Result<std::set<Endpoint>>(const HostPort& name)>;

Result<std::set<Endpoint>> resolve(const HostPort& name);

}  // namespace metrofarm::rpc
