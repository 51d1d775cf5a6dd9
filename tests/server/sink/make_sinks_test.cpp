// SPDX-License-Identifier: Apache-2.0
#include "server/sink/make_sinks.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <stdexcept>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

class MakeSinksTest : public test::EventLoop {
 protected:
  MakeSinksTest() { settings_.files_path = folder_ / "data"; }
  ~MakeSinksTest() override {
    for (const auto& sink : sinks_) sink->close();
    run_until([] { return has_no_children(); });
    run_ready();
  }
  std::size_t make() {
    std::optional<OpenedSession> opened;
    if (settings_.is_kept()) {
      stores_.async_open(info_, [&](auto session) { opened = std::move(session).value(); });
      EXPECT_TRUE(run_until([&] { return opened.has_value(); }));
    }
    sinks_ = make_sinks(settings_, info_, opened.value_or(OpenedSession{}), main_, files_);
    return sinks_.size();
  }

  test::TemporaryFolder folder_;
  const SessionInfo info_{"r1", "s1", ""};
  SinkSettings settings_;
  SessionStores stores_{main_, files_, folder_ / "data", Durability::kOff, nullptr};
  std::vector<std::shared_ptr<FrameSink>> sinks_;
};

TEST_F(MakeSinksTest, FilesGoToAFolderForTheRobotAndTheSession) {
  ASSERT_EQ(make(), 1U);
  EXPECT_FALSE(write(*sinks_[0], test::plain_frame_ptr(2)));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "data/r1/s1/images/000002.jpg"));
  ASSERT_EQ(make(), 1U);
  EXPECT_EQ(sinks_[0]->position(), (wire::Position{3, 0}));
}

TEST_F(MakeSinksTest, TheFifoOfASessionIsNamedAfterIt) {
  settings_.slam.fifo = folder_ / "{robot}" / "{session}-{robot}.fifo";
  ASSERT_EQ(make(), 2U);
  EXPECT_TRUE(std::filesystem::is_fifo(folder_ / "r1/s1-r1.fifo"));
  EXPECT_FALSE(write(*sinks_[1], test::plain_frame_ptr(0)));  // passes: files have it
}

TEST_F(MakeSinksTest, TheCommandOfASessionKnowsWhoseItIs) {
  settings_.files_enabled = false;
  settings_.slam.command =
      "echo {robot} {session} $ORBBUF_ROBOT $ORBBUF_SESSION > " + (folder_ / "out").string();
  ASSERT_EQ(make(), 1U);
  ASSERT_TRUE(run_until([] { return has_no_children(); }));
  EXPECT_EQ(test::read_file(folder_ / "out"), "r1 s1 r1 s1\n");
}

TEST_F(MakeSinksTest, ARobotMayHaveItsOwnSlamOrNone) {
  settings_.slam.command = "touch " + (folder_ / "everyones").string();
  settings_.slam_of["r1"].command = "touch " + (folder_ / "own").string();
  settings_.slam_of["r1"].restart = Restart::kNever;
  ASSERT_EQ(make(), 2U);
  ASSERT_TRUE(run_until([] { return has_no_children(); }));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "own"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "everyones"));
  settings_.slam_of["r1"].command = "";
  ASSERT_EQ(make(), 1U);
}

TEST_F(MakeSinksTest, TheNextSlamMayBeginWithWhatTheLastOneMissed) {
  settings_.slam.fifo = folder_ / "fifo";
  settings_.slam.format = PipeFormat::kMjpeg;
  settings_.slam.resume = Resume::kBacklog;
  ASSERT_EQ(make(), 2U);
  const auto frame = test::jpeg_like_frame_ptr(0);
  for (const auto& sink : sinks_) EXPECT_FALSE(write(*sink, frame));
  const UniqueFd end(::open((folder_ / "fifo").c_str(), O_RDONLY | O_NONBLOCK));
  char byte = 0;
  EXPECT_TRUE(run_until([&] { return ::read(end.get(), &byte, 1) == 1; }));
}

TEST_F(MakeSinksTest, WithoutFilesTheNextSlamGetsNothingFromThem) {
  settings_.files_enabled = false;
  settings_.mcap_enabled = true;
  settings_.slam.fifo = folder_ / "fifo";
  settings_.slam.resume = Resume::kBacklog;
  EXPECT_EQ(make(), 2U);
}

TEST_F(MakeSinksTest, AFailedSyncIsLoggedAsWhatItMeansInThatMode) {
  const test::CapturedLog log;
  settings_.files_path = folder_ / "not there";
  for (const auto sync : {Durability::kAck, Durability::kSecond}) {
    settings_.files_sync = sync;
    const auto commit = make_group_commit(settings_, main_);
    bool is_done = false;
    commit->async_commit([&](const std::optional<Error>& error) { is_done = error.has_value(); });
    EXPECT_TRUE(run_until([&] { return is_done; }));
  }
  EXPECT_EQ(log.lines("No such file or directory; frames are not acknowledged any more: ").size(),
            1U);
  EXPECT_EQ(log.lines("; frames are acknowledged and not synced any more").size(), 1U);
}

/// As another user, for root may write anywhere.
TEST_F(MakeSinksTest, NoPermissionIsToldWithTheFolderTheUserAndWhatToDo) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to become another user";
  constexpr uid_t kNobody = 65534;
  for (const auto& path : {folder_.path(), folder_ / "data"}) {
    settings_.files_path = path;
    std::string said;
    ASSERT_EQ(::setresuid(kNobody, kNobody, 0), 0);
    try {
      check_sinks(settings_);
    } catch (const std::runtime_error& error) {
      said = error.what();
    }
    ASSERT_EQ(::setresuid(0, 0, 0), 0);
    EXPECT_THAT(said, testing::HasSubstr("cannot write to files.path " + path.string() +
                                         ": Permission denied; give user 65534 the right to"));
  }
}

TEST_F(MakeSinksTest, AFolderThatCannotBeMadeIsToldAtTheStart) {
  test::write_file(folder_ / "data", "a file where the folder should be");
  settings_.files_path = folder_ / "data" / "deeper";
  EXPECT_THROW(check_sinks(settings_), std::runtime_error);
  settings_.files_path = folder_ / "new" / "deeper";
  check_sinks(settings_);
  EXPECT_TRUE(std::filesystem::is_directory(settings_.files_path));
}

}  // namespace
}  // namespace orbbuf
