// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/position_recorder.hpp"

#include <gtest/gtest.h>

#include "testing/captured_log.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/fleet/fake_key_store.hpp"

namespace orbbuf::fleet {
namespace {

class PositionRecorderTest : public test::EventLoop {
 protected:
  void make(std::chrono::milliseconds interval) {
    recorder_ = std::make_unique<PositionRecorder>(main_, store_, interval);
  }
  void record(const std::string& session, std::uint64_t next = 1) {
    const SessionName name{"robot", session};
    keys_.keys.try_emplace(name.owner_key(), KeyValue{name.owner_key(), "we", 1});
    const auto claim = claims_.try_emplace(session, Claim{name, "we"}).first;
    recorder_->async_record(claim->second, {next, 0}, [this, session](bool is_ours) {
      answers_.push_back(session + (is_ours ? " ours" : " lost"));
    });
  }
  std::string recorded(const std::string& session) {
    return keys_.keys[SessionName{"robot", session}.position_key()].value;
  }
  bool is_sent() {
    return run_until([&] { return store_.sent() == 1; });
  }
  using Answers = std::vector<std::string>;

  test::FakeKeys keys_;
  test::FakeKeyStore store_{keys_};
  std::unique_ptr<PositionRecorder> recorder_;
  std::map<std::string, Claim> claims_;
  Answers answers_;
};

TEST_F(PositionRecorderTest, WhatComesWhileARequestIsOutstandingSharesTheNext) {
  make(std::chrono::milliseconds(1));
  record("a");
  ASSERT_TRUE(is_sent());
  record("b");
  record("c");
  run_ready();
  EXPECT_EQ(store_.sent(), 1U);
  store_.deliver();
  EXPECT_EQ(answers_, (Answers{"a ours"}));
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_, (Answers{"a ours", "b ours", "c ours"}));
  EXPECT_EQ(recorder_->records(), 3U);
  EXPECT_EQ(recorder_->requests(), 2U);
}

TEST_F(PositionRecorderTest, TheFirstDoesNotWaitAndHurryEndsTheWait) {
  make(std::chrono::hours(1));
  record("a");
  ASSERT_TRUE(is_sent());
  store_.deliver();
  record("b");
  main_.run_for(std::chrono::milliseconds(1));
  EXPECT_EQ(store_.sent(), 0U);
  recorder_->hurry();
  EXPECT_TRUE(is_sent());
}

TEST_F(PositionRecorderTest, OneThatHurriesBehindARequestIsSentWhenThatIsOver) {
  make(std::chrono::hours(1));
  record("a");
  ASSERT_TRUE(is_sent());
  record("b");
  recorder_->hurry();
  store_.deliver();
  EXPECT_TRUE(is_sent());
}

TEST_F(PositionRecorderTest, AClaimThatAnotherHasRecordsNothingAndTheOthersGoOn) {
  make(std::chrono::milliseconds(0));
  keys_.keys["/orbbuf/session/robot/a"] = {"/orbbuf/session/robot/a", "they", 7};
  record("a");
  record("b");
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_, (Answers{"a lost", "b ours"}));
  EXPECT_EQ(recorder_->conflicts(), 1U);
  EXPECT_FALSE(keys_.keys.contains("/orbbuf/position/robot/a"));
}

TEST_F(PositionRecorderTest, WithoutAnAnswerItTriesOnAndSaysSoOnce) {
  const test::CapturedLog log;
  make(std::chrono::milliseconds(0));
  record("a");
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(is_sent());
    store_.fail();
  }
  EXPECT_TRUE(answers_.empty());
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_, (Answers{"a ours"}));
  EXPECT_EQ(log.lines("nothing is acknowledged").size(), 1U);
  EXPECT_EQ(log.lines("answers again").size(), 1U);
}

/// It was sent again meanwhile, to another server of etcd.
TEST_F(PositionRecorderTest, ARequestThatIsCarriedOutLateDoesNotMoveThePositionBack) {
  make(std::chrono::milliseconds(0));
  record("a", 1);
  ASSERT_TRUE(is_sent());
  const auto late = store_.hold();
  ASSERT_TRUE(is_sent());
  store_.deliver();
  record("a", 2);
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_, (Answers{"a ours", "a ours"}));
  late();
  EXPECT_EQ(recorded("a"), to_text(wire::Position{2, 0}));
}

TEST_F(PositionRecorderTest, OneThatWasRecordedWithoutAnAnswerIsFoundToBeSo) {
  make(std::chrono::hours(1));
  record("a");
  ASSERT_TRUE(is_sent());
  store_.arrive();
  store_.fail();
  recorder_->hurry();
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_, (Answers{"a ours"}));
}

/// etcd went back to an older state.
TEST_F(PositionRecorderTest, APositionThatMovedIsGoneOnFrom) {
  make(std::chrono::milliseconds(0));
  record("a", 5);
  ASSERT_TRUE(is_sent());
  store_.deliver();
  const std::string key = SessionName{"robot", "a"}.position_key();
  keys_.keys[key] = {key, to_text(wire::Position{3, 0}), 1};
  record("a", 6);
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(is_sent());
    store_.deliver();
  }
  EXPECT_EQ(answers_, (Answers{"a ours", "a ours"}));
  EXPECT_EQ(recorded("a"), to_text(wire::Position{6, 0}));
}

TEST_F(PositionRecorderTest, MoreThanARequestTakesAreSeveral) {
  make(std::chrono::milliseconds(0));
  for (std::size_t i = 0; i < KeyStore::kMostTxns + 1; ++i) record(std::to_string(i));
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_.size(), KeyStore::kMostTxns);
  ASSERT_TRUE(is_sent());
  store_.deliver();
  EXPECT_EQ(answers_.size(), KeyStore::kMostTxns + 1);
}

TEST_F(PositionRecorderTest, AfterStopNothingIsRecordedAndNobodyIsTold) {
  make(std::chrono::milliseconds(0));
  record("a");
  ASSERT_TRUE(is_sent());
  recorder_->stop();
  record("b");
  store_.deliver();
  run_ready();
  EXPECT_TRUE(answers_.empty());
  EXPECT_EQ(store_.sent(), 0U);
}

}  // namespace
}  // namespace orbbuf::fleet
