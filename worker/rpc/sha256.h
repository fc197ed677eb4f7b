// SHA-256 as lower-case hex.
#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace metrofarm::rpc {

class Sha256 {
 public:
  Sha256();
  ~Sha256();
  void update(std::string_view bytes);
  std::string finish();  // once

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

std::string sha256_hex(std::string_view bytes);

}  // namespace metrofarm::rpc
