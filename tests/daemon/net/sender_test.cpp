// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/sender.hpp"

#include <gtest/gtest.h>

#include <boost/asio/post.hpp>
#include <fstream>
#include <future>
#include <thread>

#include "daemon/buffer/simple_policies.hpp"
#include "testing/captured_log.hpp"
#include "testing/scripted_server.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using test::Message;
using wire::Type;

/// A sender on its own thread, as `main` is, against a server that the test plays.
class SenderTest : public ::testing::Test {
 protected:
  /// The test may be held up in the middle of a welcome.
  SenderTest() { link_.connect_timeout = std::chrono::minutes(1); }
  void start() {
    link_.servers.front().port = server_.port();
    wire::Hello hello;
    hello.robot_id = "r";
    hello.session_id = "s";
    samples_.emplace(io_, streams_, [] {});
    hello.streams = samples_->declarations();
    sender_ = std::make_unique<Sender>(io_, link_, hello, buffer_, record_, *samples_);
    sender_->start();
    main_ = std::jthread([this] {
      io_.run();
      has_ended_.set_value();
    });
  }
  void push(Sequence first, Sequence last, std::size_t bytes = 100) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      auto frame = std::make_shared<EncodedFrame>();
      frame->sequence = sequence;
      frame->capture_time_ns = static_cast<std::int64_t>(sequence) * 1000;
      frame->jpeg.assign(bytes, static_cast<std::uint8_t>(sequence));
      frame->jpeg_crc = wire::crc32(frame->jpeg);
      buffer_.on_captured();
      buffer_.push(std::move(frame));
    }
    asio::post(io_, [this] { sender_->wake(); });
  }
  std::future<bool> finish() {
    auto done = std::make_shared<std::promise<bool>>();
    asio::post(io_, [this, done] {
      sender_->finish([done](bool complete) { done->set_value(complete); });
    });
    return done->get_future();
  }
  void TearDown() override {
    asio::post(io_, [this] { io_.stop(); });
    if (main_.joinable()) main_.join();
  }

  LinkSettings link_;
  std::vector<SampleStreamSettings> streams_;
  test::ScriptedServer server_;
  FrameBuffer buffer_{{5}, std::make_unique<DropOldestPolicy>()};
  Record record_{{}, "r", "s", [] {}};
  asio::io_context io_;
  std::optional<SampleStreams> samples_;
  std::unique_ptr<Sender> sender_;
  std::promise<void> has_ended_;
  std::jthread main_;
};

TEST_F(SenderTest, SaysHelloAndSendsWhatWaitsInOrder) {
  push(0, 2);
  start();
  const wire::Hello hello = server_.welcome({});
  EXPECT_EQ(hello.robot_id, "r");
  EXPECT_EQ(hello.session_id, "s");
  for (Sequence sequence = 0; sequence < 3; ++sequence) {
    const EncodedFrame frame = server_.read(Type::kFrame).frame();
    EXPECT_EQ(frame.sequence, sequence);
    EXPECT_EQ(frame.jpeg, std::vector<std::uint8_t>(100, static_cast<std::uint8_t>(sequence)));
    server_.ack({sequence + 1, 0});
  }
}

TEST_F(SenderTest, SamplesGoBeforeTheFirstFrameThatIsNewerAndAgainUntilAcknowledged) {
  const test::TemporaryFolder folder;
  const auto path = folder / "data.csv";
  std::ofstream(path) << "500,1,2,3,4,5,6\n1500,1,2,3,4,5,6\n1600,1,2,3,4,5,6\n2500,1,2,3,4,5,6\n";
  streams_ = {{"imu0", "euroc", path}};
  push(0, 2);
  start();
  EXPECT_EQ(server_.welcome({}).streams.front().name, "imu0");
  const auto expect_samples = [&](std::uint64_t first, std::size_t count) {
    const wire::Items items = server_.read(Type::kItems).items();
    EXPECT_EQ(items.stream, wire::kFirstOther);
    EXPECT_EQ(items.first, first);
    EXPECT_EQ(wire::parse_samples(wire::kSampleCodec, items.payload).value().size(), count);
  };
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
  server_.ack({1, 0});
  expect_samples(0, 1);
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 1U);
  expect_samples(1, 2);
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 2U);
  server_.close();
  wire::Position position{1, 0};
  position[wire::kFirstOther] = 1;
  server_.welcome(position);
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 1U);
  position[wire::kFrames] = 2;
  server_.ack(position);
  expect_samples(1, 2);
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 2U);
  const auto done = finish();
  position[wire::kFrames] = 3;
  position[wire::kFirstOther] = 3;
  server_.ack(position);
  const auto bye = server_.read(Type::kBye);
  EXPECT_EQ(wire::parse_bye(bye.header, bye.body).value().position, position);
}

TEST_F(SenderTest, UnacknowledgedFramesComeAgainOnTheNextConnection) {
  push(0, 3);
  start();
  server_.welcome({});
  server_.read(Type::kFrame);
  server_.ack({1, 0});
  for (int i = 0; i < 2; ++i) server_.read(Type::kFrame);
  server_.close();
  server_.welcome({2, 0});  // it had taken frame 1 as well, but the ack was lost
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 2U);
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 3U);
  EXPECT_EQ(buffer_.stats().acknowledged, 2U);
}

TEST_F(SenderTest, DropsAreReportedNumberedAndAgainUntilAcknowledged) {
  start();
  push(0, 7);  // three more than fit: 0, 1 and 2 go
  server_.welcome({});
  std::vector<DropRecord> all;
  while (all.size() < buffer_.stats().dropped || all.empty()) {
    const test::NumberedDrops some = server_.read_drops();
    EXPECT_EQ(some.first, all.size());
    all.insert(all.end(), some.records.begin(), some.records.end());
  }
  server_.close();
  server_.welcome({0, 1});
  const test::NumberedDrops again = server_.read_drops();
  EXPECT_EQ(again.first, 1U);
  EXPECT_EQ(again.records.front(), all[1]);
}

TEST_F(SenderTest, TheBufferKeepsNoDropRecordsWithoutAConnection) {
  start();
  push(0, 7);
  std::promise<std::size_t> left;
  asio::post(io_, [&] {
    std::vector<DropRecord> records;
    buffer_.collect_drops(records);
    left.set_value(records.size());
  });
  EXPECT_EQ(left.get_future().get(), 0U);
  server_.welcome({});
  EXPECT_EQ(server_.read_drops().records.size(), 3U);
}

TEST_F(SenderTest, BeyondWhatIsAcknowledgedAtMostTwoFramesAreWrittenAtFirst) {
  push(0, 4);
  start();
  server_.welcome({});
  for (int i = 0; i < 2; ++i) server_.read(Type::kFrame);
  EXPECT_EQ(server_.read_any()->type(), Type::kStats);  // a second later, and no frame before it
  EXPECT_EQ(buffer_.stats().in_flight, 2U);
  EXPECT_EQ(buffer_.stats().waiting, 3U);
  server_.ack({1, 0});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 2U);
}

TEST_F(SenderTest, WhatIsReceivedMakesRoomAndIsKeptUntilItIsAcknowledged) {
  push(0, 4);
  start();
  server_.welcome({});
  for (Sequence sequence = 0; sequence < 5; ++sequence) {
    EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, sequence);
    server_.ack({0, 0}, sequence + 1);  // the device takes its time
  }
  EXPECT_EQ(buffer_.stats().in_flight, 5U);
  server_.close();
  server_.welcome({3, 0});  // it was started again: the rest had not got to its device
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 3U);
  EXPECT_EQ(buffer_.stats().acknowledged, 3U);
}

TEST_F(SenderTest, FinishSaysByeOnceAllIsAcknowledged) {
  push(0, 1);
  start();
  server_.welcome({});
  std::future<bool> done = finish();
  server_.read(Type::kFrame);
  server_.read(Type::kFrame);
  server_.ack({2, 0});
  const Message message = server_.read(Type::kBye);
  EXPECT_EQ(wire::parse_bye(message.header, message.body).value(), (wire::Bye{{2, 0}}));
  server_.send(wire::encode(wire::Bye{{2, 0}}));
  EXPECT_TRUE(done.get());
  EXPECT_EQ(buffer_.stats().acknowledged, 2U);
}

TEST_F(SenderTest, FinishWithoutAServerGivesUpByNameWhenTheTimeIsOver) {
  link_.drain_timeout = std::chrono::milliseconds(10);
  push(0, 1);
  start();
  EXPECT_FALSE(finish().get());
  EXPECT_EQ(buffer_.stats().dropped, 2U);
  EXPECT_EQ(sender_->lost(), 2U);
}

TEST_F(SenderTest, WhatIsAbandonedIsLost) {
  push(0, 1);
  start();
  server_.welcome({});
  server_.read(Type::kFrame);
  std::promise<std::uint64_t> lost;
  asio::post(io_, [&] {
    sender_->abandon();
    lost.set_value(sender_->lost());
  });
  EXPECT_EQ(lost.get_future().get(), 2U);
  EXPECT_EQ(buffer_.stats().dropped, 2U);
}

// Timers that expire in one go have all succeeded: cancelling the rest comes too late for them.
TEST_F(SenderTest, NothingIsStartedAgainAfterTheEndByATimerOfTheSameMoment) {
  link_.drain_timeout = std::chrono::milliseconds(10);
  start();
  server_.accept();
  server_.close();  // no connection, and one timer until the next attempt
  std::future<bool> done = finish();
  asio::post(io_, [] { std::this_thread::sleep_for(std::chrono::milliseconds(500)); });
  EXPECT_FALSE(done.get());
  EXPECT_EQ(has_ended_.get_future().wait_for(std::chrono::minutes(1)), std::future_status::ready);
}

TEST_F(SenderTest, AnAckOfWhatWasNotSentIsNotBelieved) {
  const test::CapturedLog log;
  start();
  server_.welcome({});
  push(0, 0);
  server_.read(Type::kFrame);
  server_.ack({2, 0});
  log.wait_for(
      "reaches frame 2 and drop record 0, which, or the samples there, this robot "
      "has not sent");
  EXPECT_EQ(buffer_.stats().acknowledged, 0U);
}

TEST_F(SenderTest, FinishOnASlowServerReportsWhatItGaveUp) {
  link_.drain_timeout = std::chrono::milliseconds(10);
  start();
  server_.welcome({});
  push(0, 0);
  server_.read(Type::kFrame);  // not acknowledged until after the time is over
  std::future<bool> done = finish();
  EXPECT_EQ(done.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  server_.ack({1, 0});
  server_.read(Type::kBye);
  server_.send(wire::encode(wire::Bye{{1, 0}}));
  EXPECT_TRUE(done.get());
  EXPECT_EQ(sender_->lost(), 0U);
}

TEST_F(SenderTest, WhatFinishGaveUpIsLostAlsoIfTheServerAnswersTheBye) {
  link_.drain_timeout = std::chrono::milliseconds(10);
  push(0, 4);
  start();
  server_.welcome({});
  for (int i = 0; i < 2; ++i) server_.read(Type::kFrame);
  std::future<bool> done = finish();
  EXPECT_EQ(server_.read_drops().records.size(), 3U);  // the time is over
  server_.ack({2, 3});
  server_.read(Type::kBye);
  server_.send(wire::encode(wire::Bye{{5, 3}}));
  EXPECT_TRUE(done.get());
  EXPECT_EQ(sender_->lost(), 3U);
}

TEST_F(SenderTest, ServerThatNeverAnswersIsTriedAgain) {
  link_.connect_timeout = std::chrono::seconds(2);
  push(0, 0);
  start();
  server_.accept();
  server_.welcome({});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
}

TEST_F(SenderTest, WhatTheServerHadAcknowledgedAndLostIsNamed) {
  push(0, 2);
  start();
  server_.welcome({});
  for (Sequence sequence = 0; sequence < 3; ++sequence) {
    server_.read(Type::kFrame);
    server_.ack({sequence + 1, 0});
  }
  push(3, 3);
  server_.read(Type::kFrame);  // so the acknowledgements have arrived
  server_.close();
  server_.welcome({1, 0});
  EXPECT_EQ(server_.read_drops().records,
            (std::vector<DropRecord>{{1, 1000, DropReason::kLost}, {2, 2000, DropReason::kLost}}));
  const wire::Stats stats = buffer_.stats();
  EXPECT_EQ(stats.acknowledged, 1U);
  EXPECT_EQ(stats.dropped, 2U);
}

TEST_F(SenderTest, ServerThatReadsAndNeverAcknowledgesIsLeftAndTriedAgain) {
  link_.ack_timeout = std::chrono::milliseconds(200);
  push(0, 1);
  start();
  for (int connection = 0; connection < 2; ++connection) {
    server_.welcome({});
    EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
    EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 1U);
    while (server_.read_any()) {
    }
  }
  EXPECT_EQ(buffer_.stats().captured, 2U);
}

/// The camera is away.
TEST_F(SenderTest, ServerThatAcknowledgesNoSamplesIsLeftAndTriedAgain) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "data.csv") << "500,1,2,3,4,5,6\n";
  streams_ = {{"imu0", "euroc", folder / "data.csv"}};
  link_.ack_timeout = std::chrono::milliseconds(200);
  push(0, 0);
  start();
  asio::post(io_, [this] { samples_->on_frame(1000); });
  server_.welcome({});
  server_.read(Type::kFrame);
  server_.ack({1, 0});
  for (int connection = 0; connection < 2; ++connection) {
    EXPECT_EQ(server_.read(Type::kItems).items().stream, wire::kFirstOther);
    while (server_.read_any()) {
    }
    server_.welcome({1, 0});
  }
}

TEST_F(SenderTest, ServerThatTalksNonsenseIsLeftAndTriedAgain) {
  push(0, 0);
  start();
  server_.accept();
  server_.send({'H', 'T', 'T', 'P', '/', '1', '.', '1', ' ', '4',
                '0', '0', ' ', 'B', 'a', 'd', ' ', 'R', 'e', 'q'});
  server_.welcome({});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
}

TEST_F(SenderTest, RefusalIsSurvived) {
  push(0, 0);
  start();
  server_.accept();
  server_.send(wire::encode(wire::ErrorMessage{wire::ErrorCode::kRefused, "full"}));
  server_.welcome({});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
}

TEST_F(SenderTest, AFrameThatIsTooLargeForTheServerIsNamedAndTheOthersGoOn) {
  constexpr std::uint32_t kLargest = 100;
  push(0, 2);
  push(3, 3, kLargest + 1);
  push(4, 4);
  start();
  server_.accept();
  server_.read(Type::kHello);
  wire::Welcome welcome = test::welcome_at({});
  welcome.max_frame_bytes = kLargest;
  server_.send(wire::encode(welcome));
  for (const Sequence sequence : {0U, 1U, 2U, 4U}) {
    auto message = server_.read_any();
    while (message && message->type() != Type::kFrame) message = server_.read_any();
    ASSERT_TRUE(message);
    EXPECT_EQ(message->frame().sequence, sequence);
    server_.ack({sequence + 1, 0});
  }
}

TEST_F(SenderTest, WhatWasNeverSentIsNotTakenForDelivered) {
  push(0, 2);
  start();
  server_.welcome({1, 0});  // another session's record
  server_.welcome({0, 1});
  server_.welcome({});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
  server_.close();
  server_.welcome({1, 0});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 1U);
}

TEST_F(SenderTest, ADropRecordThatWasNeverSentIsNotTakenForDelivered) {
  start();
  push(0, 7);  // three more than fit
  server_.welcome({0, 1});
  server_.welcome({});
  EXPECT_EQ(server_.read_drops().first, 0U);
}

TEST_F(SenderTest, TheLastStatsComeJustBeforeTheBye) {
  push(0, 1);
  start();
  server_.welcome({});
  std::future<bool> done = finish();
  for (int frame = 0; frame < 2; ++frame) server_.read(Type::kFrame);
  server_.ack({2, 0});
  std::optional<Message> last;
  for (auto message = server_.read_any(); message && message->type() != Type::kBye;
       message = server_.read_any()) {
    last = std::move(message);
  }
  ASSERT_TRUE(last && last->type() == Type::kStats);
  const wire::Report report = wire::parse_stats(last->header, last->body).value();
  EXPECT_EQ(report.stats, (wire::Stats{.captured = 2, .acknowledged = 2}));
  server_.send(wire::encode(wire::Bye{{2, 0}}));
  EXPECT_TRUE(done.get());
}

TEST_F(SenderTest, ReportsByHowMuchTheClockWasSet) {
  start();
  asio::post(io_, [this] { sender_->set_clock_offset(std::chrono::hours(-1)); });
  server_.welcome({});
  const Message message = server_.read(Type::kStats);
  const auto report = wire::parse_stats(message.header, message.body);
  ASSERT_TRUE(report);
  EXPECT_EQ(report.value().clock_offset_ns, -3'600'000'000'000);
}

TEST_F(SenderTest, StatsAddUp) {
  start();
  push(0, 9);
  server_.welcome({});
  const Message message = server_.read(Type::kStats);
  const wire::Stats s = wire::parse_stats(message.header, message.body).value().stats;
  EXPECT_EQ(s.captured, 10U);
  EXPECT_EQ(s.captured,
            s.skipped + s.failed + s.dropped + s.acknowledged + s.waiting + s.in_flight);
}

}  // namespace
}  // namespace orbbuf
