// SPDX-License-Identifier: Apache-2.0
#include "server/sink/file_sink.hpp"

#include <memory>
#include <thread>

#include "server/sink/session_files.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/sink/event_loop.hpp"

namespace orbbuf {
namespace {

using test::plain_frame_ptr;

class FileSinkTest : public test::EventLoop {
 protected:
  std::unique_ptr<FileSink> sink() {
    auto session = std::make_unique<SessionFiles>(folder_ / "s", "");
    const auto position = session->recover();
    return std::make_unique<FileSink>(main_, files_, std::move(session), position.value());
  }

  test::TemporaryFolder folder_;
};

TEST_F(FileSinkTest, AnswersOnMainWhenTheFrameIsOnDisk) {
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

TEST_F(FileSinkTest, RemembersHowFarItGot) {
  auto files = sink();
  EXPECT_FALSE(write(*files, plain_frame_ptr(5)));
  bool is_done = false;
  files->async_write_drops({{6, 0, DropReason::kPolicy}}, [&](const auto& error) {
    EXPECT_FALSE(error);
    is_done = true;
  });
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(sink()->position(), (wire::Position{6, 1}));
}

TEST_F(FileSinkTest, TellsWhyAFrameWasNotTaken) {
  test::write_file(folder_ / "s", "a file where the folder should be");
  FileSink files(main_, files_, std::make_unique<SessionFiles>(folder_ / "s", ""), {});
  const auto error = write(files, plain_frame_ptr(0));
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "create " + (folder_ / "s/images").string() + ": Not a directory");
}

TEST_F(FileSinkTest, IsFinishedBehindWhatWasBegunAndOnce) {
  struct Calls final : SessionRecord {
    explicit Calls(std::string& log) : log_(log) {}
    std::optional<Error> write(const EncodedFrame& /*frame*/) override {
      log_ += "write ";
      return std::nullopt;
    }
    std::optional<Error> write_drops(std::span<const DropRecord> /*records*/) override {
      return std::nullopt;
    }
    std::optional<Error> finish() override {
      log_ += "finish ";
      return Error{"it failed"};
    }
    std::string& log_;
  };
  const test::CapturedLog log;
  std::string calls;
  auto files =
      std::make_unique<FileSink>(main_, files_, std::make_unique<Calls>(calls), wire::Position{});
  files->async_write(plain_frame_ptr(5), [](const auto&) {});
  files->close();
  files->close();
  files.reset();
  files_.join();
  EXPECT_EQ(calls, "write finish ");
  EXPECT_EQ(log.lines("it failed").size(), 1U);
}

TEST_F(FileSinkTest, MayBeDestroyedWhileItWrites) {
  auto files = sink();
  bool is_done = false;
  files->async_write(plain_frame_ptr(5, 1'000'000), [&](const auto&) { is_done = true; });
  files.reset();
  ASSERT_TRUE(run_until([&] { return is_done; }));
  EXPECT_EQ(sink()->position(), (wire::Position{6, 0}));
}

}  // namespace
}  // namespace orbbuf
