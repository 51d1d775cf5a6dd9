// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_streams.hpp"

#include <gmock/gmock.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/local/datagram_protocol.hpp>
#include <fstream>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

class SampleStreamsTest : public ::testing::Test {
 protected:
  SampleStreamsTest() {
    std::ofstream file(folder_ / "data.csv");
    for (std::int64_t time = 0; time < 10; ++time) file << to_euroc_line({time, {}, {}});
    file.close();
    streams_.emplace(io_,
                     std::vector<SampleStreamSettings>{{"imu0", "euroc", folder_ / "data.csv"},
                                                       {"imu1", "euroc", folder_ / "data.csv"}},
                     [this] { ++due_; });
  }

  const test::TemporaryFolder folder_;
  boost::asio::io_context io_;
  int due_ = 0;
  std::optional<SampleStreams> streams_;
};

TEST_F(SampleStreamsTest, DeclaresEachAndSendsThemByNumber) {
  const auto declared = streams_->declarations();
  ASSERT_EQ(declared.size(), 2U);
  EXPECT_EQ(declared[1], (wire::StreamDeclaration{5, "imu1", "imu"}));
  streams_->on_frame(3);
  EXPECT_TRUE(streams_->take_message(3));
  EXPECT_TRUE(streams_->take_message(3));
  EXPECT_FALSE(streams_->take_message(3));
  wire::Position position;
  streams_->put_ends(position);
  EXPECT_EQ(position[4], 4U);
  EXPECT_EQ(position[5], 4U);
  EXPECT_TRUE(streams_->can_be_at(position));
  EXPECT_FALSE(streams_->is_settled());
  streams_->on_ack(position);
  EXPECT_TRUE(streams_->is_settled());
  position[5] = 5;
  EXPECT_FALSE(streams_->can_be_at(position));
}

TEST_F(SampleStreamsTest, ABatchIsDueOnceItIsTwentyMillisecondsLong) {
  std::ofstream file(folder_ / "data.csv");
  for (std::int64_t i = 0; i < 30; ++i) file << to_euroc_line({i * 1'000'000, {}, {}});
  file.close();
  SampleStreams streams(io_, {{"imu0", "euroc", folder_ / "data.csv"}}, [this] { ++due_; });
  const auto before = EventRate::Clock::now();
  streams.on_frame(19'000'000);
  EXPECT_EQ(due_, 0);
  EXPECT_FALSE(streams.take_batch(before));
  streams.on_frame(20'000'000);
  EXPECT_EQ(due_, 1);
  EXPECT_TRUE(streams.take_batch());
  EXPECT_FALSE(streams.take_message(20'000'000));
  EXPECT_EQ(streams.captured()[4], 21U);
  const auto second = EventRate::Clock::now() + std::chrono::seconds(1);
  EXPECT_THAT(
      streams.stats(second),
      testing::MatchesRegex("imu0 captured 21 = .*lost 0, [0-9.]+/s, newest [0-9]+ ms old"));
  streams.stop();
  streams.on_frame(100'000'000);
  EXPECT_EQ(streams.stats(), "imu0 captured 21 = delivered 0 + late 0 + waiting 21 + lost 0");
}

/// And what is measured before the first frame, whose clock is not known yet, is not taken.
TEST_F(SampleStreamsTest, OnlyTimesOfTheSystemsClockAreChanged) {
  const auto path = folder_ / "imu.sock";
  SampleStreams streams(io_, {{"imu0", "socket", path}, {"imu1", "euroc", folder_ / "data.csv"}},
                        [] {});
  streams.set_clock([](std::int64_t time_ns) { return time_ns - 1000; });
  using Datagrams = boost::asio::local::datagram_protocol;
  Datagrams::socket driver(io_, Datagrams());
  const auto send = [&](std::int64_t time_ns) {
    driver.send_to(boost::asio::buffer(to_euroc_line({time_ns, {}, {}})),
                   Datagrams::endpoint(path.string()));
    io_.run_one();
  };
  send(1004);
  EXPECT_EQ(streams.captured()[4], 0U);
  streams.on_frame(3);
  send(1005);
  EXPECT_EQ(streams.captured()[4], 1U);
  const std::string driver_only = streams.stats();
  EXPECT_TRUE(streams.take_message(5)) << driver_only;
  EXPECT_TRUE(streams.take_message(5)) << "of the file, from 0 on";
  EXPECT_EQ(streams.captured()[5], 4U);
}

/// It would hold up all that come behind it, and they would be lost.
TEST_F(SampleStreamsTest, OneStampOfTheFutureIsLostAlone) {
  const auto path = folder_ / "imu.sock";
  SampleStreams streams(io_, {{"imu0", "socket", path}}, [] {});
  using Datagrams = boost::asio::local::datagram_protocol;
  Datagrams::socket driver(io_, Datagrams());
  constexpr std::int64_t kNow = 1'800'000'000'000'000'000;
  for (const std::int64_t after_ns : {0LL, 1'000'000'000'000'000'000LL, 2LL, 3LL, 3LL, 4LL}) {
    driver.send_to(boost::asio::buffer(to_euroc_line({kNow + after_ns, {}, {}})),
                   Datagrams::endpoint(path.string()));
    io_.run_one();
  }
  streams.stop();
  EXPECT_EQ(streams.stats(), "imu0 captured 6 = delivered 0 + late 0 + waiting 4 + lost 2");
}

TEST_F(SampleStreamsTest, TheLastOnesOfASourceThatPausesDoNotWaitForMore) {
  const auto before = EventRate::Clock::now();
  streams_->on_frame(3);
  EXPECT_FALSE(streams_->take_batch(before));
  const auto later = EventRate::Clock::now() + SampleStreams::kBatch;
  EXPECT_TRUE(streams_->take_batch(later));
  EXPECT_TRUE(streams_->take_batch(later)) << "of the other stream";
  EXPECT_FALSE(streams_->take_batch(later));
}

TEST_F(SampleStreamsTest, HandsEachSampleToTheRecordOnce) {
  streams_->on_frame(3);
  std::vector<std::uint64_t> kept;
  bool is_full = true;
  const auto keep = [&](const wire::Items& items) {
    if (!is_full) kept.push_back(items.first + items.payload[1]);
    return !is_full;
  };
  const auto send_late = [](wire::StreamId, const SampleQueue::Range&) { return std::uint64_t{0}; };
  streams_->record(keep, send_late);
  is_full = false;
  auto progress = streams_->record(keep, send_late);
  EXPECT_EQ(kept, (std::vector<std::uint64_t>{4, 4}));
  ASSERT_EQ(progress.size(), 2U);
  EXPECT_EQ(progress[1].stream.name, "imu1");
  EXPECT_EQ(progress[1].captured, 4U);
  EXPECT_EQ(progress[1].first_waiting, 0U);
  streams_->record(keep, send_late);
  EXPECT_EQ(kept.size(), 2U);
}

TEST_F(SampleStreamsTest, WhatTheRecordLostIsNotLate) {
  SampleStreams streams(
      io_, {{"imu0", "euroc", folder_ / "data.csv", 4 * SampleQueue::kBytesPerSample}}, [] {});
  streams.on_frame(3);
  const auto keep = [](const wire::Items&) { return true; };
  const auto send_late = [](wire::StreamId, const SampleQueue::Range& late) {
    EXPECT_EQ(late.begin, 0U);
    EXPECT_EQ(late.end, 3U);
    return std::uint64_t{2};
  };
  streams.record(keep, send_late);
  streams.on_frame(6);
  streams.record(keep, send_late);
  streams.stop();
  EXPECT_EQ(streams.stats(), "imu0 captured 7 = delivered 0 + late 1 + waiting 4 + lost 2");
}

TEST_F(SampleStreamsTest, AStreamThatTheServerDoesNotTakeHoldsNothingUp) {
  streams_->on_connected({}, [](wire::StreamId id) { return id == wire::kFirstOther; });
  streams_->on_frame(3);
  EXPECT_TRUE(streams_->take_message(3));
  EXPECT_FALSE(streams_->take_message(3));
  wire::Position position;
  streams_->put_ends(position);
  streams_->on_ack(position);
  EXPECT_TRUE(streams_->is_settled());
  streams_->stop();
  EXPECT_EQ(streams_->stats(),
            "imu0 captured 4 = delivered 4 + late 0 + waiting 0 + lost 0; "
            "imu1 captured 4 = delivered 0 + late 0 + waiting 4 + lost 0");
}

}  // namespace
}  // namespace orbbuf
