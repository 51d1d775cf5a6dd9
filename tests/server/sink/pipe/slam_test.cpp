// SPDX-License-Identifier: Apache-2.0
// A SLAM program that comes and goes beside the files of its session: what each of its runs gets.
#include "server/sink/pipe/slam.hpp"

#include <csignal>

#include "server/session/session_store.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::jpeg_frame_ptr;

/// Plays the session: each frame goes to the files, then to the sink.
class SlamTest : public test::EventLoop {
 protected:
  SlamTest() {
    settings_.format = PipeFormat::kMjpeg;
    settings_.resume = Resume::kBacklog;
  }
  ~SlamTest() override {
    if (slam_) slam_->close();
    run_until([] { return has_no_children(); });
    run_ready();
  }
  void start(const std::string& command) {
    settings_.command = command;
    const KeptFrames kept{folder_ / "kept", next_};
    slam_ = make_slam_sink(settings_, {"r", "s", ""}, kept, main_, files_);
  }
  void stream(int count, int width_px = 64) {
    for (int i = 0; i < count; ++i) {
      const auto frame = jpeg_frame_ptr(next_++, width_px, 64);
      EXPECT_FALSE(kept_->write(*frame, 0));
      EXPECT_FALSE(write(*slam_, frame));
    }
  }
  void drain() {
    bool is_drained = false;
    slam_->async_drain({}, [&](const auto&) { is_drained = true; });
    EXPECT_TRUE(run_until([&] { return is_drained; }));
    slam_->close();
    EXPECT_TRUE(run_until([] { return has_no_children(); }));
  }
  /// The numbers in a stream of the format mjpeg.
  std::vector<Sequence> sequences(const std::string& name) const {
    const std::string all = test::read_file(folder_ / name);
    std::vector<Sequence> found;
    for (std::size_t at = 0; (at = all.find("seq=", at)) != all.npos; ++at) {
      found.push_back(std::stoull(all.substr(at + 4)));
    }
    return found;
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  test::TemporaryFolder folder_;
  const std::unique_ptr<SessionStore> kept_ =
      SessionStore::open(folder_ / "kept", {"r", "s", ""}, Durability::kOff).value();
  SlamSettings settings_;
  std::shared_ptr<FrameSink> slam_;
  Sequence next_ = 0;
};

std::vector<Sequence> from_to(Sequence first, Sequence last) {
  std::vector<Sequence> all;
  for (Sequence i = first; i <= last; ++i) all.push_back(i);
  return all;
}

/// A part of an image, then a crash; the second run reads all.
std::string crashing_first(const std::string& folder) {
  return "if [ -e " + folder + "/0 ]; then cat > " + folder + "/1; else head -c 1000 > " + folder +
         "/0; kill -9 $$; fi";
}

TEST_F(SlamTest, TheNextRunGetsTheBacklogInOrderAndThenTheLiveStream) {
  const test::CapturedLog log;
  start(crashing_first(folder_.path().string()));
  stream(20);
  ASSERT_TRUE(run_until([&] { return !log.lines("killed by signal 9").empty(); }));
  stream(20);
  ASSERT_TRUE(run_until([&] { return log.lines("has a reader").size() > 1; }));
  stream(20);
  drain();
  EXPECT_EQ(sequences("1"), from_to(0, 59));  // the first run did not even read frame 0 to its end
}

TEST_F(SlamTest, TheNextRunBeginsLiveWhereThatIsWanted) {
  const test::CapturedLog log;
  settings_.resume = Resume::kLive;
  start(crashing_first(folder_.path().string()));
  stream(1);
  ASSERT_TRUE(run_until([&] { return !log.lines("killed by signal 9").empty(); }));
  stream(20);
  ASSERT_TRUE(run_until([&] { return log.lines("has a reader").size() > 1; }));
  stream(20);
  drain();
  const auto second = sequences("1");
  ASSERT_FALSE(second.empty());
  EXPECT_GE(second.front(), 1U);  // 21, unless this thread stood still for a second
  EXPECT_EQ(second, from_to(second.front(), 40));
}

TEST_F(SlamTest, AServerThatStartsAnewGivesTheLastFrameAgain) {
  start("cat > " + path("0"));
  stream(5);
  drain();
  start("cat > " + path("1"));
  stream(5);
  drain();
  EXPECT_EQ(sequences("0"), from_to(0, 4));
  EXPECT_EQ(sequences("1"), from_to(4, 9));
}

TEST_F(SlamTest, WhileItCatchesUpTheRobotsStreamIsNotHeld) {
  const auto is_there = [&](const char* name) {
    return [this, name] { return std::filesystem::exists(folder_ / name); };
  };
  start("if [ -e " + path("0") + " ]; then touch " + path("up") + "; while [ ! -e " + path("go") +
        " ]; do sleep 0.01; done; cat > " + path("1") + "; else touch " + path("0") + "; fi");
  ASSERT_TRUE(run_until(is_there("0")));
  ASSERT_TRUE(run_until([] { return has_no_children(); }));
  stream(10, 2000);  // far more than a pipe holds
  ASSERT_TRUE(run_until(is_there("up")));
  stream(10, 2000);  // it reads nothing yet
  test::write_file(folder_ / "go", "");
  drain();
  EXPECT_EQ(sequences("1"), from_to(0, 19));
}

TEST_F(SlamTest, ASlowProgramThatIsThereHoldsTheStream) {
  start("while [ ! -e " + path("go") + " ]; do sleep 0.01; done; cat > " + path("1"));
  ASSERT_TRUE(run_until([] { return !has_no_children(); }));
  bool is_taken = false;
  slam_->async_write(jpeg_frame_ptr(0, 2000, 500), [&](const auto& error) {
    EXPECT_FALSE(error);
    is_taken = true;
  });
  run_ready();
  EXPECT_FALSE(is_taken);
  test::write_file(folder_ / "go", "");
  EXPECT_TRUE(run_until([&] { return is_taken; }));
  drain();
  EXPECT_EQ(sequences("1"), from_to(0, 0));
}

TEST_F(SlamTest, OneThatLeavesAProcessWithItsInputHasLeftAllTheSame) {
  start("exec 3<&0; if [ -e " + path("pid") + " ]; then cat > " + path("1") +
        "; else sleep 1000 <&3 & echo $! > " + path("pid") + "; fi");
  ASSERT_TRUE(run_until([&] { return std::filesystem::exists(folder_ / "pid"); }));
  stream(10, 2000);
  ASSERT_TRUE(run_until([&] { return std::filesystem::exists(folder_ / "1"); }));
  drain();
  EXPECT_EQ(sequences("1"), from_to(0, 9));
  EXPECT_EQ(::kill(std::stoi(test::read_file(folder_ / "pid")), SIGKILL), 0);
}

TEST_F(SlamTest, OneThatClosesItsInputLetsFramesPassWhileItRunsOn) {
  settings_.resume = Resume::kLive;
  start("exec <&-; touch " + path("on") + "; while [ -e " + path("on") + " ]; do sleep 0.01; done");
  ASSERT_TRUE(run_until([&] { return std::filesystem::exists(folder_ / "on"); }));
  stream(10, 2000);
  EXPECT_FALSE(has_no_children());
  std::filesystem::remove(folder_ / "on");
  drain();
}

TEST_F(SlamTest, OneThatIsNotStartedAgainLeavesTheStreamToTheFiles) {
  const test::CapturedLog log;
  settings_.restart = Restart::kNever;
  start("head -c 1000 > " + path("0"));
  stream(100);
  ASSERT_TRUE(run_until([&] { return log.lines("; not started again").size() == 1; }));
  stream(100);
  drain();
  EXPECT_EQ(log.lines("has a reader").size(), 1U);
}

}  // namespace
}  // namespace orbbuf
