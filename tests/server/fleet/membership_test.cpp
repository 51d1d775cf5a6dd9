// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/membership.hpp"

#include <gtest/gtest.h>

#include "testing/captured_log.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/fleet/fake_key_store.hpp"

namespace orbbuf::fleet {
namespace {

class MembershipTest : public test::EventLoop {
 protected:
  /// Its beats follow one another at once, unless a test sets `lease_`.
  void start() {
    member_ = std::make_unique<Membership>(main_, store_,
                                           ServerEntry{"a", "1", "a:7722", "", 0, false, "here"},
                                           lease_, [this] { return robots_; });
    member_->start();
  }
  /// The next request is answered.
  void deliver() {
    ASSERT_TRUE(run_until([&] { return store_.sent() == 1; }));
    store_.deliver();
  }
  void add(const ServerEntry& other) {
    keys_.keys[other.key()] = {other.key(), to_text(other), ++keys_.revision};
  }
  std::optional<ServerEntry> written() const {
    const auto found = keys_.keys.find("/orbbuf/server/a");
    return found == keys_.keys.end() ? std::nullopt
                                     : server_from(found->first, found->second.value);
  }

  test::FakeKeys keys_;
  test::FakeKeyStore store_{keys_};
  std::uint64_t robots_ = 2;
  std::chrono::seconds lease_{0};
  std::unique_ptr<Membership> member_;
};

TEST_F(MembershipTest, ItWritesItsKeyUnderALeaseAndReadsTheOthers) {
  add({"b", "9", "b:7722", "", 5});
  start();
  deliver();  // the lease
  deliver();  // the key
  EXPECT_EQ(written()->robots, 2U);
  deliver();  // the others
  EXPECT_EQ(member_->servers().size(), 2U);
  EXPECT_EQ(member_->servers().at("b").address, "b:7722");
  robots_ = 3;
  deliver();  // keeps alive
  deliver();
  EXPECT_EQ(written()->robots, 3U);
}

TEST_F(MembershipTest, AfterItsLeaseItBeginsAgain) {
  const test::CapturedLog log;
  start();
  for (int i = 0; i < 3; ++i) deliver();
  keys_.keys.clear();
  store_.is_lease_over = true;
  for (int i = 0; i < 3; ++i) deliver();  // no lease, a new one, the key
  EXPECT_TRUE(written());
  EXPECT_EQ(store_.granted, 2);
  EXPECT_EQ(log.lines("lease has run out").size(), 1U);
}

TEST_F(MembershipTest, WithoutAnAnswerItTriesOnAndSaysSoOnce) {
  const test::CapturedLog log;
  start();
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(run_until([&] { return store_.sent() == 1; }));
    store_.fail();
  }
  for (int i = 0; i < 3; ++i) deliver();
  EXPECT_TRUE(written());
  EXPECT_EQ(log.lines("new sessions wait").size(), 1U);
  EXPECT_EQ(log.lines("in touch with etcd again").size(), 1U);
}

TEST_F(MembershipTest, TheLeastLoadedOtherTakesRobots) {
  start();
  for (int i = 0; i < 3; ++i) deliver();
  EXPECT_FALSE(member_->least_loaded_other());
  add({"b", "9", "b:7722", "", 5});
  add({"c", "9", "c:7722", "", 4});
  add({"d", "9", "d:7722", "", 1, true});
  for (int i = 0; i < 2; ++i) deliver();
  EXPECT_EQ(member_->least_loaded_other()->name, "c");
}

TEST_F(MembershipTest, ADrainIsWrittenAtOnce) {
  start();
  for (int i = 0; i < 3; ++i) deliver();
  bool is_known = false;
  const auto for_ever = std::chrono::steady_clock::time_point::max();
  member_->async_drain(for_ever, [&](const auto& error) { is_known = !error; });
  ASSERT_FALSE(is_known);
  while (!is_known) store_.deliver();
  EXPECT_TRUE(written()->is_draining);
}

TEST_F(MembershipTest, ADrainMayEnd) {
  start();
  for (int i = 0; i < 3; ++i) deliver();
  bool is_known = false;
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(300);
  member_->async_drain(end, [&](const auto& error) { is_known = !error; });
  while (!is_known) store_.deliver();
  EXPECT_TRUE(written()->is_draining);
  while (written()->is_draining) deliver();
  EXPECT_GE(std::chrono::steady_clock::now(), end);
}

/// B3
TEST_F(MembershipTest, ItDoesNotBeginBesideAnotherServerOfItsName) {
  add({"a", "other instance", "x:1", "", 0, false, "elsewhere"});
  start();
  deliver();
  try {
    deliver();
    FAIL() << "it goes on";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()),
              "fleet.name: another server of the fleet, x:1, has the name a, too; give this one "
              "another name");
  }
  EXPECT_EQ(written()->instance, "other instance");
  EXPECT_FALSE(member_->has_joined());
}

TEST_F(MembershipTest, ItWaitsForTheEndOfTheLeaseOfOneThatHasDied) {
  lease_ = std::chrono::seconds(1);
  add({"a", "other instance", "x:1", "", 0, false, "elsewhere"});
  start();
  deliver();
  deliver();
  EXPECT_FALSE(member_->has_joined());
  keys_.keys.clear();
  for (int i = 0; i < 3; ++i) deliver();  // keeps alive, finds no key, writes it
  EXPECT_TRUE(member_->has_joined());
  EXPECT_EQ(written()->instance, "1");
}

TEST_F(MembershipTest, StartedAgainInItsFolderItReplacesItsKeyAtOnce) {
  add({"a", "before", "a:7722", "", 0, false, "here"});
  start();
  for (int i = 0; i < 3; ++i) deliver();  // the lease, finds its key, writes it
  EXPECT_TRUE(member_->has_joined());
  EXPECT_EQ(written()->instance, "1");
}

TEST_F(MembershipTest, OneThatRunsDoesNotReplaceATwinAndGoesOnWhenThatIsGone) {
  const test::CapturedLog log;
  start();
  for (int i = 0; i < 2; ++i) deliver();
  add({"a", "other instance", "x:1", "", 0, false, "elsewhere"});
  for (int i = 0; i < 3; ++i) deliver();  // sees it, keeps alive, is refused
  EXPECT_FALSE(member_->has_joined());
  EXPECT_EQ(written()->instance, "other instance");
  EXPECT_EQ(log.lines("has the name a, too").size(), 1U);
  keys_.keys.clear();
  for (int i = 0; i < 3; ++i) deliver();
  EXPECT_TRUE(member_->has_joined());
}

TEST_F(MembershipTest, AStopGivesUpTheLease) {
  start();
  for (int i = 0; i < 3; ++i) deliver();
  bool is_stopped = false;
  member_->async_stop([&] { is_stopped = true; });
  store_.deliver_all();
  run_ready();
  EXPECT_TRUE(is_stopped);
  EXPECT_EQ(store_.revoked, 1);
}

TEST_F(MembershipTest, AStopDoesNotDependOnAnAnswer) {
  start();
  for (int i = 0; i < 3; ++i) deliver();
  bool is_stopped = false;
  member_->async_stop([&] { is_stopped = true; });
  EXPECT_TRUE(run_until([&] { return is_stopped; }));
}

}  // namespace
}  // namespace orbbuf::fleet
