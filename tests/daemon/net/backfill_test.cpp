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

/// A sender with a spool on its own thread, as `main` is, against a server that the test plays.
/// Its buffer has three frames and gives up the oldest.
class BackfillTest : public ::testing::Test {
 protected:
  BackfillTest() { link_.connect_timeout = std::chrono::minutes(1); }

  void start(const std::string& session = "s") {
    link_.servers.front().port = server_.port();
    wire::Hello hello;
    hello.robot_id = "r";
    hello.session_id = session;
    spool_.emplace(SpoolSettings{folder_ / "spool"}, "r", session,
                   [this] { asio::post(io_, [this] { sender_->wake(); }); });
    sender_ = std::make_unique<Sender>(io_, link_, hello, buffer_, drops_, log_, &*spool_);
    push(0, 4);  // 0 and 1 go
    sender_->start();
    main_ = std::jthread([this] { io_.run(); });
  }
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
    server_.send(
        wire::encode(wire::Welcome{wire::kProtocolVersion, position, most_bytes, takes_late}));
    part_ = {};
  }
  /// Reads live frames and acknowledges each at once.
  void take_live(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, sequence);
      server_.ack({sequence + 1, 0});
    }
  }
  /// The next late frame of the connection, and its number.
  wire::LateFrame read_late() {
    std::vector<std::uint8_t> record;
    while (true) {
      const Message message = server_.read(Type::kLate);
      const auto part = wire::parse_late(message.header, message.body).value();
      EXPECT_EQ(part.offset, record.size());
      part_.number = part.number;
      record.insert(record.end(), part.bytes.begin(), part.bytes.end());
      if (record.size() == part.record_bytes) return wire::parse_late_record(record).value();
    }
  }
  wire::Spool read_spool() {
    const Message message = server_.read(Type::kSpool);
    return wire::parse_spool(message.header, message.body).value();
  }
  void TearDown() override {
    asio::post(io_, [this] { io_.stop(); });
    if (main_.joinable()) main_.join();
    sender_.reset();
    spool_.reset();
  }

  test::TemporaryFolder folder_;
  test::CapturedLog captured_;
  LinkSettings link_;
  test::ScriptedServer server_;
  FrameBuffer buffer_{{3}, std::make_unique<DropOldestPolicy>()};
  DropLog drops_;
  SessionLog log_{{}, "r", "s"};
  asio::io_context io_;
  std::optional<Spool> spool_;
  std::unique_ptr<Sender> sender_;
  wire::LatePart part_;
  std::jthread main_;
};

TEST_F(BackfillTest, DroppedFramesComeLateWhenTheLiveOnesAreThere) {
  start();
  welcome({});
  take_live(2, 4);
  for (const Sequence sequence : {0U, 1U}) {
    const auto late = read_late();
    EXPECT_EQ(part_.number, sequence);
    EXPECT_EQ(late.session_id, "s");
    EXPECT_EQ(late.frame.sequence, sequence);
    EXPECT_EQ(late.frame.jpeg, frame_of(sequence).jpeg);
    EXPECT_EQ(late.frame.capture_time_ns, frame_of(sequence).capture_time_ns);
  }
}

TEST_F(BackfillTest, TheServerIsToldWhatTheSpoolHoldsUntilThatIsNothing) {
  start();
  welcome({});
  // After two frames, which are not acknowledged yet: more may not be on their way.
  EXPECT_EQ(read_spool(), (wire::Spool{{{"s", 2, 0}}}));
  server_.ack({4, 0});
  take_live(4, 4);
  read_late();
  read_late();
  server_.send(wire::encode(wire::LateAck{2}));
  while (read_spool() != wire::Spool{}) {  // a message a second, as long as it changes
  }
}

TEST_F(BackfillTest, WhatIsNotAcknowledgedComesAgainOnTheNextConnection) {
  start();
  welcome({});
  take_live(2, 4);
  read_late();
  read_late();
  server_.send(wire::encode(wire::LateAck{1}));
  while (read_spool() != wire::Spool{{{"s", 1, 1}}}) {  // so that the ack has come
  }
  server_.close();
  welcome({5, 0});
  EXPECT_EQ(read_late().frame.sequence, 1U);
  EXPECT_EQ(part_.number, 0U);
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
  while (read_spool() != wire::Spool{}) {
  }
  EXPECT_EQ(captured_.lines("more than the server's listen.max_frame of 39999").size(), 2U);
}

TEST_F(BackfillTest, AnEarlierSessionsFramesComeFirst) {
  {
    Spool earlier({folder_ / "spool"}, "r", "earlier", [] {});
    earlier.add(std::make_shared<EncodedFrame>(frame_of(7)));
  }
  start();
  welcome({});
  EXPECT_EQ(read_spool(), (wire::Spool{{{"earlier", 1, 7}, {"s", 2, 0}}}));
  server_.ack({4, 0});
  take_live(4, 4);
  EXPECT_EQ(read_late().session_id, "earlier");
  EXPECT_EQ(read_late().session_id, "s");
}

TEST_F(BackfillTest, ByeFollowsTheLastWordOnTheSpool) {
  start();
  welcome({});
  std::promise<bool> done;
  asio::post(io_, [&] { sender_->finish([&](bool complete) { done.set_value(complete); }); });
  take_live(2, 4);
  server_.ack({5, 2});

  std::optional<wire::Spool> last;
  for (auto message = server_.read_any(); message && message->type() != Type::kBye;
       message = server_.read_any()) {
    if (message->type() == Type::kSpool) {
      last = wire::parse_spool(message->header, message->body).value();
    }
  }
  ASSERT_TRUE(last);
  EXPECT_EQ(last->sessions.front().session_id, "s");
  server_.send(wire::encode(wire::Bye{{5, 2}}));
  EXPECT_TRUE(done.get_future().get());
}

}  // namespace
}  // namespace orbbuf
