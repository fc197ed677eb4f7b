// Why a scene can't be had.
#pragma once

#include <string>

namespace metrofarm::rpc {

struct LoadFault {
  enum class Kind {
    kScene,   // its fault: no worker can load it
    kWorker,  // this worker's: another may
    kAway,    // the coordinator does not answer, or the worker is told to stop; nobody is to blame
  };
  Kind kind = Kind::kScene;
  std::string message = {};
};

}  // namespace metrofarm::rpc
