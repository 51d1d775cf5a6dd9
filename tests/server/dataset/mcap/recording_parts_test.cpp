// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/recording_parts.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "server/session/session_reader.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/dataset/mcap/contents.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using test::plain_frame;
using testing::ElementsAre;

class RecordingPartsTest : public test::EventLoop {
 protected:
  ~RecordingPartsTest() override { end_work(); }

  void start(std::chrono::nanoseconds split, bool are_only_copies = false) {
    parts_.emplace(main_, files_, stores_,
                   RecordingParts::Options{parent_.path(), split, are_only_copies});
    parts_->start();
  }
  void open() {
    std::optional<Result<SessionStores::Opened>> opened;
    stores_.async_open({"r", "s", ""}, [&](auto outcome) { opened.emplace(std::move(outcome)); });
    ASSERT_TRUE(run_until([&] { return opened.has_value(); }));
    ASSERT_TRUE(*opened);
    store_ = opened->value().store;
  }
  void deliver(Sequence number) {
    std::optional<Result<bool>> answer;
    store_->run(
        [number](SessionStore& store) -> Result<bool> {
          if (auto error = store.write(plain_frame(number), 0)) return std::move(*error);
          return true;
        },
        [&](const Result<bool>& written) { answer = written; });
    ASSERT_TRUE(run_until([&] { return answer.has_value(); }));
    ASSERT_TRUE(*answer);
  }
  void close() { stores_.on_closed("r", "s"); }
  bool await(const std::string& file) {
    return run_until([&] { return fs::exists(folder_ / file); });
  }
  /// The journal has it, too.
  bool await_part(std::uint32_t number) {
    return run_until([&] {
      const auto summary = read_summary(folder_);
      return summary && summary->part && summary->part->number == number;
    });
  }
  std::vector<std::uint32_t> frames_of(const std::string& file) const {
    return test::read_mcap(folder_ / file).of("/r/image");
  }

  test::TemporaryFolder parent_;
  const fs::path folder_ = parent_ / "r" / "s";
  SessionStores stores_{main_, files_, parent_.path(), Durability::kAck, nullptr};
  std::optional<RecordingParts> parts_;
  std::shared_ptr<SharedStore> store_;
};

TEST_F(RecordingPartsTest, WithoutASplitASessionIsOnePart) {
  start(milliseconds(0));
  open();
  for (const Sequence number : {0U, 1U, 2U}) deliver(number);
  close();
  ASSERT_TRUE(await_part(1));
  EXPECT_THAT(frames_of("s-0001.mcap"), ElementsAre(0, 1, 2));
  EXPECT_TRUE(fs::exists(folder_ / "images" / "000001.jpg"));
}

TEST_F(RecordingPartsTest, PartsAreMadeWhileASessionGoesOn) {
  start(milliseconds(10));
  open();
  deliver(0);
  ASSERT_TRUE(await_part(1));
  deliver(1);
  ASSERT_TRUE(await_part(2));
  EXPECT_THAT(frames_of("s-0001.mcap"), ElementsAre(0));
  EXPECT_THAT(frames_of("s-0002.mcap"), ElementsAre(1));
}

TEST_F(RecordingPartsTest, WhatAnEarlierServerHasNotRecordedIsRecordedAtTheStart) {
  open();
  deliver(0);
  std::optional<Result<bool>> marked;
  store_->run(
      [](SessionStore& store) -> Result<bool> {
        if (auto error = store.note_part({})) return std::move(*error);
        return true;
      },
      [&](const Result<bool>& is_marked) { marked = is_marked; });
  ASSERT_TRUE(run_until([&] { return marked.has_value(); }));
  close();
  test::write_file(folder_ / "s-0001.mcap.tmp", "begun");
  start(milliseconds(0));
  ASSERT_TRUE(await_part(1));
  EXPECT_THAT(frames_of("s-0001.mcap"), ElementsAre(0));
  EXPECT_FALSE(fs::exists(folder_ / "s-0001.mcap.tmp"));
}

TEST_F(RecordingPartsTest, LateFramesOfASessionThatIsOverAreAPart) {
  start(milliseconds(10));
  open();
  deliver(0);
  deliver(2);
  close();
  ASSERT_TRUE(await_part(1));
  const auto waiter = std::make_shared<int>();
  stores_.write_late("r", {"s", plain_frame(1)}, waiter, [](const Result<bool>& /*kept*/) {});
  ASSERT_TRUE(await_part(2));
  EXPECT_THAT(frames_of("s-0002.mcap"), ElementsAre(1));
}

TEST_F(RecordingPartsTest, AnOnlyCopyTakesTheImagesPlace) {
  start(milliseconds(0), true);
  open();
  deliver(0);
  close();
  ASSERT_TRUE(await("s-0001.mcap"));
  EXPECT_TRUE(run_until([&] { return !fs::exists(folder_ / "images" / "000000.jpg"); }));
  EXPECT_THAT(frames_of("s-0001.mcap"), ElementsAre(0));
}

TEST_F(RecordingPartsTest, ImagesThatADeathHasLeftBesideTheirOnlyCopyGoAtTheStart) {
  open();
  deliver(0);
  std::optional<Result<bool>> noted;
  store_->run(
      [](SessionStore& store) -> Result<bool> {
        if (auto error = store.note_part({1, {}, store.written(), true})) return std::move(*error);
        return true;
      },
      [&](const Result<bool>& is_noted) { noted = is_noted; });
  ASSERT_TRUE(run_until([&] { return noted.has_value(); }));
  close();
  start(milliseconds(0), true);
  EXPECT_TRUE(run_until([&] { return !fs::exists(folder_ / "images" / "000000.jpg"); }));
}

TEST_F(RecordingPartsTest, TheEndOfTheServerWaitsForTheLastPart) {
  start(std::chrono::hours(1));
  open();
  deliver(0);
  close();
  bool is_stopped = false;
  parts_->stop([&] { is_stopped = true; });
  ASSERT_TRUE(run_until([&] { return is_stopped; }));
  EXPECT_THAT(frames_of("s-0001.mcap"), ElementsAre(0));
}

TEST_F(RecordingPartsTest, APartThatCannotBeWrittenIsAnError) {
  test::CapturedLog log;
  start(milliseconds(0));
  open();
  deliver(0);
  fs::create_directories(folder_ / "s-0001.mcap" / "in the way");
  close();
  bool is_stopped = false;
  parts_->stop([&] { is_stopped = true; });
  ASSERT_TRUE(run_until([&] { return is_stopped; }));
  EXPECT_THAT(log.lines("not recorded"), testing::Not(testing::IsEmpty()));
}

}  // namespace
}  // namespace orbbuf
