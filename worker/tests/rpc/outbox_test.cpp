#include "rpc/outbox.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>

namespace metrofarm::rpc {
namespace {

using namespace std::chrono_literals;

// Links are only told apart here.
const Link* link(uintptr_t number) {
  return reinterpret_cast<const Link*>(number);  // NOLINT(performance-no-int-to-ptr)
}

TaskResults results(const std::string& task) {
  TaskResults r;
  r.reports.emplace_back().mutable_lease()->set_task_id(task);
  return r;
}

std::string name_of(const std::shared_ptr<Parcel>& parcel) {
  return parcel == nullptr ? "" : parcel->results.reports[0].lease().task_id();
}

bool ready(std::future<bool>& future) {
  return future.wait_for(300ms) == std::future_status::ready;
}

TEST(Outbox, HoldsTwoParcelsUntilTheyAreDone) {
  Outbox outbox([](const Link*) { return false; });
  outbox.put(link(1), results("a"));
  outbox.put(link(2), results("b"));
  auto room = std::async(std::launch::async, [&] { return outbox.wait_for_room(); });
  EXPECT_FALSE(ready(room));
  const auto b = outbox.take(link(2));
  EXPECT_EQ(name_of(b), "b");
  EXPECT_FALSE(ready(room)) << "it is on its way, not delivered";
  outbox.done(b);
  EXPECT_TRUE(room.get());
  EXPECT_EQ(outbox.size(), 1U);
  EXPECT_EQ(outbox.count_for(link(1)), 1U);
  EXPECT_EQ(outbox.count_for(link(2)), 0U);
}

TEST(Outbox, ParcelsOfOneCoordinatorKeepTheirOrder) {
  Outbox outbox([](const Link*) { return false; });
  outbox.put(link(1), results("a"));
  outbox.put(link(1), results("b"));
  EXPECT_EQ(name_of(outbox.take(link(1))), "a");
  EXPECT_EQ(name_of(outbox.take(link(1))), "b");
}

TEST(Outbox, WhatIsHopelessMakesRoomWhenItIsFull) {
  std::atomic<bool> hopeless = false;
  Outbox outbox([&](const Link* to) { return hopeless && to == link(1); });
  outbox.put(link(1), results("a"));
  const auto a = outbox.take(link(1));
  hopeless = true;
  outbox.put(link(2), results("b"));
  EXPECT_FALSE(a->cancellation.cancelled()) << "there was room";
  auto room = std::async(std::launch::async, [&] { return outbox.wait_for_room(); });
  EXPECT_TRUE(!a->cancellation.sleep(10s)) << "given up";
  outbox.done(a);
  EXPECT_TRUE(room.get());
  EXPECT_EQ(outbox.count_for(link(2)), 1U);
}

TEST(Outbox, ClosingEndsAllWaiting) {
  Outbox outbox([](const Link*) { return false; });
  auto taker = std::async(std::launch::async, [&] { return outbox.take(link(3)) == nullptr; });
  outbox.put(link(1), results("a"));
  outbox.put(link(2), results("b"));
  const auto a = outbox.take(link(1));
  auto room = std::async(std::launch::async, [&] { return outbox.wait_for_room(); });
  outbox.close();
  EXPECT_FALSE(room.get());
  EXPECT_TRUE(taker.get());
  EXPECT_TRUE(a->cancellation.cancelled());
  EXPECT_EQ(outbox.size(), 1U) << "only what is on its way";
}

TEST(Outbox, OneCoordinatorCanBeClosed) {
  Outbox outbox([](const Link*) { return false; });
  outbox.put(link(1), results("a"));
  outbox.close(link(1));
  outbox.put(link(1), results("b"));
  EXPECT_EQ(outbox.take(link(1)), nullptr);
  EXPECT_EQ(outbox.size(), 0U);
  outbox.forget(link(1));
  outbox.put(link(1), results("c"));
  EXPECT_EQ(name_of(outbox.take(link(1))), "c");
}

}  // namespace
}  // namespace metrofarm::rpc
