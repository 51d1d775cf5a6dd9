// SPDX-License-Identifier: Apache-2.0
#include "server/sink/record_sink.hpp"

#include <boost/asio/strand.hpp>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>

#include "server/session/session_reader.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

using test::plain_frame_ptr;

class RecordSinkTest : public test::EventLoop {
 protected:
  std::unique_ptr<RecordSink> sink() {
    const auto store =
        std::make_shared<SharedStore>(main_, boost::asio::make_strand(files_), folder_ / "data",
                                      SessionInfo{"r", "s", ""}, Durability::kAck, nullptr);
    return std::make_unique<RecordSink>(store, wire::Position{});
  }
  SessionSummary summary() const {
    const auto read = read_summary(session_);
    EXPECT_TRUE(read);
    return read.value_or(SessionSummary{});
  }
  std::optional<Error> drain(RecordSink& sink, const SessionClosing& closing) {
    std::optional<std::optional<Error>> drained;
    sink.async_drain(closing, [&](const auto& error) { drained = error; });
    EXPECT_TRUE(run_until([&] { return drained.has_value(); }));
    return drained.value_or(Error{"no answer"});
  }

  test::TemporaryFolder folder_;
  const std::filesystem::path session_ = folder_ / "data/r/s";
};

TEST_F(RecordSinkTest, AnswersOnMainWhenTheFrameIsOnDisk) {
  const auto sink = this->sink();
  std::optional<std::thread::id> answered_by;
  sink->async_write(plain_frame_ptr(5), [&](const std::optional<Error>& error) {
    EXPECT_FALSE(error);
    answered_by = std::this_thread::get_id();
  });
  EXPECT_FALSE(answered_by);
  ASSERT_TRUE(run_until([&] { return answered_by.has_value(); }));
  EXPECT_EQ(*answered_by, std::this_thread::get_id());
  EXPECT_TRUE(std::filesystem::exists(session_ / "images/000005.jpg"));
}

TEST_F(RecordSinkTest, FramesAndItemsAreRecorded) {
  const auto sink = this->sink();
  EXPECT_FALSE(write(*sink, plain_frame_ptr(5)));
  bool is_done = false;
  sink->async_write_items(
      test::drops_ptr(0, {{6, 0, DropReason::kPolicy}, {7, 0, DropReason::kPolicy}}),
      [&](const auto& error) {
        EXPECT_FALSE(error);
        is_done = true;
      });
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(summary().position, (wire::Position{6, 2}));
}

TEST_F(RecordSinkTest, TellsWhyAFrameWasNotTaken) {
  std::filesystem::create_directories(session_.parent_path());
  test::write_file(session_, "a file where the folder should be");
  const auto error = write(*sink(), plain_frame_ptr(0));
  ASSERT_TRUE(error);
  EXPECT_NE(error->text.find(session_.string()), std::string::npos) << error->text;
}

TEST_F(RecordSinkTest, TheSessionHasItsEndAndItsViewsWhenTheSinkIsDrained) {
  const auto sink = this->sink();
  EXPECT_FALSE(write(*sink, plain_frame_ptr(0)));
  const SessionClosing closing{true, wire::Stats{.captured = 1}, 7};
  EXPECT_FALSE(drain(*sink, closing));
  EXPECT_EQ(summary().closing, closing);
  EXPECT_TRUE(std::filesystem::exists(session_ / "checksums.sfv"));
}

TEST_F(RecordSinkTest, AReportIsRecordedWhileAFrameIsWritten) {
  const auto sink = this->sink();
  bool is_done = false;
  sink->async_write(plain_frame_ptr(0), [](const auto&) {});
  sink->note({false, wire::Stats{.captured = 3}, 7});
  sink->async_write(plain_frame_ptr(1), [&](const auto&) { is_done = true; });
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(summary().closing, (SessionClosing{false, wire::Stats{.captured = 3}, 7}));
}

TEST_F(RecordSinkTest, AReportWithoutAClockKeepsTheOffsetThatWasReported) {
  const auto sink = this->sink();
  EXPECT_FALSE(write(*sink, plain_frame_ptr(0)));
  sink->note({false, wire::Stats{.captured = 3}, 7});
  EXPECT_FALSE(drain(*sink, {true, wire::Stats{.captured = 4}, std::nullopt}));
  EXPECT_EQ(summary().closing.clock_offset_ns, 7);
}

TEST_F(RecordSinkTest, ViewsThatCannotBeMadeAreLoggedAndHoldNoEnd) {
  const test::CapturedLog log;
  const auto sink = this->sink();
  EXPECT_FALSE(write(*sink, plain_frame_ptr(0)));
  std::filesystem::create_directories(session_ / "checksums.sfv");  // no file takes its place
  EXPECT_FALSE(drain(*sink, {true, {}, {}}));
  EXPECT_TRUE(summary().has_ended());
  EXPECT_EQ(log.lines("not all lists are made: rename ").size(), 1U);
}

TEST_F(RecordSinkTest, AnEndOnAFullDiskIsAnErrorAndMayBeTriedAgain) {
  const auto sink = this->sink();
  EXPECT_FALSE(write(*sink, plain_frame_ptr(0)));
  const auto bytes = std::filesystem::file_size(session_ / "journal.000000");
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, bytes + 3);
    EXPECT_TRUE(drain(*sink, {true, {}, {}}));
  }
  EXPECT_FALSE(summary().has_ended());
  EXPECT_FALSE(drain(*sink, {true, {}, {}}));
  EXPECT_TRUE(summary().has_ended());
}

TEST_F(RecordSinkTest, MayBeDestroyedWhileItWrites) {
  auto sink = this->sink();
  bool is_done = false;
  sink->async_write(plain_frame_ptr(5, 1'000'000), [&](const auto&) { is_done = true; });
  sink.reset();
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(summary().position, (wire::Position{6, 0}));
}

}  // namespace
}  // namespace orbbuf
