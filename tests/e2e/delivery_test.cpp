// SPDX-License-Identifier: Apache-2.0
// The whole path over loopback, on real input, with the two real programs.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <fstream>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

/// `TIME NAME` lines of a sequence's times.txt -> times with nine digits, as the server writes
/// them.
std::vector<std::string> source_times(const fs::path& sequence) {
  std::vector<std::string> times;
  for (const std::string& line : read_lines(sequence / "times.txt")) {
    if (line.starts_with('#')) continue;
    std::string time = line.substr(0, line.find(' '));
    time.append(9 - (time.size() - time.find('.') - 1), '0');
    times.push_back(time);
  }
  return times;
}

/// How many frames the one session in a robot's folder holds by now.
std::size_t lines_in_times(const fs::path& robot) {
  if (!fs::exists(robot)) return 0;
  for (const auto& session : fs::directory_iterator(robot)) {
    return read_lines(session.path() / "times.txt").size();
  }
  return 0;
}

/// Waits until the server has really written that many of them; false if the robot ends first, or
/// after two minutes.
bool wait_for_frames(Process& robot, const fs::path& folder, std::size_t wanted) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (lines_in_times(folder) < wanted) {
    if (robot.wait(std::chrono::seconds(0)) >= 0) return false;
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::yield();
  }
  return true;
}

class DeliveryTest : public ::testing::TestWithParam<const char*> {};

TEST_P(DeliveryTest, EveryFrameOfARealSequenceArrivesInOrderWithItsTime) {
  const fs::path sequence = shared_sequence(GetParam());
  if (sequence.empty()) GTEST_SKIP() << "no ../shared/data/sequences/" << GetParam();
  const TemporaryFolder out;
  Server server(out.path());
  Process robot(robot_command("r", server.address(), replay(sequence)));
  ASSERT_EQ(robot.wait(), 0) << robot.output();

  const std::vector<std::string> times = source_times(sequence);
  const Record record = read_record(out.path(), "r");
  expect_exactly_once(record, times.size());
  EXPECT_EQ(record.delivered.size(), times.size());
  EXPECT_EQ(record.times, times);
  const auto stats = closing_stats(robot);
  EXPECT_EQ(stats.at("captured"), times.size());
  EXPECT_EQ(stats.at("acknowledged"), times.size());
}

INSTANTIATE_TEST_SUITE_P(Sequences, DeliveryTest,
                         ::testing::Values("kitti06_mono", "picar_indoor"));

TEST(Delivery, JpegInputArrivesByteForByte) {
  const fs::path sequence = shared_sequence("picar_indoor");
  if (sequence.empty()) GTEST_SKIP() << "no ../shared/data/sequences/picar_indoor";
  const TemporaryFolder out;
  Server server(out.path());
  ASSERT_EQ(run(robot_command("r", server.address(), replay(sequence))).status, 0);
  const fs::path images = read_record(out.path(), "r").folder / "images";
  std::size_t compared = 0;
  for (const auto& image : fs::directory_iterator(sequence / "images")) {
    EXPECT_EQ(
        run({"cmp", image.path().string(), (images / image.path().filename()).string()}).status, 0);
    ++compared;
  }
  EXPECT_EQ(compared, 290U);
}

TEST(Delivery, CalibrationOfTheRobotLiesBesideItsFrames) {
  const TemporaryFolder folder;
  const std::string calibration = "Pinhole 500 500 320 240 0\n640 480\nnone\n640 480\n";
  write_file(folder / "robot.toml", "[camera]\ncalibration = '''\n" + calibration + "'''\n");
  Server server(folder / "out");
  std::vector<std::string> command =
      robot_command("r", server.address(), {"source.frames=3", "source.realtime=false"});
  command.insert(command.begin() + 1, {"--config", (folder / "robot.toml").string()});
  ASSERT_EQ(run(command).status, 0);
  const Record record = read_record(folder / "out", "r");
  expect_exactly_once(record, 3);
  EXPECT_EQ(read_file(record.folder / "camera.txt"), calibration);
}

TEST(Delivery, ManyRobotsAtOnceEachGetTheirOwn) {
  const TemporaryFolder out;
  Server server(out.path());
  std::vector<std::unique_ptr<Process>> robots;
  for (int i = 0; i < 8; ++i) {
    robots.push_back(std::make_unique<Process>(
        robot_command("robot" + std::to_string(i), server.address(),
                      {"source.frames=50", "source.realtime=false", "source.width=160",
                       "source.height=120", "source.seed=" + std::to_string(i)})));
  }
  for (const auto& robot : robots) EXPECT_EQ(robot->wait(), 0) << robot->output();
  std::string first;
  for (int i = 0; i < 8; ++i) {
    const Record record = read_record(out.path(), "robot" + std::to_string(i));
    expect_exactly_once(record, 50);
    const std::string image = read_file(record.folder / "images/000000.jpg");
    EXPECT_FALSE(image.empty());
    EXPECT_NE(image, first) << "another robot's frame";
    first = image;
  }
}

TEST(Delivery, KilledServerGoesOnWhereItsFilesEndAfterARestart) {
  const TemporaryFolder out;
  auto server = std::make_unique<Server>(out.path());
  const std::string address = server->address();
  Process robot(
      robot_command("r", address,
                    {"source.frames=1000000", "source.fps=100", "source.width=320",
                     "source.height=120", "buffer.capacity=1000", "source.stereo=side-by-side"}));
  for (int kill = 0; kill < 3; ++kill) {
    const std::size_t before = static_cast<std::size_t>(kill + 1) * 60;
    ASSERT_TRUE(wait_for_frames(robot, out / "r", before)) << robot.output();
    server->process().signal(SIGKILL);
    server->process().wait();
    server = std::make_unique<Server>(out.path(), Overrides{}, address);
  }
  ASSERT_TRUE(wait_for_frames(robot, out / "r", 400)) << robot.output();
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  const Record record = read_record(out.path(), "r");
  const auto stats = closing_stats(robot);
  expect_exactly_once(record, stats.at("captured"));
  EXPECT_EQ(record.delivered.size(), stats.at("acknowledged"));
  EXPECT_EQ(record.images_right, record.images);
  for (const char* side : {"images", "images_right"}) {
    for (const auto& image : fs::directory_iterator(record.folder / side)) {
      const std::string jpeg = read_file(image.path());
      EXPECT_TRUE(jpeg.starts_with("\xff\xd8") && jpeg.ends_with("\xff\xd9")) << image.path();
    }
  }
}

TEST(Delivery, StoppedRobotDeliversWhatWaitsAndSaysBye) {
  const TemporaryFolder out;
  Server server(out.path());
  Process robot(robot_command("r", server.address(),
                              {"source.frames=100000", "source.width=160", "source.height=120"}));
  ASSERT_TRUE(robot.wait_for_line("captured "));
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  const auto stats = closing_stats(robot);
  EXPECT_EQ(stats.at("waiting") + stats.at("in flight"), 0U);
  expect_exactly_once(read_record(out.path(), "r"), stats.at("captured"));
}

TEST(Delivery, SlamProgramReadsTheFramesFromAPipe) {
  const TemporaryFolder out;
  const fs::path pgm = out / "stream.pgm";
  Server server(out / "files", {"slam.command=cat > " + pgm.string(), "slam.format=pgm"});
  ASSERT_EQ(run(robot_command("r", server.address(),
                              {"source.frames=20", "source.realtime=false", "source.width=160",
                               "source.height=120"}))
                .status,
            0);
  ASSERT_TRUE(server.process().wait_for_line("exited with status 0"));
  server.process().signal(SIGTERM);
  ASSERT_EQ(server.process().wait(), 0);
  const std::string stream = read_file(pgm);
  std::size_t at = 0;
  for (int i = 0; i < 20; ++i) {
    const std::string head = "P5\n# seq=" + std::to_string(i) + "\n# t=";
    ASSERT_EQ(stream.substr(at, head.size()), head) << i;
    at = stream.find("\n160 120\n255\n", at);
    ASSERT_NE(at, std::string::npos);
    at += 13 + 160 * 120;
  }
  EXPECT_EQ(at, stream.size());
}

}  // namespace
}  // namespace orbbuf::test
