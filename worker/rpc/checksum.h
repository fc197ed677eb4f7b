// Checksums of what is sent to coordinators.
#pragma once

#include <cstdint>

namespace google::protobuf {
class Message;
}

namespace metrofarm::rpc {

// Of all fields of a message but its own `checksum`: see metrofarm.farm.v1.SegmentResult.
uint64_t checksum(const google::protobuf::Message& message);

}  // namespace metrofarm::rpc
