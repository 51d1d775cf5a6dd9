// SPDX-License-Identifier: Apache-2.0
#include "server/sink/paced_sink.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/asio/post.hpp>
#include <functional>
#include <future>
#include <latch>
#include <memory>
#include <stdexcept>
#include <string>

namespace orbbuf {
namespace {

using Clock = Pace::Clock;
using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::ElementsAre;

constexpr std::size_t kFrameBytes = 1000;
constexpr Sequence kBad = 5000;

FramePtr frame_of(Sequence sequence, std::size_t bytes = kFrameBytes) {
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = static_cast<std::int64_t>(sequence) * 40'000'000;
  frame.jpeg.resize(bytes);
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

ItemsPtr sample_of(std::uint64_t number, std::int64_t time_ns) {
  const Sample sample{time_ns, {}, {}};
  return std::make_shared<const wire::Items>(
      wire::Items{wire::kFirstOther, number, wire::encode_samples({&sample, 1})});
}

ItemsPtr message_of(std::uint64_t number, std::string topic) {
  TopicPublisher publisher;
  publisher.topic = std::move(topic);
  publisher.type = "pkg::msg::dds_::Any_";
  TopicMessage message{
      std::make_shared<const TopicPublisher>(std::move(publisher)), 1, {0, 1, 0, 0}};
  const Sample sample{1, {}, {}, std::make_shared<const TopicMessage>(std::move(message))};
  return std::make_shared<const wire::Items>(
      wire::Items{wire::kFirstOther + 1, number, wire::encode_samples({&sample, 1})});
}

class ListedSession final : public PacedSession {
 public:
  explicit ListedSession(PacedThreads& threads)
      : PacedSession(
            threads,
            {"r",
             "s",
             "",
             {{wire::kFirstOther, "imu0", "imu"}, {wire::kFirstOther + 1, "odom", "ros2"}}},
            "test", Pace(2.0), std::chrono::seconds(1)) {}

  struct Entry {
    std::string what;
    Clock::time_point time;
    int turn;  // those of one went without a pause
  };
  std::vector<Entry> published;
  std::function<void()> on_frame;
  std::optional<Clock::time_point> readers_come;
  Clock::time_point topic_begin;

 private:
  std::optional<Clock::time_point> wait_for_readers() override {
    ++turn_;
    return readers_come && Clock::now() < *readers_come ? readers_come : std::nullopt;
  }
  Clock::time_point begin_of(const TopicMessage& /*message*/) override { return topic_begin; }
  std::optional<Error> publish(const EncodedFrame& frame) override {
    if (frame.sequence == kBad) throw std::runtime_error("bad");
    if (on_frame) on_frame();
    published.push_back({"frame " + std::to_string(frame.sequence), Clock::now(), turn_});
    return std::nullopt;
  }
  std::optional<Error> publish(const wire::StreamDeclaration& stream,
                               const Sample& sample) override {
    published.push_back({stream.name + " " + std::to_string(sample.time_ns), Clock::now(), turn_});
    return std::nullopt;
  }

  int turn_ = 0;
};

class PacedSinkTest : public testing::Test {
 protected:
  ~PacedSinkTest() override {
    on_thread([&] { threads_.finish(Clock::time_point::min()); });
  }

  /// Also what `work` posts there is done.
  void on_thread(const std::function<void()>& work) {
    std::promise<void> done;
    boost::asio::post(session_->strand, [&] {
      work();
      boost::asio::post(session_->strand, [&] { done.set_value(); });
    });
    done.get_future().wait();
  }
  void write(FramePtr frame) {
    sink_.async_write(std::move(frame), [](const auto&) {});
  }
  void write(ItemsPtr items) {
    sink_.async_write_items(std::move(items), [](const auto&) {});
  }

  /// Once all that was written has been published.
  std::vector<ListedSession::Entry> all() {
    for (bool is_idle = false; !is_idle;) {
      on_thread([&] { is_idle = threads_.busy.empty(); });
    }
    return session_->published;
  }
  std::vector<std::string> names() {
    std::vector<std::string> names;
    for (const auto& entry : all()) names.push_back(entry.what);
    return names;
  }

  boost::asio::io_context main_;
  PacedThreads threads_{"test"};
  std::shared_ptr<ListedSession> session_ = std::make_shared<ListedSession>(threads_);
  PacedSink sink_{main_, threads_, session_};
};

TEST_F(PacedSinkTest, ABurstIsSpreadInItsOrder) {
  for (Sequence sequence = 0; sequence < 4; ++sequence) {
    write(sample_of(sequence, static_cast<std::int64_t>(sequence) * 40'000'000 - 1));
    write(frame_of(sequence));
  }
  const auto entries = all();
  EXPECT_THAT(names(), ElementsAre("imu0 -1", "frame 0", "imu0 39999999", "frame 1",
                                   "imu0 79999999", "frame 2", "imu0 119999999", "frame 3"));
  EXPECT_GE(entries[7].time - entries[1].time, milliseconds(40));
  EXPECT_EQ(threads_.waiting_bytes, 0U);
}

TEST_F(PacedSinkTest, SamplesThatComeTogetherAreSpread) {
  std::vector<Sample> samples;
  for (int i = 0; i < 21; ++i) samples.push_back({i * 50'000'000, {}, {}});
  write(std::make_shared<const wire::Items>(
      wire::Items{wire::kFirstOther, 0, wire::encode_samples(samples)}));
  const auto entries = all();
  ASSERT_EQ(entries.size(), 21U);
  EXPECT_GE(entries.back().time - entries.front().time, milliseconds(80));
}

TEST_F(PacedSinkTest, ALongBacklogGoesFaster) {
  on_thread([&] {
    for (Sequence sequence = 0; sequence < 100; ++sequence) write(frame_of(sequence));  // 4 s
  });
  const auto entries = all();
  ASSERT_EQ(entries.size(), 100U);
  EXPECT_LT(entries.back().time - entries.front().time, milliseconds(1500));  // of 2 s
  EXPECT_GE(entries[99].time - entries[79].time, 19 * milliseconds(20));      // the last 0.8 s
}

TEST_F(PacedSinkTest, NothingGoesBeforeReadersAreThere) {
  on_thread([&] { session_->readers_come = Clock::now() + milliseconds(50); });
  write(frame_of(0));
  EXPECT_GE(all().at(0).time, *session_->readers_come);
}

TEST_F(PacedSinkTest, AMessageOfANewTopicWaitsAloneAndKeepsItsPlaceThen) {
  on_thread([&] { session_->topic_begin = Clock::now() + milliseconds(50); });
  write(message_of(0, "/odom"));
  write(frame_of(0));
  EXPECT_THAT(names(), ElementsAre("frame 0", "odom 1"));
  write(message_of(1, "/odom"));
  write(frame_of(1));
  EXPECT_THAT(names(), ElementsAre("frame 0", "odom 1", "odom 1", "frame 1"));
}

TEST_F(PacedSinkTest, WhatWaitsAtTheEndGoesAtOnce) {
  for (Sequence sequence = 0; sequence < 1000; ++sequence) write(frame_of(sequence));
  on_thread([&] { threads_.finish(Clock::now() + seconds(10)); });
  EXPECT_EQ(all().size(), 1000U);
  EXPECT_EQ(sink_.lost(), 0U);
}

TEST_F(PacedSinkTest, WhatCannotGoAtTheEndIsLost) {
  on_thread([&] { session_->readers_come = Clock::now() + seconds(1000); });
  for (Sequence sequence = 0; sequence < 10; ++sequence) write(frame_of(sequence));
  on_thread([&] { threads_.finish(Clock::time_point::min()); });
  EXPECT_THAT(names(), ElementsAre());
  EXPECT_EQ(sink_.lost(), 10U);
}

TEST_F(PacedSinkTest, WhatFailsIsLostAndTheNextIsNot) {
  write(frame_of(kBad));
  write(frame_of(14));
  EXPECT_THAT(names(), ElementsAre("frame 14"));
  EXPECT_EQ(sink_.lost(), 1U);
}

TEST_F(PacedSinkTest, NothingIsPacedWhileMuchWaitsAndMoreThanTheMostIsLost) {
  on_thread([&] { session_->readers_come = Clock::now() + seconds(1000); });
  for (Sequence sequence = 0; sequence < 9; ++sequence) write(frame_of(sequence, 8U << 20U));
  EXPECT_EQ(sink_.lost(), 1U);
  on_thread([&] {
    session_->readers_come.reset();
    session_->publish_due();
  });
  const auto entries = all();
  ASSERT_EQ(entries.size(), 8U);
  EXPECT_EQ(entries[3].turn, entries[0].turn);
  EXPECT_GE(entries[7].time - entries[4].time, milliseconds(40));
}

TEST(PacedThreadsTest, NoSessionWaitsForAnotherAsLongAsThereIsAThread) {
  boost::asio::io_context main;
  PacedThreads threads("test", 2);
  auto first = std::make_shared<ListedSession>(threads);
  auto second = std::make_shared<ListedSession>(threads);
  std::latch both(2);
  first->on_frame = second->on_frame = [&] { both.arrive_and_wait(); };
  {
    PacedSink one(main, threads, first);
    PacedSink two(main, threads, second);
    one.async_write(frame_of(0), [](const auto&) {});
    two.async_write(frame_of(0), [](const auto&) {});
  }
  threads.finish(PacedSession::Clock::now() + seconds(10));
  threads.pool.join();
  EXPECT_EQ(first->published.size(), 1U);
  EXPECT_EQ(second->published.size(), 1U);
  EXPECT_TRUE(threads.busy.empty());
}

}  // namespace
}  // namespace orbbuf
