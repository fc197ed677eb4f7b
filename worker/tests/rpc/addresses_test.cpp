#include "rpc/addresses.h"

#include <gtest/gtest.h>

namespace metrofarm::rpc {
namespace {

TEST(Coordinators, AreReadFromAList) {
  const auto parsed =
      parse_coordinators("127.0.0.1:7070,dns:farm.example:80,[::1]:1,localhost:65535");
  ASSERT_TRUE(parsed.ok()) << parsed.error().message;
  std::vector<std::string> names;
  for (const HostPort& one : parsed.value()) names.push_back(one.to_string());
  EXPECT_EQ(names, (std::vector<std::string>{"127.0.0.1:7070", "farm.example:80", "[::1]:1",
                                             "localhost:65535"}));
}

TEST(Coordinators, WrongOnesAreNamed) {
  for (const char* wrong : {"farm", "farm:", ":7070", "farm:0", "farm:65536", "farm:70x",
                            "::1:7070", "[x]:7070", "http://farm:80", "a:1,,b:2", "a b:1"}) {
    const auto parsed = parse_coordinators(wrong);
    ASSERT_FALSE(parsed.ok()) << wrong;
    EXPECT_NE(parsed.error().message.find("HOST:PORT"), std::string::npos);
  }
  EXPECT_NE(parse_coordinators("").error().message.find("required"), std::string::npos);
}

TEST(Coordinators, LoopbackIsKnown) {
  const auto loopback = [](const char* text) {
    return parse_coordinators(text).value()[0].is_loopback();
  };
  EXPECT_TRUE(loopback("127.0.0.1:1"));
  EXPECT_TRUE(loopback("127.9.9.9:1"));
  EXPECT_TRUE(loopback("[::1]:1"));
  EXPECT_TRUE(loopback("localhost:1"));
  EXPECT_FALSE(loopback("128.0.0.1:1"));
  EXPECT_FALSE(loopback("[::2]:1"));
  EXPECT_FALSE(loopback("localhost.example:1"));
}

TEST(Resolve, GivesNumericAddressesUnderTheNameAsked) {
  const auto found = resolve({"127.0.0.1", "7070"});
  ASSERT_TRUE(found.ok());
  EXPECT_EQ(found.value(), (std::set<Endpoint>{{"127.0.0.1:7070", "127.0.0.1:7070"}}));
  const auto local = resolve({"localhost", "80"});
  ASSERT_TRUE(local.ok()) << local.error().message;
  for (const Endpoint& endpoint : local.value()) {
    EXPECT_TRUE(endpoint.address == "127.0.0.1:80" || endpoint.address == "[::1]:80");
    EXPECT_EQ(endpoint.name, "localhost:80");
  }
  EXPECT_FALSE(resolve({"no-such-host.invalid", "80"}).ok());
}

}  // namespace
}  // namespace metrofarm::rpc
