// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/backfill.hpp"

#include <gtest/gtest.h>

#include <boost/asio/post.hpp>
#include <future>
#include <optional>
#include <thread>

#include "daemon/buffer/simple_policies.hpp"
#include "daemon/net/sender.hpp"
#include "testing/captured_log.hpp"
#include "testing/scripted_server.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using test::Message;
using wire::Type;

/// A sender with a record that keeps frames on its own thread, as `main` is, against a server that
/// the test plays. Its buffer has three frames and gives up the oldest.
class BackfillTest : public ::testing::Test {
 protected:
  BackfillTest() { link_.connect_timeout = std::chrono::minutes(1); }

  void start(const std::string& session = "s") {
    link_.servers.front().port = server_.port();
    wire::Hello hello;
    hello.robot_id = "r";
    hello.session_id = session;
    record_.emplace(settings(), "r", session,
                    [this] { asio::post(io_, [this] { sender_->wake(); }); });
    sender_ = std::make_unique<Sender>(io_, link_, hello, buffer_, *record_, samples_);
    push(0, 4);  // 0 and 1 go
    sender_->start();
    main_ = std::jthread([this] { io_.run(); });
  }
  RecordSettings settings() const { return {folder_ / "record", true}; }
  void push(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      buffer_.on_captured();
      buffer_.push(std::make_shared<EncodedFrame>(frame_of(sequence)));
    }
  }
  static EncodedFrame frame_of(Sequence sequence) {
    EncodedFrame frame;
    frame.sequence = sequence;
    frame.capture_time_ns = static_cast<std::int64_t>(sequence) * 1000;
    frame.jpeg.assign(40'000, static_cast<std::uint8_t>(sequence));
    frame.jpeg_crc = wire::crc32(frame.jpeg);
    return frame;
  }
  void welcome(const wire::Position& position, bool takes_late = true,
               std::uint32_t most_bytes = 0) {
    server_.accept();
    server_.read(Type::kHello);
    wire::Welcome welcome = test::welcome_at(position);
    welcome.max_frame_bytes = most_bytes;
    welcome.takes[wire::kLate] = takes_late;
    welcome.takes[wire::kAccounts] = true;
    server_.send(wire::encode(welcome));
    next_account_ = 0;
  }
  /// Reads live frames and acknowledges each at once.
  void take_live(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, sequence);
      ack(sequence + 1, 0, 0);
    }
  }
  /// The next items of that stream.
  wire::Items read_items(wire::StreamId stream) {
    while (true) {
      const Message message = server_.read(Type::kItems);
      auto items = wire::parse_items(message.header, message.body).value();
      if (items.stream == wire::kAccounts) next_account_ = items.first + 1;
      if (items.stream == stream) return items;
    }
  }
  /// The next late frame of the connection, and its number.
  wire::LateFrame read_late() {
    std::vector<std::uint8_t> record;
    while (true) {
      const wire::Items items = read_items(wire::kLate);
      const auto part = wire::parse_late_part(items.payload).value();
      EXPECT_EQ(part.offset, record.size());
      number_ = items.first;
      record.insert(record.end(), part.bytes.begin(), part.bytes.end());
      if (record.size() == part.record_bytes) return wire::parse_late_record(record).value();
    }
  }
  wire::Account read_account() {
    return wire::parse_account(read_items(wire::kAccounts).payload).value();
  }
  /// Until that session's account says that so many frames are held.
  wire::Account await_held(const std::string& session, std::uint64_t held) {
    while (true) {
      wire::Account account = read_account();
      if (account.session_id == session && account.held == held) return account;
    }
  }
  /// And of the accounts those that were read.
  void ack(Sequence frames, std::uint64_t drops, std::uint64_t late) {
    wire::Position position{frames, drops};
    position[wire::kLate] = late;
    position[wire::kAccounts] = next_account_;
    server_.ack(position);
  }
  void TearDown() override {
    asio::post(io_, [this] { io_.stop(); });
    if (main_.joinable()) main_.join();
    sender_.reset();
    record_.reset();
  }

  test::TemporaryFolder folder_;
  test::CapturedLog captured_;
  LinkSettings link_;
  test::ScriptedServer server_;
  FrameBuffer buffer_{{3}, std::make_unique<DropOldestPolicy>()};
  asio::io_context io_;
  std::optional<Record> record_;
  SampleStreams samples_{io_, {}, nullptr};
  std::unique_ptr<Sender> sender_;
  std::uint64_t number_ = 0;        // of the last late frame
  std::uint64_t next_account_ = 0;  // behind the last account read
  std::jthread main_;
};

TEST_F(BackfillTest, DroppedFramesComeLateWhenTheLiveOnesAreThere) {
  start();
  welcome({});
  take_live(2, 4);
  for (const Sequence sequence : {0U, 1U}) {
    const auto late = read_late();
    EXPECT_EQ(number_, sequence);
    EXPECT_EQ(late.session_id, "s");
    EXPECT_EQ(late.frame.sequence, sequence);
    EXPECT_EQ(late.frame.jpeg, frame_of(sequence).jpeg);
    EXPECT_EQ(late.frame.capture_time_ns, frame_of(sequence).capture_time_ns);
  }
}

TEST_F(BackfillTest, TheServerIsToldWhatTheRecordHoldsUntilThatIsNothing) {
  start();
  welcome({});
  // After two frames, which are not acknowledged yet: more may not be on their way.
  const wire::Account account = await_held("s", 2);
  EXPECT_EQ(account.first_held, 0U);
  EXPECT_FALSE(account.is_final);
  ack(4, 0, 0);
  take_live(4, 4);
  read_late();
  read_late();
  ack(5, 0, 2);
  await_held("s", 0);  // an account a second, as long as it changes
}

TEST_F(BackfillTest, WhatIsNotAcknowledgedComesAgainOnTheNextConnection) {
  start();
  welcome({});
  take_live(2, 4);
  read_late();
  read_late();
  ack(5, 0, 1);
  EXPECT_EQ(await_held("s", 1).first_held, 1U);  // so that the ack has come
  server_.close();
  welcome({5, 0});
  EXPECT_EQ(read_late().frame.sequence, 1U);
  EXPECT_EQ(number_, 0U);
}

TEST_F(BackfillTest, AServerThatTakesNoneIsSentNone) {
  start();
  welcome({}, false);
  take_live(2, 4);
  server_.read(Type::kStats);  // a second later
  server_.close();
  welcome({5, 0});
  EXPECT_EQ(read_late().frame.sequence, 0U);
  EXPECT_FALSE(captured_.lines("the server takes no late frames").empty());
}

TEST_F(BackfillTest, AFrameOverTheServersLimitIsPassedOver) {
  start();
  welcome({}, true, 39'999);
  await_held("s", 0);
  EXPECT_EQ(captured_.lines("more than the server's listen.max_frame of 39999").size(), 2U);
}

TEST_F(BackfillTest, AnEarlierSessionsFramesComeFirst) {
  Record(settings(), "r", "earlier", [] {}).keep(std::make_shared<EncodedFrame>(frame_of(7)));
  start();
  welcome({});
  const wire::Account earlier = await_held("earlier", 1);
  EXPECT_TRUE(earlier.is_final);
  EXPECT_EQ(earlier.first_held, 7U);
  ack(4, 0, 0);
  take_live(4, 4);
  EXPECT_EQ(read_late().session_id, "earlier");
  EXPECT_EQ(read_late().session_id, "s");
}

TEST_F(BackfillTest, AnEarlierSessionIsForgottenOnceTheServerHasItsAccount) {
  {
    Record earlier(settings(), "r", "earlier", [] {});
    earlier.note({3, 2000, 0, 0});
  }
  start();
  welcome({});
  const wire::Account account = await_held("earlier", 0);
  EXPECT_EQ(account.captured, 3U);
  ack(0, 0, 0);
  server_.close();
  welcome({});
  EXPECT_EQ(read_account().session_id, "s");
}

/// A server with a slow disk is not flooded, and knows a session before it gets its frames.
TEST_F(BackfillTest, FewAccountsAreOnTheirWayAndFramesFollowThem) {
  constexpr std::uint64_t kSessions = Backfill::kMostAccounts + 2;
  for (std::uint64_t i = 0; i < kSessions; ++i) {
    Record(settings(), "r", "e" + std::to_string(i), [] {}).note({3, 2000, 0, 0});
  }
  start();
  welcome({});
  std::uint64_t accounts = 0;
  for (int reports = 0; reports < 3;) {  // two seconds
    const auto message = server_.read_any();
    ASSERT_TRUE(message);
    if (message->type() == Type::kStats) ++reports;
    if (message->type() == Type::kFrame) server_.ack({message->frame().sequence + 1, 0});
    if (message->type() != Type::kItems) continue;
    const auto items = wire::parse_items(message->header, message->body).value();
    EXPECT_NE(items.stream, wire::kLate);
    if (items.stream == wire::kAccounts) ++accounts;
  }
  EXPECT_EQ(accounts, Backfill::kMostAccounts);
  next_account_ = accounts;
  ack(5, 0, 0);
  while (read_account().session_id != "s") {
  }
  EXPECT_EQ(next_account_, kSessions + 1);
  EXPECT_EQ(read_late().frame.sequence, 0U);
}

TEST_F(BackfillTest, ByeFollowsTheLastWordOnTheRecord) {
  start();
  welcome({});
  std::promise<bool> done;
  asio::post(io_, [&] { sender_->finish([&](bool complete) { done.set_value(complete); }); });
  take_live(2, 4);
  ack(5, 2, 0);

  std::optional<wire::Account> last;
  for (auto message = server_.read_any(); message && message->type() != Type::kBye;
       message = server_.read_any()) {
    if (message->type() != Type::kItems) continue;
    const auto items = wire::parse_items(message->header, message->body).value();
    if (items.stream == wire::kAccounts) last = wire::parse_account(items.payload).value();
  }
  ASSERT_TRUE(last);
  EXPECT_EQ(last->session_id, "s");
  EXPECT_EQ(last->captured, 5U);
  server_.send(wire::encode(wire::Bye{{5, 2}}));
  EXPECT_TRUE(done.get_future().get());
}

}  // namespace
}  // namespace orbbuf
