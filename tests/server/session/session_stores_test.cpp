// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_stores.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <filesystem>
#include <future>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/session/session_reader.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::plain_frame;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

class SessionStoresTest : public test::EventLoop {
 protected:
  using Answer = std::optional<Result<bool>>;
  inline static const std::vector<Sample> kSamples{{5, {1, 2, 3}, {}, {}}};

  ~SessionStoresTest() override { end_work(); }

  Result<SessionStores::Opened> open(const std::string& session) {
    std::optional<Result<SessionStores::Opened>> opened;
    stores_.async_open({"r", session, ""},
                       [&](auto outcome) { opened.emplace(std::move(outcome)); });
    EXPECT_TRUE(run_until([&] { return opened.has_value(); }));
    return std::move(opened).value_or(Error{"no answer"});
  }
  void deliver(const SessionStores::Opened& opened, Sequence number) {
    Answer answer;
    opened.store->run(
        [number](SessionStore& store) -> Result<bool> {
          if (auto error = store.write(plain_frame(number), 0)) return std::move(*error);
          return true;
        },
        [&](const Result<bool>& written) { answer = written; });
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    EXPECT_TRUE(answer && *answer);
  }
  /// A session of these frames, which is closed.
  void record(const std::string& session, const std::vector<Sequence>& numbers) {
    const auto opened = open(session);
    for (const Sequence number : numbers) deliver(opened.value(), number);
    stores_.on_closed("r", session);
  }
  void send_late(Answer& answer, const std::string& session, const EncodedFrame& frame) {
    stores_.write_late("r", {session, frame}, waiter_,
                       [&answer](Result<bool> kept) { answer.emplace(std::move(kept)); });
  }
  Result<bool> late(const std::string& session, const EncodedFrame& frame) {
    Answer answer;
    send_late(answer, session, frame);
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    return answer.value_or(Error{"no answer"});
  }
  void send_samples(Answer& answer, const std::string& session, wire::StreamId stream) {
    stores_.write_late("r", {session, {}, wire::Items{stream, 0, wire::encode_samples(kSamples)}},
                       waiter_, [&answer](Result<bool> kept) { answer.emplace(std::move(kept)); });
  }
  std::uintmax_t journal_bytes(const std::string& session) const {
    return fs::file_size(folder(session) / "journal.000000");
  }
  Result<bool> account(const std::string& session, Sequence captured, std::uint64_t held) {
    wire::Account account;
    account.session_id = session;
    account.is_final = true;
    account.captured = captured;
    account.held = held;
    Answer answer;
    stores_.take_account("r", account, waiter_,
                         [&](Result<bool> kept) { answer.emplace(std::move(kept)); });
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    return answer.value_or(Error{"no answer"});
  }
  fs::path folder(const std::string& session) const { return parent_ / "r" / session; }
  /// Of times.txt.
  std::vector<Sequence> listed(const std::string& session) const {
    std::vector<Sequence> numbers;
    for (const std::string& line : test::read_lines(folder(session) / "times.txt")) {
      numbers.push_back(std::stoull(line));
    }
    return numbers;
  }
  std::string image(const std::string& session, Sequence number) const {
    return test::read_file(folder(session) / fmt::format("images/{:06}.jpg", number));
  }

  test::TemporaryFolder parent_;
  SessionStores stores_{main_, files_, parent_.path(), Durability::kAck, nullptr};
  std::shared_ptr<void> waiter_ = std::make_shared<int>();
};

TEST_F(SessionStoresTest, ASessionIsOpenedWhereItWasLeft) {
  EXPECT_EQ(open("s").value().position, wire::Position{});
  record("s", {0, 1});
  EXPECT_EQ(open("s").value().position, (wire::Position{2, 0}));
}

TEST_F(SessionStoresTest, ASessionThatCannotBeReadIsAnError) {
  fs::create_directories(folder("s") / "journal.000000");
  EXPECT_FALSE(open("s"));
  fs::remove(folder("s") / "journal.000000");
  EXPECT_TRUE(open("s"));
}

TEST_F(SessionStoresTest, LateFramesOfTheOpenSessionGoToItsStore) {
  const auto opened = open("s");
  EXPECT_TRUE(late("s", plain_frame(0)).value());  // before any live one
  deliver(opened.value(), 2);
  EXPECT_TRUE(late("s", plain_frame(1)).value());
  EXPECT_FALSE(late("s", plain_frame(1)).value());
  EXPECT_FALSE(late("s", plain_frame(2)).value());  // delivered live
  deliver(opened.value(), 3);
  EXPECT_THAT(listed("s"), ElementsAre(2, 3));
  stores_.on_closed("r", "s");
  EXPECT_EQ(open("s").value().position, (wire::Position{4, 0}));
  EXPECT_THAT(listed("s"), ElementsAre(0, 1, 2, 3));
}

TEST_F(SessionStoresTest, AnEarlierSessionIsCompleteWhenTheRobotHoldsNoMoreOfIt) {
  const test::CapturedLog log;
  record("earlier", {0, 3});
  ASSERT_TRUE(open("present"));
  EXPECT_TRUE(account("earlier", 4, 2));
  EXPECT_TRUE(stores_.is_expected("r", "earlier"));
  EXPECT_TRUE(late("earlier", plain_frame(2)).value());
  EXPECT_TRUE(late("earlier", plain_frame(1)).value());
  EXPECT_THAT(listed("earlier"), ElementsAre(0, 3));
  EXPECT_TRUE(account("earlier", 4, 0));
  EXPECT_FALSE(stores_.is_expected("r", "earlier"));
  // The views are made before the account is acknowledged.
  EXPECT_THAT(listed("earlier"), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(log.lines("r earlier: 2 late frames have completed the session"), SizeIs(1));
}

TEST_F(SessionStoresTest, NothingThatIsThereIsOverwritten) {
  const test::CapturedLog log;
  record("earlier", {0});
  EXPECT_FALSE(late("earlier", plain_frame(0, 500)).value());
  EXPECT_EQ(image("earlier", 0), test::as_text(plain_frame(0).jpeg));
  EXPECT_THAT(log.lines("frame 0 came again with other bytes"), SizeIs(1));
}

TEST_F(SessionStoresTest, AFrameOfASessionThatIsNotKnownIsRefused) {
  ASSERT_TRUE(open("present"));
  const auto kept = late("unknown", plain_frame(0));
  ASSERT_FALSE(kept);
  EXPECT_THAT(kept.error().text, HasSubstr("session unknown"));
  EXPECT_FALSE(fs::exists(folder("unknown")));
}

TEST_F(SessionStoresTest, AnAccountMakesASessionKnown) {
  ASSERT_TRUE(open("present"));
  EXPECT_TRUE(account("spooled", 3, 3));
  EXPECT_TRUE(late("spooled", plain_frame(0)).value());
  EXPECT_EQ(read_summary(folder("spooled"))->captured(), 3U);
}

TEST_F(SessionStoresTest, NumbersFarBeyondTheSessionAreRefused) {
  record("earlier", {0});
  constexpr Sequence kFar = Sequence{1} << 33;
  EncodedFrame far = plain_frame(0);
  far.sequence = kFar;
  EXPECT_FALSE(late("earlier", std::move(far)));
  EXPECT_FALSE(account("earlier", kFar, 1));
  EXPECT_EQ(read_summary(folder("earlier"))->captured(), 1U);
  EXPECT_TRUE(late("earlier", plain_frame(1)).value());
}

/// C6: as many as an account may name count against other earlier ones only, also when they are
/// over: each has a folder.
TEST_F(SessionStoresTest, TheLimitOfNamedSessionsLeavesThePresentOneAlone) {
  ASSERT_TRUE(open("present"));
  EXPECT_TRUE(account("earlier", 1, 1));
  constexpr Sequence kFar = Sequence{1} << 33;  // refused, so that it makes no folder
  for (std::size_t i = 1; i < SessionStores::kMostNamed; ++i) {
    EXPECT_FALSE(account("s" + std::to_string(i), kFar, 1));
  }
  EXPECT_TRUE(account("present", 1, 0));
  EXPECT_TRUE(account("earlier", 1, 0));
  EXPECT_FALSE(account("another", 1, 0));
  EXPECT_FALSE(fs::exists(folder("another")));
}

TEST_F(SessionStoresTest, AReportDoesNotLetALateFrameLieFarBeyond) {
  record("earlier", {0, 2});
  const wire::Stats stats{std::numeric_limits<std::uint64_t>::max(), 0, 0, 0, 0, 0, 0};
  EXPECT_FALSE(SessionStore::open(folder("earlier"), {"r", "earlier", ""}, Durability::kAck)
                   .value()
                   ->note({stats, 0}));
  constexpr Sequence kFar = Sequence{1} << 40;
  EncodedFrame far = plain_frame(0);
  far.sequence = kFar;
  EXPECT_FALSE(late("earlier", std::move(far)));
}

TEST_F(SessionStoresTest, AFullDiskHoldsALateFrameUntilThereIsRoom) {
  const test::CapturedLog log;
  record("earlier", {0});
  Answer answer;
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 1000);
    send_late(answer, "earlier", plain_frame(1, 5000));
    EXPECT_TRUE(run_until([&] { return !log.lines("r: late frames paused: write ").empty(); }));
    EXPECT_FALSE(answer);
  }
  ASSERT_TRUE(run_until([&] { return answer.has_value(); }));
  EXPECT_TRUE(answer->value());
  EXPECT_EQ(log.lines("r: late frames paused").size(), 1U);
  EXPECT_EQ(log.lines("r: late frames of session earlier go on").size(), 1U);
}

TEST_F(SessionStoresTest, WhoDoesNotWaitAnyMoreGetsNoAnswer) {
  record("earlier", {0});
  Answer answer;
  send_late(answer, "earlier", plain_frame(1));
  waiter_ = std::make_shared<int>();
  EXPECT_FALSE(late("earlier", plain_frame(1)).value());  // behind it, and it was written
  EXPECT_FALSE(answer);
}

/// A sync takes seconds while somebody copies a large file: who counts what is being written must
/// not wait for it.
TEST_F(SessionStoresTest, WhatIsWrittenIsToldBeforeItIsSynced) {
  std::promise<void> may_end;
  GroupCommit commit(
      main_,
      [&]() -> std::optional<Error> {
        may_end.get_future().wait();
        return std::nullopt;
      },
      std::chrono::milliseconds(0), "");
  SessionStores stores(main_, files_, parent_.path(), Durability::kAck, &commit);
  record("earlier", {0});
  bool is_written = false;
  Answer kept;
  stores.write_late(
      "r", {"earlier", plain_frame(1)}, waiter_,
      [&](Result<bool> is_new) { kept.emplace(std::move(is_new)); }, [&] { is_written = true; });
  EXPECT_TRUE(run_until([&] { return is_written; }));
  EXPECT_FALSE(kept);
  may_end.set_value();
  EXPECT_TRUE(run_until([&] { return kept.has_value(); }));
}

/// The account was refused by a full disk, and room for a frame has come before it is tried again.
TEST_F(SessionStoresTest, SamplesOfAStreamThatIsNotKnownYetWaitForTheAccount) {
  const test::CapturedLog log;
  record("earlier", {0});
  wire::Account account;
  account.session_id = "earlier";
  account.captured = 1;
  account.streams = {{{4, "imu0", "imu"}, 1, 1}};
  Answer of_account;
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, journal_bytes("earlier") + 3);
    stores_.take_account("r", account, waiter_,
                         [&](Result<bool> kept) { of_account.emplace(std::move(kept)); });
    EXPECT_TRUE(run_until([&] { return !log.lines("late frames paused").empty(); }));
  }
  Answer answer;
  send_samples(answer, "earlier", 4);
  EXPECT_FALSE(late("earlier", plain_frame(0)).value());  // behind them
  EXPECT_FALSE(answer);
  EXPECT_FALSE(of_account);
  EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
  EXPECT_TRUE(answer->value());
  EXPECT_TRUE(of_account);
  std::vector<Sample> read;
  const auto totals = for_each_sample(folder("earlier"), account.streams[0].stream,
                                      [&](const Sample& sample) { read.push_back(sample); });
  EXPECT_TRUE(totals);
  EXPECT_EQ(read, kSamples);
}

/// The robot's record has it, and no account will.
TEST_F(SessionStoresTest, SamplesOfAStreamThatTheSessionHasNotHoldNothing) {
  const test::CapturedLog log;
  record("earlier", {0, 2});
  Answer answer;
  for (int i = 0; i < 2; ++i) {
    answer.reset();
    send_samples(answer, "earlier", 9);
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    EXPECT_FALSE(answer->value());  // it is nothing new
  }
  EXPECT_TRUE(account("earlier", 3, 1));
  send_samples(answer, "earlier", 9);
  EXPECT_TRUE(late("earlier", plain_frame(1)).value());
  EXPECT_EQ(log.lines("r: late samples are not kept, of a stream that session earlier has not; 1 "
                      "so far")
                .size(),
            1U);
}

TEST_F(SessionStoresTest, StoresThatAreNotUsedAreClosed) {
  constexpr std::size_t kSessions = SessionStores::kMostIdle + 10;
  const auto name = [](std::size_t i) { return "s" + std::to_string(i); };
  for (std::size_t i = 0; i < kSessions; ++i) {
    EXPECT_TRUE(account(name(i), 9, 1));
    EXPECT_TRUE(late(name(i), plain_frame(0)).value());
  }
  std::size_t open_journals = 0;
  for (const auto& entry : fs::directory_iterator("/proc/self/fd")) {
    std::error_code closed;
    const auto target = fs::read_symlink(entry, closed).string();
    if (target.starts_with(parent_.path().string()) && target.ends_with("journal.000000")) {
      ++open_journals;
    }
  }
  EXPECT_EQ(open_journals, SessionStores::kMostIdle);
  EXPECT_TRUE(late(name(0), plain_frame(1)).value());
  EXPECT_FALSE(late(name(0), plain_frame(0)).value());
}

TEST_F(SessionStoresTest, StoppingMakesTheViewsOfSessionsWithoutALiveStream) {
  record("earlier", {0});
  EXPECT_TRUE(late("earlier", plain_frame(1)).value());
  EXPECT_THAT(listed("earlier"), ElementsAre(0));
  stores_.stop();
  EXPECT_TRUE(run_until([&] { return listed("earlier").size() == 2; }));
  files_.join();
  run_ready();  // the answer, before its strand's threads go
}

}  // namespace
}  // namespace orbbuf
