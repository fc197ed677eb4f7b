#include "app/serve_options.h"

#include <gtest/gtest.h>

#include "base/memory.h"

namespace metrofarm::app {
namespace {

TEST(Bytes, TakeUnits) {
  EXPECT_EQ(parse_bytes("0").value(), 0U);
  EXPECT_EQ(parse_bytes("1048576").value(), 1048576U);
  EXPECT_EQ(parse_bytes("500MB").value(), 500000000U);
  EXPECT_EQ(parse_bytes("3K").value(), 3000U);
  EXPECT_EQ(parse_bytes("10GiB").value(), uint64_t{10} << 30);
  EXPECT_EQ(parse_bytes("2TiB").value(), uint64_t{2} << 40);
}

TEST(Bytes, NameWhatIsWrong) {
  for (const char* wrong : {"", "GiB", "10 GiB", "-1", "1.5G", "10gib", "10GiBs", "99999999TiB"}) {
    const auto parsed = parse_bytes(wrong);
    ASSERT_FALSE(parsed.ok()) << wrong;
    EXPECT_NE(parsed.error().message.find("10GiB"), std::string::npos) << "what would be right";
  }
}

std::string error_of(const std::vector<std::string>& words) {
  const auto options = read_serve_options(words);
  return options.ok() ? "" : options.error().to_string();
}

TEST(ServeOptions, HaveDefaults) {
  const auto options = read_serve_options({"--coordinator", "127.0.0.1:7070"});
  ASSERT_TRUE(options.ok()) << options.error().to_string();
  const rpc::WorkerOptions& w = options.value().worker;
  EXPECT_EQ(w.grace_seconds, 20);
  EXPECT_EQ(w.scenes.max_bytes, uint64_t{10} << 30);
  EXPECT_EQ(w.scenes.scene_memory, available_memory() / 2);
  EXPECT_EQ(w.metrics, "");
  EXPECT_NE(w.credentials, nullptr);
  EXPECT_EQ(options.value().log_format, LogFormat::kText);
}

TEST(ServeOptions, ScenesMayTakeHalfOfTheMemory) {
  EXPECT_EQ(default_scene_memory(uint64_t{8} << 30), uint64_t{4} << 30);
  EXPECT_EQ(default_scene_memory(0), uint64_t{4} << 30) << "where it is not known";
}

TEST(ServeOptions, AreTaken) {
  const auto options =
      read_serve_options({"--coordinator=a:1,b:2", "--insecure", "--grace", "7", "--cache-size",
                          "5GB", "--cache", "/c", "--scene-memory", "2GiB", "--metrics",
                          "127.0.0.1:9", "--log-format", "json", "--threads", "3", "--name", "n"});
  ASSERT_TRUE(options.ok()) << options.error().to_string();
  const rpc::WorkerOptions& w = options.value().worker;
  EXPECT_EQ(w.coordinators.size(), 2U);
  EXPECT_EQ(w.grace_seconds, 7);
  EXPECT_EQ(w.scenes.max_bytes, 5000000000U);
  EXPECT_EQ(w.scenes.scene_memory, uint64_t{2} << 30);
  EXPECT_EQ(w.scenes.directory, "/c");
  EXPECT_EQ(w.scenes.threads, 3);
  EXPECT_EQ(w.metrics, "127.0.0.1:9");
  EXPECT_EQ(w.name, "n");
  EXPECT_EQ(options.value().log_format, LogFormat::kJson);
}

TEST(ServeOptions, NameWhatIsWrong) {
  const auto names = [](const std::string& message, const char* what) {
    return message.find(what) != std::string::npos;
  };
  const std::vector<std::string> base = {"--coordinator", "127.0.0.1:1"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), base.begin(), base.end());
    return error_of(more);
  };
  EXPECT_EQ(with({}), "");
  EXPECT_TRUE(names(error_of({}), "--coordinator"));
  EXPECT_TRUE(names(with({"--cache-size", "big"}), "--cache-size"));
  EXPECT_TRUE(names(with({"--scene-memory", "big"}), "--scene-memory"));
  EXPECT_TRUE(names(with({"--grace", "-1"}), "--grace"));
  EXPECT_TRUE(names(with({"--log-format", "xml"}), "--log-format"));
  EXPECT_TRUE(names(with({"--tls-cert", "/x"}), "--tls-key"));
  EXPECT_TRUE(names(with({"--tls-cert", "/x", "--tls-key", "/y"}), "--tls-ca"));
  EXPECT_TRUE(names(with({"--tls-ca", "/nowhere/ca.pem"}), "/nowhere/ca.pem: No such file"));
  EXPECT_TRUE(names(with({"--tls-ca", "/etc/hostname"}), "PEM"));
  EXPECT_TRUE(names(with({"--tls-ca", "/nowhere", "--insecure"}), "exclude"));
}

TEST(ServeOptions, AnotherMachineNeedsTlsOrAWord) {
  const std::string error = error_of({"--coordinator", "127.0.0.1:1,farm.example:7070"});
  EXPECT_NE(error.find("farm.example:7070"), std::string::npos) << error;
  EXPECT_NE(error.find("--insecure"), std::string::npos);
  EXPECT_EQ(error_of({"--coordinator", "farm.example:7070", "--insecure"}), "");
}

}  // namespace
}  // namespace metrofarm::app
