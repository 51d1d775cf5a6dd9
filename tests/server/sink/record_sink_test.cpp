// SPDX-License-Identifier: Apache-2.0
#include "server/sink/record_sink.hpp"

#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "server/recording/session_files.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::plain_frame_ptr;

/// Notes what it is asked to do.
struct Calls final : SessionRecord {
  Calls(std::string name, std::string& log) : name_(std::move(name)), log_(log) {}
  std::optional<Error> write(const EncodedFrame& /*frame*/) override { return log("write"); }
  std::optional<Error> write_drops(const wire::Dropped& /*dropped*/) override {
    return log("drops");
  }
  void note(const SessionClosing& /*reported*/) override { log("stats"); }
  std::optional<Error> finish(SessionClosing& /*closing*/) override {
    log_ += name_ + " finish, ";
    return Error{"it failed"};
  }
  std::optional<Error> log(const std::string& call) {
    log_ += name_ + " " + call + ", ";
    return std::exchange(next_error_, std::nullopt);
  }

  const std::string name_;
  std::string& log_;
  std::optional<Error> next_error_;
};

class RecordSinkTest : public test::EventLoop {
 protected:
  std::unique_ptr<RecordSink> sink() {
    auto session = std::make_unique<SessionFiles>(folder_ / "s", "");
    const auto position = session->recover();
    return sink_of(std::move(session), position.value());
  }
  std::unique_ptr<RecordSink> sink_of(std::unique_ptr<SessionRecord> record,
                                      wire::Position position = {}) {
    RecordSink::Records records;
    records.push_back(std::move(record));
    return std::make_unique<RecordSink>(main_, files_, std::move(records), position,
                                        RecordSink::Commit{});
  }

  test::TemporaryFolder folder_;
};

TEST_F(RecordSinkTest, AnswersOnMainWhenTheFrameIsOnDisk) {
  const auto files = sink();
  std::optional<std::thread::id> answered_by;
  files->async_write(plain_frame_ptr(5), [&](const std::optional<Error>& error) {
    EXPECT_FALSE(error);
    answered_by = std::this_thread::get_id();
  });
  EXPECT_FALSE(answered_by);
  ASSERT_TRUE(run_until([&] { return answered_by.has_value(); }));
  EXPECT_EQ(*answered_by, std::this_thread::get_id());
  EXPECT_TRUE(std::filesystem::exists(folder_ / "s/images/000005.jpg"));
}

TEST_F(RecordSinkTest, RemembersHowFarItGot) {
  auto files = sink();
  EXPECT_FALSE(write(*files, plain_frame_ptr(5)));
  bool is_done = false;
  files->async_write_drops({0, {{6, 0, DropReason::kPolicy}}}, [&](const auto& error) {
    EXPECT_FALSE(error);
    is_done = true;
  });
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(sink()->position(), (wire::Position{6, 1}));
}

TEST_F(RecordSinkTest, TellsWhyAFrameWasNotTaken) {
  test::write_file(folder_ / "s", "a file where the folder should be");
  const auto files = sink_of(std::make_unique<SessionFiles>(folder_ / "s", ""));
  const auto error = write(*files, plain_frame_ptr(0));
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "create " + (folder_ / "s/images").string() + ": Not a directory");
}

TEST_F(RecordSinkTest, IsFinishedBeforeItIsDrained) {
  const test::CapturedLog log;
  std::string calls;
  auto files = sink_of(std::make_unique<Calls>("a", calls));
  EXPECT_FALSE(write(*files, plain_frame_ptr(5)));
  bool is_drained = false;
  files->async_drain({}, [&] { is_drained = true; });
  files.reset();
  ASSERT_TRUE(run_until([&] { return is_drained; }));
  EXPECT_EQ(calls, "a write, a finish, ");
  EXPECT_EQ(log.lines("it failed").size(), 1U);
}

TEST_F(RecordSinkTest, WritesEachRecordInTurn) {
  std::string calls;
  RecordSink::Records records;
  records.push_back(std::make_unique<Calls>("a", calls));
  records.push_back(std::make_unique<Calls>("b", calls));
  RecordSink sink(main_, files_, std::move(records), {}, {});
  EXPECT_FALSE(write(sink, plain_frame_ptr(5)));
  EXPECT_EQ(calls, "a write, b write, ");
  bool is_drained = false;
  sink.async_drain({}, [&] { is_drained = true; });
  ASSERT_TRUE(run_until([&] { return is_drained; }));
  EXPECT_EQ(calls, "a write, b write, b finish, a finish, ");
}

TEST_F(RecordSinkTest, NotesStatsWhileAFrameIsWritten) {
  const test::CapturedLog log;
  std::string calls;
  const auto files = sink_of(std::make_unique<Calls>("a", calls));
  bool is_drained = false;
  files->async_write(plain_frame_ptr(5), [](const auto&) {});
  files->note({});
  files->async_drain({}, [&] { is_drained = true; });
  ASSERT_TRUE(run_until([&] { return is_drained; }));
  EXPECT_EQ(calls, "a write, a stats, a finish, ");
}

TEST_F(RecordSinkTest, ARepeatGoesOnWithTheRecordThatFailed) {
  std::string calls;
  auto first = std::make_unique<Calls>("a", calls);
  auto second = std::make_unique<Calls>("b", calls);
  first->next_error_ = Error{"a is full"};
  second->next_error_ = Error{"b is full"};
  RecordSink::Records records;
  records.push_back(std::move(first));
  records.push_back(std::move(second));
  RecordSink sink(main_, files_, std::move(records), {}, {});

  EXPECT_EQ(write(sink, plain_frame_ptr(5)).value_or(Error{}).text, "a is full");
  EXPECT_FALSE(sink.is_partly_taken());
  EXPECT_EQ(write(sink, plain_frame_ptr(5)).value_or(Error{}).text, "b is full");
  EXPECT_TRUE(sink.is_partly_taken());
  EXPECT_FALSE(write(sink, plain_frame_ptr(5)));
  EXPECT_FALSE(sink.is_partly_taken());
  EXPECT_FALSE(write(sink, plain_frame_ptr(6)));
  EXPECT_EQ(calls, "a write, a write, b write, b write, a write, b write, ");
}

TEST_F(RecordSinkTest, MayBeDestroyedWhileItWrites) {
  auto files = sink();
  bool is_done = false;
  files->async_write(plain_frame_ptr(5, 1'000'000), [&](const auto&) { is_done = true; });
  files.reset();
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(sink()->position(), (wire::Position{6, 0}));
}

}  // namespace
}  // namespace orbbuf
