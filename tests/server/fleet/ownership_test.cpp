// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/ownership.hpp"

#include <gtest/gtest.h>

#include "server/fleet/position_recorder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/fleet/fake_key_store.hpp"

namespace orbbuf::fleet {
namespace {

using test::FakeKeys;
using test::FakeKeyStore;

const SessionName kSession{"robot", "session"};

/// A server of the fleet, whose way to the keys the test walks.
struct Server {
  Server(boost::asio::io_context& main, FakeKeys& keys, const std::string& name,
         const std::string& instance = "1")
      : store(keys),
        ownership(store, name, instance, [this] { return now; }),
        recorder(main, store, std::chrono::milliseconds(0)) {}

  void ask(const std::optional<std::string>& better = std::nullopt) {
    answer.reset();
    ownership.async_acquire(
        kSession, on_disk, [better] { return better; }, [this](const auto& got) { answer = got; });
  }
  Owned acquire() {
    ask();
    store.deliver_all();
    return std::get<Owned>(answer->value());
  }
  void record(const Owned& owned, const wire::Position& position) {
    acknowledged.reset();
    recorder.async_record(owned.claim, position, [this](bool is_ours) { acknowledged = is_ours; });
  }

  std::chrono::nanoseconds now{0};
  std::optional<OnDisk> on_disk;
  FakeKeyStore store;
  Ownership ownership;
  PositionRecorder recorder;
  std::optional<Result<std::variant<Owned, Foreign>>> answer;
  std::optional<bool> acknowledged;  // as the recorder says
};

class OwnershipTest : public test::EventLoop {
 protected:
  FakeKeys keys_;
  Server a_{main_, keys_, "a"};
  Server b_{main_, keys_, "b"};
};

TEST_F(OwnershipTest, ANewSessionIsOfEpochOneAndBeginsAtZero) {
  const Owned owned = a_.acquire();
  EXPECT_EQ(owned.epoch, 1U);
  EXPECT_EQ(owned.segment, (Segment{"a", 1, {}}));
  EXPECT_EQ(owned.recorded, wire::Position{});
  EXPECT_EQ(a_.acquire().claim.owner, owned.claim.owner);  // it stays ours
}

TEST_F(OwnershipTest, ANewSessionMayBeAnotherServers) {
  a_.ask("b");
  a_.store.deliver_all();
  EXPECT_EQ(std::get<Foreign>(a_.answer->value()).server, "b");
  EXPECT_TRUE(keys_.keys.empty());
}

TEST_F(OwnershipTest, OfTwoThatWantANewSessionOneBeginsItAndTheOtherTakesItOver) {
  a_.ask();
  b_.ask();
  a_.store.deliver();
  b_.store.deliver();  // both have read that there is none
  b_.store.deliver_all();
  a_.store.deliver_all();
  EXPECT_EQ(std::get<Owned>(b_.answer->value()).epoch, 1U);
  EXPECT_EQ(std::get<Owned>(a_.answer->value()).epoch, 2U);
}

TEST_F(OwnershipTest, OnlyANewSessionMayBeAnotherServers) {
  a_.acquire();
  b_.ask("a");
  b_.store.deliver_all();
  EXPECT_TRUE(std::holds_alternative<Owned>(b_.answer->value()));
  EXPECT_EQ(b_.ownership.take_overs(), 1U);
}

TEST_F(OwnershipTest, ATakeOverBeginsASegmentWhereTheRecordStands) {
  const Owned first = a_.acquire();
  a_.record(first, {10, 2});
  ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));
  a_.store.deliver();
  EXPECT_EQ(a_.acknowledged, true);
  const Owned second = b_.acquire();
  EXPECT_EQ(second.epoch, 2U);
  EXPECT_EQ(second.segment, (Segment{"b", 2, {10, 2}}));
  EXPECT_EQ(second.recorded, (wire::Position{10, 2}));
  EXPECT_EQ(b_.ownership.take_overs(), 1U);
}

TEST_F(OwnershipTest, AServerThatIsStartedAgainGoesOnInItsSegment) {
  const Owned first = a_.acquire();
  Server again(main_, keys_, "a", "2");
  again.ask();  // nobody else's session
  again.store.deliver_all();
  const auto second = std::get<Owned>(again.answer->value());
  EXPECT_EQ(second.epoch, 2U);
  EXPECT_EQ(second.segment, first.segment);
  a_.record(first, {10, 0});  // by the process before, if it still runs
  ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));
  a_.store.deliver();
  EXPECT_EQ(a_.acknowledged, false);
}

TEST_F(OwnershipTest, ASessionThatComesBackHasAThirdSegment) {
  a_.acquire();
  b_.acquire();
  const Owned third = a_.acquire();
  EXPECT_EQ(third.segment.epoch, 3U);
  const auto owner = owner_from(keys_.keys.at(kSession.owner_key()).value);
  ASSERT_TRUE(owner);
  EXPECT_EQ(owner->segments.size(), 3U);
}

TEST_F(OwnershipTest, ATakeOversEpochIsTheTimeOfDayAndAboveTheOneBefore) {
  a_.acquire();
  b_.now = std::chrono::microseconds(5'000'900);
  EXPECT_EQ(b_.acquire().epoch, 5000U);
  a_.now = std::chrono::milliseconds(4999);  // its clock is behind
  EXPECT_EQ(a_.acquire().epoch, 5001U);
  b_.now = std::chrono::milliseconds(-1);
  EXPECT_EQ(b_.acquire().epoch, 5002U);
}

/// B4: the store knows nothing of what came since.
TEST_F(OwnershipTest, AfterTheStoreWentBackNoEpochComesAgain) {
  a_.acquire();
  const FakeKeys before = keys_;
  b_.now = std::chrono::milliseconds(7000);
  const Owned forgotten = b_.acquire();
  keys_ = before;
  Server c(main_, keys_, "c");
  c.now = std::chrono::milliseconds(7050);
  EXPECT_GT(c.acquire().epoch, forgotten.epoch);
  b_.record(forgotten, {9, 0});  // it was not stopped, and the revision is that of its claim
  ASSERT_TRUE(run_until([&] { return b_.store.sent() == 1; }));
  b_.store.deliver();
  EXPECT_EQ(b_.acknowledged, false);
}

/// Its journal knows more than the store.
TEST_F(OwnershipTest, ASegmentOnDiskThatTheStoreHasForgottenGoesOn) {
  a_.acquire();
  b_.now = std::chrono::milliseconds(7050);
  b_.on_disk = {{"b", 7000, {3, 0}}, {5, 0}};
  const Owned owned = b_.acquire();
  EXPECT_EQ(owned.segment, b_.on_disk->segment);
  EXPECT_EQ(owned.epoch, 7050U);
}

TEST_F(OwnershipTest, ASegmentOnDiskThatOthersHaveLeftBehindDoesNot) {
  const Owned first = a_.acquire();
  a_.record(first, {9, 0});
  ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));
  a_.store.deliver();
  b_.on_disk = {{"b", 7000, {3, 0}}, {5, 0}};
  const Owned owned = b_.acquire();
  EXPECT_EQ(owned.epoch, 7001U) << "above that on the disk, whatever the clock says";
  EXPECT_EQ(owned.segment, (Segment{"b", 7001, {9, 0}}));
}

TEST_F(OwnershipTest, ASessionThatTheStoreHasLostGoesOnWhereItIsOnDisk) {
  b_.on_disk = {{"b", 7000, {3, 0}}, {5, 0}};
  b_.ask("a");
  b_.store.deliver_all();
  const auto owned = std::get<Owned>(b_.answer->value());
  EXPECT_EQ(owned.segment, b_.on_disk->segment);
  EXPECT_EQ(owned.epoch, 7001U);
}

TEST_F(OwnershipTest, APositionThatIsRecordedWhileAnotherTakesOverIsNotLost) {
  const Owned first = a_.acquire();
  b_.ask();
  b_.store.deliver();  // has read the position
  a_.record(first, {10, 0});
  ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));
  a_.store.deliver();
  EXPECT_EQ(a_.acknowledged, true);
  b_.store.deliver_all();
  EXPECT_EQ(std::get<Owned>(b_.answer->value()).segment.from, (wire::Position{10, 0}));
}

TEST_F(OwnershipTest, ATakeOverWhoseAnswerIsLostIsOurs) {
  a_.acquire();
  b_.ask();
  b_.store.deliver();
  b_.store.arrive();
  b_.store.fail();  // as the channel reports it at last
  EXPECT_FALSE(*b_.answer);
  const Owned owned = b_.acquire();
  EXPECT_EQ(owned.epoch, 2U);
  EXPECT_EQ(owned.segment.server, "b");
}

TEST_F(OwnershipTest, TheEndIsNotedInTheKeyOfWhoOwnsIt) {
  const Owned first = a_.acquire();
  const Owned second = b_.acquire();
  a_.ownership.end(first);
  a_.store.deliver_all();
  EXPECT_FALSE(owner_from(keys_.keys.at(kSession.owner_key()).value)->has_ended);
  b_.ownership.end(second);
  b_.store.deliver_all();
  EXPECT_TRUE(owner_from(keys_.keys.at(kSession.owner_key()).value)->has_ended);
}

TEST_F(OwnershipTest, TheKeysOfAnEndedSessionGoWithALeaseUnlessTheRobotGoesOn) {
  const Owned first = a_.acquire();
  a_.record(first, {10, 2});
  ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));
  a_.store.deliver();
  a_.ownership.end(first);
  a_.store.deliver_all();
  EXPECT_NE(keys_.leases.at(kSession.owner_key()), 0);
  EXPECT_NE(keys_.leases.at(kSession.position_key()), 0);
  const Owned again = a_.acquire();
  EXPECT_EQ(again.recorded, (wire::Position{10, 2}));
  EXPECT_EQ(again.segment, first.segment);
  EXPECT_EQ(keys_.leases.at(kSession.owner_key()), 0);
  EXPECT_EQ(keys_.leases.at(kSession.position_key()), 0);
}

TEST_F(OwnershipTest, AKeyThatCannotBeReadIsNotTaken) {
  keys_.keys[kSession.owner_key()] = {kSession.owner_key(), "?", 5};
  a_.ask();
  a_.store.deliver_all();
  EXPECT_FALSE(*a_.answer);
}

/// At which step of its write the owner is paused, while another takes over.
enum class Step { kBeforeItIsSent, kBeforeItArrives, kBeforeTheAnswer, kAnswerLost };

class PausedOwner : public OwnershipTest, public testing::WithParamInterface<Step> {};

/// Whatever it acknowledges when it wakes, its successor has counted in.
TEST_P(PausedOwner, AcknowledgesNothingThatItsSuccessorDoesNotKnow) {
  const Owned first = a_.acquire();
  const wire::Position written{10, 2};
  const auto step = GetParam();
  const auto record = [&] {
    a_.record(first, written);
    ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));
  };
  if (step != Step::kBeforeItIsSent) record();
  if (step == Step::kBeforeTheAnswer || step == Step::kAnswerLost) a_.store.arrive();

  const Owned second = b_.acquire();  // the owner stands still

  if (step == Step::kBeforeItIsSent) record();
  if (step == Step::kAnswerLost) {
    a_.store.fail();
    ASSERT_TRUE(run_until([&] { return a_.store.sent() == 1; }));  // it tries again
  }
  EXPECT_FALSE(a_.acknowledged);
  a_.store.deliver();
  ASSERT_TRUE(a_.acknowledged);
  if (*a_.acknowledged) {
    EXPECT_EQ(second.recorded, written);
  }
  EXPECT_EQ(*a_.acknowledged, step == Step::kBeforeTheAnswer);
  // From here on nothing is recorded, and the successor's position stands.
  record();
  a_.store.deliver();
  EXPECT_EQ(a_.acknowledged, false);
  EXPECT_EQ(b_.acquire().recorded, second.recorded);
}

INSTANTIATE_TEST_SUITE_P(Steps, PausedOwner,
                         testing::Values(Step::kBeforeItIsSent, Step::kBeforeItArrives,
                                         Step::kBeforeTheAnswer, Step::kAnswerLost));

}  // namespace
}  // namespace orbbuf::fleet
