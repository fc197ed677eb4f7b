// The worker's program: signals, metrics, logs.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/rpc/fake_coordinator.h"

namespace metrofarm::rpc {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using test::eventually;
using test::FakeCoordinator;

// Samples per pixel that keep a segment busy for hours.
constexpr uint64_t kForever = uint64_t{1} << 32;

class Process {
 public:
  explicit Process(const std::string& coordinators, const std::vector<std::string>& more = {}) {
    directory_ = fs::temp_directory_path() / ("metrofarm-process-test-" + std::to_string(getpid()));
    fs::create_directories(directory_);
    std::vector<std::string> words = {
        METROFARM_WORKER, "--coordinator",    coordinators, "--threads", "1",
        "--cache",        directory_.string()};
    words.insert(words.end(), more.begin(), more.end());
    std::vector<char*> arguments;
    arguments.reserve(words.size() + 1);
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, (directory_ / "log").c_str(),
                                     O_WRONLY | O_CREAT | O_TRUNC, 0600);
    EXPECT_EQ(posix_spawn(&pid_, METROFARM_WORKER, &actions, nullptr, arguments.data(), environ),
              0);
    posix_spawn_file_actions_destroy(&actions);
  }
  ~Process() {
    if (!reaped_) {
      kill(pid_, SIGKILL);
      waitpid(pid_, &status_, 0);
    }
    std::error_code ignored;
    fs::remove_all(directory_, ignored);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void terminate() const { kill(pid_, SIGTERM); }
  bool ended() { return reaped_ = reaped_ || waitpid(pid_, &status_, WNOHANG) == pid_; }
  // Exit code once it has ended; -1: it has not, or not by itself.
  int code() {
    if (!eventually([&] { return ended(); }) || !WIFEXITED(status_)) return -1;
    return WEXITSTATUS(status_);
  }
  std::string log() const {
    std::ifstream in(directory_ / "log");
    return {std::istreambuf_iterator<char>(in), {}};
  }

 private:
  fs::path directory_;
  pid_t pid_ = 0;
  int status_ = 0;
  bool reaped_ = false;
};

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Has a worker at work on a segment without end.
void start_endless(FakeCoordinator& farm, const Process& worker) {
  const int granted = farm.account().granted;
  farm.add_segments(1, kForever);
  ASSERT_TRUE(eventually([&] { return farm.account().granted > granted; })) << worker.log();
  std::this_thread::sleep_for(500ms);
}

TEST(Process, SigtermFinishesWhatIsUnderWayAndGivesTheRestBack) {
  FakeCoordinator farm;
  Process worker(farm.address(), {"--grace", "3600"});
  farm.add_segments(1);
  ASSERT_TRUE(eventually([&] { return farm.account().delivered == 1; })) << worker.log();
  farm.add_segments(5, 20000);  // long enough to be caught at it
  ASSERT_TRUE(eventually([&] { return farm.account().grants.size() == 2; }));
  std::this_thread::sleep_for(50ms);
  worker.terminate();
  EXPECT_EQ(worker.code(), 0) << worker.log();
  const auto account = farm.account();
  EXPECT_EQ(account.delivered, 2) << "the one under way, not the next";
  EXPECT_EQ(account.left, 1);
  EXPECT_EQ(account.open, 4) << "what is left can be leased again";
}

TEST(Process, AfterTheGraceItLeavesWhatItCannotFinish) {
  FakeCoordinator farm;
  Process worker(farm.address(), {"--grace", "1"});
  start_endless(farm, worker);
  const auto start = Clock::now();
  worker.terminate();
  EXPECT_EQ(worker.code(), 0) << worker.log();
  EXPECT_GE(seconds_since(start), 0.9);
  EXPECT_LT(seconds_since(start), 20);
  EXPECT_EQ(farm.account().left, 1);
  EXPECT_EQ(farm.account().open, 1);
}

TEST(Process, ASecondSigtermDoesNotWait) {
  FakeCoordinator farm;
  Process worker(farm.address(), {"--grace", "3600"});
  start_endless(farm, worker);
  worker.terminate();
  std::this_thread::sleep_for(300ms);
  EXPECT_FALSE(worker.ended()) << worker.log();
  worker.terminate();
  EXPECT_EQ(worker.code(), 0) << worker.log();
  EXPECT_EQ(farm.account().left, 1);
}

TEST(Process, ASegmentThatNobodyWantsFreesItsThread) {
  FakeCoordinator farm;
  Process worker(farm.address());
  start_endless(farm, worker);
  farm.withdraw(kForever);
  farm.add_segments(5);
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == 5; })) << worker.log();
  EXPECT_EQ(farm.account().unsound, 0);
  EXPECT_EQ(farm.account().released, 0) << "there was nothing to give back";
}

TEST(Process, ADrainedWorkerDoesNotFinishWhatNobodyWants) {
  FakeCoordinator farm;
  Process worker(farm.address());
  start_endless(farm, worker);
  farm.drain();
  std::this_thread::sleep_for(500ms);
  EXPECT_FALSE(worker.ended()) << "it finishes what is under way";
  farm.withdraw(kForever);
  EXPECT_EQ(worker.code(), 0) << worker.log();
  EXPECT_EQ(farm.account().batches, 0);
  EXPECT_EQ(farm.account().left, 1);
}

TEST(Process, AfterSigtermItDoesNotFinishWhatNobodyWants) {
  FakeCoordinator farm;
  Process worker(farm.address(), {"--grace", "3600"});
  start_endless(farm, worker);
  worker.terminate();
  std::this_thread::sleep_for(300ms);
  EXPECT_FALSE(worker.ended()) << "it finishes what is under way";
  farm.withdraw(kForever);
  EXPECT_EQ(worker.code(), 0) << worker.log();
  EXPECT_EQ(farm.account().batches, 0);
  EXPECT_EQ(farm.account().left, 1);
}

TEST(Process, AnIdleWorkerLeaves) {
  FakeCoordinator farm;
  Process worker(farm.address());
  ASSERT_TRUE(eventually([&] { return farm.account().polls > 0; })) << worker.log();
  worker.terminate();
  EXPECT_EQ(worker.code(), 0) << worker.log();
  EXPECT_EQ(farm.account().left, 1);
}

// What a page of the worker's own server says; empty if nobody answers.
std::string get(int port, const std::string& page) {
  const int s = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (connect(s, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
    const std::string request = "GET " + page + " HTTP/1.0\r\n\r\n";
    if (write(s, request.data(), request.size()) > 0) {
      char chunk[4096];
      for (ssize_t n; (n = read(s, chunk, sizeof chunk)) > 0;)
        answer.append(chunk, static_cast<size_t>(n));
    }
  }
  close(s);
  return answer;
}

// A port that was free a moment ago.
int free_port() {
  const int s = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  EXPECT_EQ(bind(s, reinterpret_cast<const sockaddr*>(&address), size), 0);
  getsockname(s, reinterpret_cast<sockaddr*>(&address), &size);
  close(s);
  return ntohs(address.sin_port);
}

double value_of(const std::string& metrics, const std::string& name) {
  const size_t at = metrics.find("\n" + name + " ");
  return at == std::string::npos ? -1 : std::stod(metrics.substr(at + name.size() + 2));
}

TEST(Process, ServesMetrics) {
  FakeCoordinator farm;
  const int port = free_port();
  Process worker(farm.address() + ",127.0.0.1:1",
                 {"--metrics", "127.0.0.1:" + std::to_string(port)});
  farm.add_segments(10, 4);
  ASSERT_TRUE(eventually([&] { return farm.account().delivered == 10; })) << worker.log();
  const std::string p = "metrofarm_worker_";
  const auto metric = [&](const std::string& name) {
    return value_of(get(port, "/metrics"), p + name);
  };
  EXPECT_TRUE(eventually([&] { return metric("segments_total{outcome=\"committed\"}") == 10; }))
      << get(port, "/metrics");
  EXPECT_EQ(metric("mutations_total"), 10 * 64 * 4);
  EXPECT_GT(metric("rays_total"), 10 * 64 * 4);
  EXPECT_GT(metric("render_cpu_seconds_total"), 0);
  EXPECT_EQ(metric("batches_total{reply=\"committed\"}"), farm.account().batches);
  EXPECT_GT(metric("sent_bytes_total{reply=\"committed\"}"), 0);
  EXPECT_GT(metric("cache_bytes"), 100);
  EXPECT_EQ(metric("cache_misses_total"), 1);
  EXPECT_EQ(metric("cache_evictions_total"), 0);
  EXPECT_EQ(metric("loaded_scenes"), 1);
  EXPECT_EQ(metric("threads"), 1);
  EXPECT_EQ(metric("threads_busy"), 0);
  EXPECT_TRUE(eventually([&] { return metric("coordinators_connected") == 1; }));
  EXPECT_EQ(metric("coordinators"), 2);
  EXPECT_NE(get(port, "/metrics").find(p + "build_info{"), std::string::npos);
  EXPECT_EQ(get(port, "/metrics").find("job/"), std::string::npos) << "no job ids";
  EXPECT_NE(get(port, "/healthz").find("200"), std::string::npos);
  EXPECT_NE(get(port, "/readyz").find("200"), std::string::npos);
  farm.stop();
  EXPECT_TRUE(eventually([&] { return get(port, "/readyz").find("503") != std::string::npos; }));
  EXPECT_NE(get(port, "/healthz").find("200"), std::string::npos) << "still alive";
}

TEST(Process, WithoutCoordinatorItLeavesToo) {
  const int port = free_port();
  Process worker("127.0.0.1:1", {"--metrics", "127.0.0.1:" + std::to_string(port)});
  ASSERT_TRUE(eventually([&] { return !get(port, "/healthz").empty(); })) << worker.log();
  worker.terminate();
  EXPECT_EQ(worker.code(), 0) << worker.log();
}

TEST(Process, AMetricsPortThatIsTakenIsAnError) {
  const int s = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  EXPECT_EQ(bind(s, reinterpret_cast<const sockaddr*>(&address), size), 0);
  listen(s, 1);
  getsockname(s, reinterpret_cast<sockaddr*>(&address), &size);
  Process worker("127.0.0.1:1",
                 {"--metrics", "127.0.0.1:" + std::to_string(ntohs(address.sin_port))});
  EXPECT_EQ(worker.code(), 1);
  EXPECT_NE(worker.log().find("--metrics"), std::string::npos) << worker.log();
  close(s);
}

TEST(Process, LogsOneJsonObjectPerLine) {
  FakeCoordinator farm;
  farm.set_scene("<scene version=\"3.0.0\"><nonsense/></scene>");
  farm.add_segments(1);
  Process worker(farm.address(), {"--log-format", "json"});
  ASSERT_TRUE(eventually([&] { return !farm.account().failures.empty(); })) << worker.log();
  worker.terminate();
  EXPECT_EQ(worker.code(), 0);
  std::istringstream lines(worker.log());
  bool failure = false;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_TRUE(line.starts_with("{\"timestamp\":\"") && line.ends_with("}}")) << line;
    failure =
        failure || (line.find("\"metrofarm.job\":\"job\"") != std::string::npos &&
                    line.find("\"server.address\":\"" + farm.address()) != std::string::npos &&
                    line.find("scene.xml:1") != std::string::npos);
  }
  EXPECT_TRUE(failure) << worker.log();
}

}  // namespace
}  // namespace metrofarm::rpc
