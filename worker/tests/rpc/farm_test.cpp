// A worker and the coordinators it serves.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <thread>

#include "tests/rpc/fake_coordinator.h"
#include "tests/rpc/running_worker.h"

namespace metrofarm::rpc {
namespace {

using namespace std::chrono_literals;
using test::eventually;
using test::FakeCoordinator;
using test::RunningWorker;

TEST(Farm, RendersAndDeliversForOneCoordinator) {
  FakeCoordinator farm;
  farm.add_segments(100);
  RunningWorker worker(farm.address());
  worker.start();
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == 100; })) << worker.log();
  EXPECT_EQ(worker.finish(), 0);
  const auto account = farm.account();
  EXPECT_EQ(account.delivered, account.granted) << "nothing twice";
  EXPECT_EQ(account.fetched, 1);
  EXPECT_EQ(account.registered, 1) << "not again once it has left";
  EXPECT_EQ(account.left, 1);
}

TEST(Farm, ServesSeveralCoordinatorsAlike) {
  FakeCoordinator a, b;
  a.add_segments(100000);
  b.add_segments(100000);
  RunningWorker worker(a.address() + "," + b.address());
  worker.start();
  const auto both = [&] {
    return a.account().grants.size() >= 6 && b.account().grants.size() >= 6;
  };
  EXPECT_TRUE(eventually(both)) << worker.log();
  worker.finish();
  // Once both are there they get about as much.
  const auto both_there = std::max(a.account().grants[0], b.account().grants[0]);
  const auto count = [&](const FakeCoordinator& farm) {
    const auto grants = farm.account().grants;
    return std::count_if(grants.begin(), grants.end(), [&](auto at) { return at >= both_there; });
  };
  EXPECT_LE(std::abs(count(a) - count(b)), 2) << count(a) << " and " << count(b);
}

TEST(Farm, HoldsLittleWhenAllHaveWorkAtOnce) {
  FakeCoordinator a, b, c;
  RunningWorker worker(a.address() + "," + b.address() + "," + c.address());
  constexpr int kWarmUp = 2000;
  worker.start();
  // Warms up: batches are many segments by now.
  for (FakeCoordinator* farm : {&a, &b, &c}) farm->add_segments(kWarmUp, 1);
  for (const FakeCoordinator* farm : {&a, &b, &c}) {
    ASSERT_TRUE(eventually([&] { return farm->account().delivered == kWarmUp; })) << worker.log();
    ASSERT_GT(farm->account().most_granted, 20);
  }
  // Every long call is under way; then all three have lots of work.
  ASSERT_TRUE(eventually([&] {
    return a.account().waiting == 1 && b.account().waiting == 1 && c.account().waiting == 1;
  }));
  const size_t grants = a.account().grants.size();
  a.add_segments(1, 30000);  // long beside the rest
  ASSERT_TRUE(eventually([&] { return a.account().grants.size() > grants; }));
  b.add_segments(3000);
  c.add_segments(3000);
  const auto granted = [&](const FakeCoordinator& farm) {
    return farm.account().granted - kWarmUp;
  };
  ASSERT_TRUE(eventually([&] { return granted(b) + granted(c) > 0; }));
  std::this_thread::sleep_for(100ms);
  EXPECT_EQ(a.account().delivered, kWarmUp) << "the long one should be under way still";
  EXPECT_LE(granted(b), worker.options.threads);
  EXPECT_LE(granted(c), worker.options.threads);
}

TEST(Farm, ACoordinatorThatIsAwayDisturbsNobody) {
  FakeCoordinator a, b;
  b.stop();
  a.add_segments(200);
  RunningWorker worker(a.address() + "," + b.address());
  worker.start();
  EXPECT_TRUE(eventually([&] { return a.account().delivered == 200; })) << worker.log();
  b.start();
  b.add_segments(50);
  EXPECT_TRUE(eventually([&] { return b.account().delivered == 50; })) << worker.log();
}

TEST(Farm, ACoordinatorThatHangsDisturbsNobody) {
  FakeCoordinator a, b;
  b.add_segments(50);
  RunningWorker worker(a.address() + "," + b.address());
  worker.start();
  ASSERT_TRUE(eventually([&] { return b.account().delivered == 50; })) << worker.log();
  b.hang(true);  // answers heartbeats, nothing else
  b.add_segments(1000);
  a.add_segments(500);
  EXPECT_TRUE(eventually([&] { return a.account().delivered == 500; })) << worker.log();
  b.hang(false);
  EXPECT_TRUE(eventually([&] { return b.account().delivered == 1050; })) << worker.log();
}

TEST(Farm, ResultsForOneThatDiedGiveWay) {
  FakeCoordinator a, b;
  RunningWorker worker(a.address() + "," + b.address());
  worker.start();
  b.hang_deliveries(true);
  b.add_segments(400);
  // As many results wait for b as the worker holds; then b dies.
  ASSERT_TRUE(eventually([&] { return b.account().delivering > 0; })) << worker.log();
  ASSERT_TRUE(eventually([&] { return b.account().grants.size() >= 2; })) << worker.log();
  std::this_thread::sleep_for(500ms);
  a.add_segments(300);
  std::this_thread::sleep_for(500ms);
  EXPECT_LE(a.account().granted, worker.options.threads) << "the worker is full";
  b.stop();
  EXPECT_TRUE(eventually([&] { return a.account().delivered == 300; })) << worker.log();
}

TEST(Farm, ARestartedCoordinatorIsRegisteredWithAgain) {
  FakeCoordinator farm;
  RunningWorker worker(farm.address());
  farm.add_segments(20);
  worker.start();
  ASSERT_TRUE(eventually([&] { return farm.account().delivered == 20; })) << worker.log();
  farm.stop();
  farm.start();
  farm.add_segments(20);
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == 40; })) << worker.log();
  EXPECT_GE(farm.account().registered, 2);
}

TEST(Farm, CoordinatorsComeAndGoBehindOneName) {
  FakeCoordinator a, b;
  std::mutex mutex;
  std::set<Endpoint> there = {{a.address(), "farm:1"}};
  RunningWorker worker("farm:1");
  worker.options.resolve = [&](const HostPort&) -> Result<std::set<Endpoint>> {
    const std::lock_guard lock(mutex);
    if (there.empty()) return Error{"not known"};
    return there;
  };
  const auto set = [&](std::set<Endpoint> endpoints) {
    const std::lock_guard lock(mutex);
    there = std::move(endpoints);
  };
  a.add_segments(10);
  worker.start();
  EXPECT_TRUE(eventually([&] { return a.account().delivered == 10; })) << worker.log();
  set({{a.address(), "farm:1"}, {b.address(), "farm:1"}});
  b.add_segments(10);
  EXPECT_TRUE(eventually([&] { return b.account().delivered == 10; })) << worker.log();
  set({});  // a resolver that fails says nothing
  a.add_segments(10);
  EXPECT_TRUE(eventually([&] { return a.account().delivered == 20; })) << worker.log();
  set({{b.address(), "farm:1"}});
  const auto gone = [&] { return worker.log().find("is gone") != std::string::npos; };
  ASSERT_TRUE(eventually(gone)) << worker.log();
  b.add_segments(10);
  EXPECT_TRUE(eventually([&] { return b.account().delivered == 20; }));
  a.add_segments(10);
  b.add_segments(10);
  EXPECT_TRUE(eventually([&] { return b.account().delivered == 30; }));
  EXPECT_EQ(a.account().delivered, 20) << "nobody asks there any more";
}

TEST(Farm, TwoAddressesOfOneCoordinatorCountOnce) {
  FakeCoordinator farm;
  RunningWorker worker("farm:1");
  worker.options.resolve = [&](const HostPort&) -> Result<std::set<Endpoint>> {
    return std::set<Endpoint>{{farm.address(), "farm:1"}, {farm.second_address(), "farm:1"}};
  };
  worker.start();
  const auto seen = [&] { return worker.log().find("another address") != std::string::npos; };
  ASSERT_TRUE(eventually(seen)) << worker.log();
  EXPECT_TRUE(eventually([&] { return farm.account().waiting == 1; })) << worker.log();
  farm.add_segments(40);
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == 40; })) << worker.log();
}

TEST(Farm, LeasesAreWithheldWhileTwoBatchesAreInFlight) {
  FakeCoordinator farm;
  RunningWorker worker(farm.address());
  worker.start();
  farm.hang_deliveries(true);
  farm.add_segments(1000);
  ASSERT_TRUE(eventually([&] { return farm.account().grants.size() == 2; })) << worker.log();
  std::this_thread::sleep_for(1s);
  EXPECT_EQ(farm.account().grants.size(), 2U);
  farm.hang_deliveries(false);
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == 1000; })) << worker.log();
}

TEST(Farm, SegmentsAreCollectedOverLeasesAndRenewedMeanwhile) {
  FakeCoordinator farm;
  farm.seal_every(600);
  farm.add_segments(40, 5000);
  RunningWorker worker(farm.address());
  worker.start();
  ASSERT_TRUE(eventually([&] { return farm.account().delivered == 40; })) << worker.log();
  const FakeCoordinator::Account account = farm.account();
  EXPECT_GT(account.grants.size(), 2U);
  EXPECT_EQ(account.batches, 1) << "delivered at once when there is no more work";
  EXPECT_GT(account.most_renewed, account.most_granted) << "of earlier leases, too";
  farm.seal_every(1e-9);
  farm.add_segments(40, 1000);
  ASSERT_TRUE(eventually([&] { return farm.account().delivered == 80; })) << worker.log();
  EXPECT_EQ(farm.account().batches - 1, int(farm.account().grants.size() - account.grants.size()));
}

TEST(Farm, ATimeToCollectIsKeptTo) {
  FakeCoordinator farm;
  farm.seal_every(0.3);
  farm.add_segments(400, 5000);
  RunningWorker worker(farm.address());
  worker.start();
  ASSERT_TRUE(eventually([&] { return farm.account().batches >= 2; })) << worker.log();
  EXPECT_GT(farm.account().open, 0) << "there was more to collect";
}

TEST(Farm, WhatIsCollectedIsDeliveredBeforeTheWorkerLeaves) {
  FakeCoordinator farm;
  farm.seal_every(600);
  farm.add_segments(400, 5000);
  RunningWorker worker(farm.address());
  worker.start();
  ASSERT_TRUE(eventually([&] { return farm.account().grants.size() >= 3; })) << worker.log();
  EXPECT_EQ(farm.account().batches, 0);
  EXPECT_EQ(worker.finish(), 0);
  const FakeCoordinator::Account account = farm.account();
  EXPECT_EQ(account.batches, 1);
  EXPECT_EQ(account.delivered + account.released, account.granted);
  EXPECT_GE(account.delivered, 4) << "two leases were rendered before";
}

// What the interrupted segment has left in the film must not be delivered; what else was in it is
// rendered again.
TEST(Farm, WhatWasInTheFilmOfAnInterruptedSegmentIsRenderedAgain) {
  constexpr int kWanted = 8;
  const auto film_of = [](FakeCoordinator& farm) {
    RunningWorker worker(farm.address());
    worker.start();
    EXPECT_TRUE(eventually([&] {
      const auto account = farm.account();
      return account.delivered == kWanted || account.unsound > 0;
    })) << worker.log();
    return farm.film();
  };
  FakeCoordinator undisturbed;
  undisturbed.add_segments(kWanted);
  const std::vector<int64_t> expected = film_of(undisturbed);
  EXPECT_GT(*std::max_element(expected.begin(), expected.end()), 0);

  FakeCoordinator farm;
  farm.seal_every(600);
  farm.add_segments(kWanted);
  // As large as a segment can be that goes into the film of others: it takes many seconds.
  constexpr uint64_t kLong = (uint64_t{1} << 20) - 1000;
  farm.add_segments(1, kLong);
  std::jthread nobody_wants_it([&] {
    EXPECT_TRUE(eventually([&] { return farm.account().granted == kWanted + 1; }));
    std::this_thread::sleep_for(500ms);
    farm.withdraw(kLong);
  });
  EXPECT_EQ(film_of(farm), expected);
  EXPECT_EQ(farm.account().unsound, 0);
  EXPECT_GT(farm.account().released, 0) << "the others were in the same film";
}

TEST(Farm, ASegmentWhoseLeaseIsLostIsFinished) {
  constexpr int kWanted = 8;
  FakeCoordinator farm;
  farm.seal_every(600);
  farm.add_segments(kWanted);
  constexpr uint64_t kLong = uint64_t{1} << 16;  // a second or two
  farm.add_segments(1, kLong);
  std::jthread somebody_else_has_it([&] {
    EXPECT_TRUE(eventually([&] { return farm.account().granted == kWanted + 1; }));
    std::this_thread::sleep_for(300ms);
    farm.withdraw(kLong, farm::v1::DIRECTIVE_ABANDON);
  });
  RunningWorker worker(farm.address());
  worker.start();
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == kWanted; })) << worker.log();
  EXPECT_EQ(farm.account().released, 0) << "nothing is rendered again";
}

TEST(Farm, ADrainedWorkerFinishesAndLeaves) {
  FakeCoordinator farm;
  farm.add_segments(10);
  RunningWorker worker(farm.address());
  worker.start();
  ASSERT_TRUE(eventually([&] { return farm.account().delivered > 0; })) << worker.log();
  farm.drain();
  EXPECT_TRUE(eventually([&] { return worker.ended(); })) << worker.log();
  EXPECT_EQ(worker.wait(), 0);
  EXPECT_EQ(farm.account().left, 1);
}

TEST(Farm, ABadSceneFailsItsTasksAndNothingElse) {
  FakeCoordinator bad, good;
  bad.set_scene("<scene version=\"3.0.0\"><nonsense/></scene>");
  bad.add_segments(1);
  RunningWorker worker(bad.address() + "," + good.address());
  worker.start();
  ASSERT_TRUE(eventually([&] { return !bad.account().failures.empty(); })) << worker.log();
  const auto failure = bad.account().failures[0];
  EXPECT_EQ(failure.reason(), farm::v1::FAILURE_REASON_SCENE);
  EXPECT_NE(failure.message().find("scene.xml:1"), std::string::npos) << failure.message();
  good.add_segments(10);
  EXPECT_TRUE(eventually([&] { return good.account().delivered == 10; })) << worker.log();
}

TEST(Farm, ASceneThatIsTooLargeFailsItsTasks) {
  FakeCoordinator farm;
  RunningWorker worker(farm.address());
  worker.options.scenes.scene_memory = 10;  // bytes
  farm.add_segments(1);
  worker.start();
  ASSERT_TRUE(eventually([&] { return !farm.account().failures.empty(); })) << worker.log();
  EXPECT_NE(farm.account().failures[0].message().find("10 bytes of memory"), std::string::npos)
      << farm.account().failures[0].message();
}

// The file is small, its tree is not; the worker lives on and renders what fits.
TEST(Farm, ATreeThatIsTooLargeFailsItsTasks) {
  FakeCoordinator large, small;
  std::string xml =
      R"(<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>)";
  for (int i = 0; i < 1000; ++i) xml += R"(<shape type="cube"/>)";
  large.set_scene(xml + "</scene>");
  large.add_segments(1);
  RunningWorker worker(large.address() + "," + small.address());
  worker.options.scenes.scene_memory = 1'300'000;
  worker.start();
  ASSERT_TRUE(eventually([&] { return !large.account().failures.empty(); })) << worker.log();
  const auto failure = large.account().failures[0];
  EXPECT_EQ(failure.reason(), farm::v1::FAILURE_REASON_WORKER);
  EXPECT_NE(failure.message().find("acceleration structure"), std::string::npos)
      << failure.message();
  small.add_segments(10);
  EXPECT_TRUE(eventually([&] { return small.account().delivered == 10; })) << worker.log();
}

}  // namespace
}  // namespace metrofarm::rpc
