#include "rpc/checksum.h"

#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "metrofarm/farm/v1/farm_service.pb.h"

namespace metrofarm::rpc {
namespace {

template <typename Message>
Message parsed(const std::filesystem::path& path) {
  std::ifstream file(path);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  Message message;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &message)) << path;
  return message;
}

template <typename Message>
void expect_right(const std::filesystem::path& path) {
  const auto message = parsed<Message>(path);
  EXPECT_EQ(checksum(message), message.checksum()) << path;
}

// Those that coordinators are tested with, too.
TEST(Checksum, OfTheExamples) {
  int examples = 0;
  for (const auto& entry : std::filesystem::directory_iterator(METROFARM_PROTO_EXAMPLES)) {
    ++examples;
    if (entry.path().filename().string().starts_with("segment_"))
      expect_right<farm::v1::SegmentResult>(entry.path());
    else
      expect_right<farm::v1::ReportRequest>(entry.path());
  }
  EXPECT_GE(examples, 7);
}

}  // namespace
}  // namespace metrofarm::rpc
