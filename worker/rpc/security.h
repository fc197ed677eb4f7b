// How the worker and its coordinators know each other.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/result.h"
#include "rpc/addresses.h"

namespace metrofarm::rpc {

// Files in PEM format; may be replaced while the worker runs.
struct TlsFiles {
  std::string ca;           // certificates of who may sign a coordinator's
  std::string certificate;  // the worker's own, with those that lead to the CA
  std::string key;          // of the worker's certificate
};

// The worker's credentials: TLS where a CA is given, mutual where a certificate is, too. Without
// TLS every coordinator must be on this machine, unless `insecure` allows others.
Result<std::shared_ptr<grpc::ChannelCredentials>> make_credentials(
    const TlsFiles& files, bool insecure, const std::vector<HostPort>& coordinators);

}  // namespace metrofarm::rpc
