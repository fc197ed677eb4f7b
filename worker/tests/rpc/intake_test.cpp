#include "rpc/intake.h"

#include <gtest/gtest.h>

#include <future>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace metrofarm::rpc {
namespace {

using namespace std::chrono_literals;

constexpr uint32_t kThreads = 4;
constexpr uint32_t kBatch = 100;

Leased work(const std::string& name) {
  Leased leased;
  leased.tasks.emplace_back().set_task_id(name);
  return leased;
}

// Asks for a turn on a thread of its own.
class Asker {
 public:
  Asker(Intake& intake, Intake::Seat seat)
      : turn_(std::async(std::launch::async,
                         [&intake, seat] { return intake.await_turn(seat, kBatch); })) {}
  bool has_turn() { return turn_.wait_for(400ms) == std::future_status::ready; }
  std::optional<Turn> turn() { return turn_.get(); }

 private:
  std::future<std::optional<Turn>> turn_;
};

class IntakeTest : public testing::Test {
 protected:
  ~IntakeTest() override {
    intake_.close();
    if (renderer_.joinable()) renderer_.join();
  }
  // The rendering thread wants work; what it gets is in taken().
  void want() {
    if (renderer_.joinable()) renderer_.join();
    renderer_ = std::thread([this] {
      const auto leased = intake_.next();
      taken_ = leased ? leased->tasks[0].task_id() : "closed";
    });
    std::this_thread::sleep_for(20ms);
  }
  std::string taken() {
    renderer_.join();
    return taken_;
  }

  Intake intake_{kThreads};
  std::thread renderer_;
  std::string taken_;
};

TEST_F(IntakeTest, NobodyIsAskedWhileTheWorkerRenders) {
  const auto seat = intake_.join();
  Asker asker(intake_, seat);
  EXPECT_FALSE(asker.has_turn());
  want();
  EXPECT_TRUE(asker.turn().has_value());
  EXPECT_TRUE(intake_.answer(seat, work("a")));
  EXPECT_EQ(taken(), "a");
}

TEST_F(IntakeTest, ASingleCoordinatorIsWaitedForWithAWholeBatch) {
  const auto seat = intake_.join();
  want();
  const auto turn = intake_.await_turn(seat, kBatch);
  EXPECT_EQ(turn->max_segments, kBatch);
  EXPECT_GT(turn->wait_seconds, 1);
}

TEST_F(IntakeTest, SeveralAreAskedInTurnWithoutWaiting) {
  const auto a = intake_.join(), b = intake_.join();
  want();
  const auto first = intake_.await_turn(a, kBatch);
  EXPECT_EQ(first->max_segments, kBatch);
  EXPECT_EQ(first->wait_seconds, 0);
  Asker second(intake_, b);
  intake_.answer(a, {});
  EXPECT_EQ(second.turn()->max_segments, kBatch);
  intake_.answer(b, work("b"));
  EXPECT_EQ(taken(), "b");
}

TEST_F(IntakeTest, MoreIsAskedOfOneAloneWithoutWaiting) {
  const auto a = intake_.join(), b = intake_.join();
  Asker other(intake_, a), asker(intake_, b);
  // A machine that is busy may take more than the patience for a turn.
  while (!asker.has_turn()) EXPECT_FALSE(intake_.more(b)) << "nobody has answered";
  const auto turn = asker.turn();
  EXPECT_EQ(turn->max_segments, kBatch);
  EXPECT_EQ(turn->wait_seconds, 0);
  intake_.answer(b, work("b"));
  const auto leased = intake_.more(b);
  ASSERT_TRUE(leased);
  EXPECT_EQ(leased->seat, b);
  EXPECT_FALSE(other.has_turn());
  intake_.leave(b);
  EXPECT_FALSE(intake_.more(b)) << "it is away";
  intake_.close();  // ends the other's waiting
}

TEST_F(IntakeTest, WhoeverWasServedLongestAgoIsAskedFirst) {
  // All three always have work; each asks whenever it may.
  std::mutex mutex;
  std::string order;
  std::vector<std::jthread> coordinators;
  for (const char* name : {"a", "b", "c"}) {
    coordinators.emplace_back([&, name, seat = intake_.join()] {
      while (const auto turn = intake_.await_turn(seat, kBatch)) {
        {
          const std::lock_guard lock(mutex);
          order += name;
        }
        intake_.answer(seat, work(name));
      }
    });
  }
  for (int i = 0; i < 9; ++i) intake_.next();
  intake_.close();
  const std::lock_guard lock(mutex);
  EXPECT_EQ(order, "abcabcabc");
}

TEST_F(IntakeTest, WhenNobodyHasWorkAllAreWaitedForWithLittle) {
  const auto a = intake_.join(), b = intake_.join();
  want();
  intake_.await_turn(a, kBatch);
  intake_.answer(a, {});
  intake_.await_turn(b, kBatch);
  intake_.answer(b, {});
  Asker at_a(intake_, a), at_b(intake_, b);
  for (Asker* asker : {&at_a, &at_b}) {
    const auto turn = asker->turn();
    EXPECT_EQ(turn->max_segments, kThreads) << "both may answer at once";
    EXPECT_GT(turn->wait_seconds, 1);
  }
  intake_.answer(b, work("b"));
  EXPECT_EQ(taken(), "b");
  // What came late is rendered next, before anybody is asked again.
  intake_.answer(a, work("a"));
  want();
  EXPECT_EQ(taken(), "a");
}

TEST_F(IntakeTest, ASlowAnswerIsNotWaitedFor) {
  const auto a = intake_.join(), b = intake_.join();
  want();
  intake_.await_turn(a, kBatch);  // and never answers
  Asker at_b(intake_, b);
  EXPECT_EQ(at_b.turn()->max_segments, kBatch);
  intake_.answer(b, work("b"));
  EXPECT_EQ(taken(), "b");
}

TEST_F(IntakeTest, WhoLeavesIsNotWaitedFor) {
  const auto a = intake_.join(), b = intake_.join();
  want();
  intake_.await_turn(a, kBatch);
  intake_.leave(a);
  const auto turn = intake_.await_turn(b, kBatch);
  EXPECT_GT(turn->wait_seconds, 1) << "it is the only one now";
}

TEST_F(IntakeTest, ClosingReturnsWhatNobodyHasBegun) {
  const auto seat = intake_.join();
  want();
  intake_.await_turn(seat, kBatch);
  intake_.answer(seat, work("begun"));
  EXPECT_EQ(taken(), "begun");
  intake_.answer(seat, work("waits"));
  const auto left = intake_.close();
  ASSERT_EQ(left.size(), 1U);
  EXPECT_EQ(left[0].tasks[0].task_id(), "waits");
  EXPECT_FALSE(intake_.answer(seat, work("too late")));
  EXPECT_FALSE(intake_.await_turn(seat, kBatch).has_value());
  want();
  EXPECT_EQ(taken(), "closed");
}

}  // namespace
}  // namespace metrofarm::rpc
