// SPDX-License-Identifier: Apache-2.0
// Samples of an inertial sensor beside frames: each arrives once, before the first newer frame.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <boost/asio/local/datagram_protocol.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <sstream>

#include "common/decimal.hpp"
#include "common/sample.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

constexpr int kFrames = 250;
constexpr std::int64_t kSampleNs = 1'000'000;

/// 1 kHz over the time of the frames, which come at 25 Hz; and what is not captured any more.
std::vector<Sample> make_samples(std::int64_t begin_ns = 0) {
  std::vector<Sample> samples;
  for (std::int64_t i = 0; i < kFrames * 40 + 5000; ++i) {
    const auto value = static_cast<double>(i);
    samples.push_back(
        {begin_ns + i * kSampleNs + 137, {value / 3, -value, 0.5}, {0, 1e-3 * value, 9.81}});
  }
  return samples;
}

void write_samples(const fs::path& path, const std::vector<Sample>& samples) {
  std::ofstream file(path);
  file << kEurocImuHeader;
  for (const Sample& sample : samples) file << to_euroc_line(sample);
}

std::vector<Sample> read_samples(const fs::path& path) {
  std::istringstream file(read_file(path));
  std::string line;
  std::getline(file, line);
  EXPECT_EQ(line + "\n", kEurocImuHeader);
  std::vector<Sample> samples;
  while (std::getline(file, line)) {
    const auto sample = parse_euroc_line(line);
    if (!sample) throw std::runtime_error("no sample: " + line);
    samples.push_back(*sample);
  }
  return samples;
}

/// Those up to the time of the last frame, in their order.
void expect_each_once(const Record& record, std::vector<Sample> sent) {
  const std::int64_t last_ns = *parse_seconds(record.times.back());
  std::erase_if(sent, [&](const Sample& sample) { return sample.time_ns > last_ns; });
  EXPECT_EQ(read_samples(record.folder / "imu0/data.csv"), sent);
  const Finished check = run({kOrbbufServer, "check", record.folder});
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_NE(check.output.find("samples, 0 lost"), std::string::npos) << check.output;
  EXPECT_EQ(check.output.find("behind a newer frame"), std::string::npos) << check.output;
}

class Samples : public ::testing::Test {
 protected:
  Samples() { write_samples(folder_ / "data.csv", sent_); }

  Overrides settings() const {
    return {"source.width=160", "source.height=120", "source.frames=" + std::to_string(kFrames),
            "buffer.drop_log=" + (folder_ / "record").string(),
            "stream.imu0.path=" + (folder_ / "data.csv").string()};
  }

  /// In place of sent_: of the time of day, as frames in real time are.
  std::vector<Sample> write_samples_from_now() const {
    const std::chrono::nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
    auto samples = make_samples(now.count());
    write_samples(folder_ / "data.csv", samples);
    return samples;
  }

  const TemporaryFolder folder_;
  const std::vector<Sample> sent_ = make_samples();
};

TEST_F(Samples, ArriveOnceAndInOrderBesideTheFrames) {
  Overrides fast = settings();
  fast.emplace_back("source.realtime=false");
  const Server server(folder_ / "out");
  const Finished robot = run(robot_command(kRobot, server.address(), fast));
  ASSERT_EQ(robot.status, 0) << robot.output;
  const Record record = read_record(folder_ / "out", kRobot);
  expect_exactly_once(record, kFrames);
  expect_each_once(record, sent_);
  EXPECT_NE(read_file(record.folder / "session.txt").find("imu0 delivered "), std::string::npos);
  const fs::path out = folder_ / "euroc";
  const Finished exported = run({kOrbbufServer, "export", "--layout", "euroc", record.folder, out});
  ASSERT_EQ(exported.status, 0) << exported.output;
  EXPECT_EQ(read_file(out / "mav0/imu0/data.csv"), read_file(record.folder / "imu0/data.csv"));
}

TEST_F(Samples, OfADriverArriveOnceThroughItsSocket) {
  const fs::path socket = folder_ / "imu";
  Overrides live = settings();
  live.back() = "stream.imu0.path=" + socket.string();
  live.emplace_back("stream.imu0.kind=socket");
  const Server server(folder_ / "out");
  Process robot(robot_command(kRobot, server.address(), live));
  ASSERT_TRUE(robot.wait_for_line("] captured ")) << robot.output();
  boost::asio::io_context io;
  boost::asio::local::datagram_protocol::socket driver(io, {});
  driver.connect(socket.string());
  for (const Sample& sample : sent_) driver.send(boost::asio::buffer(to_euroc_line(sample)));
  EXPECT_EQ(robot.wait(), 0) << robot.output();
  const Record record = read_record(folder_ / "out", kRobot);
  expect_exactly_once(record, kFrames);
  EXPECT_EQ(read_samples(record.folder / "imu0/data.csv"), sent_);
}

TEST_F(Samples, ArriveOnceThroughAnOutageAndAServerThatIsKilled) {
  const auto sent = write_samples_from_now();
  Server server(folder_ / "out");
  Process robot(robot_command(kRobot, server.address(), settings()));
  ASSERT_TRUE(robot.wait_for_lines("] captured ", 2)) << robot.output();
  server.process().signal(SIGKILL);
  ASSERT_TRUE(robot.wait_for_line(", no connection")) << robot.output();
  ASSERT_TRUE(robot.wait_for_lines("] captured ", robot.count_lines("] captured ") + 2));
  const Server again(folder_ / "out", {}, server.address());
  EXPECT_EQ(robot.wait(), 0) << robot.output();
  const auto samples = robot.wait_for_line("samples: imu0 captured ");
  ASSERT_TRUE(samples) << robot.output();
  EXPECT_NE(samples->find("late 0 + waiting 0 + lost 0"), std::string::npos) << *samples;
  const Record record = read_record(folder_ / "out", kRobot);
  expect_exactly_once(record, kFrames);
  expect_each_once(record, sent);
}

/// What waited in its memory comes with the next start, as samples of the session that captured
/// them.
TEST_F(Samples, OfARobotThatIsKilledInAnOutageComeLate) {
  const auto sent = write_samples_from_now();
  Server server(folder_ / "out");
  Process robot(robot_command(kRobot, server.address(), settings()));
  ASSERT_TRUE(robot.wait_for_lines("] captured ", 2)) << robot.output();
  server.process().signal(SIGKILL);
  ASSERT_TRUE(robot.wait_for_line(", no connection")) << robot.output();
  const int noted = robot.count_lines("] captured ") + 1;
  ASSERT_TRUE(robot.wait_for_lines("] captured ", noted + 1));
  robot.signal(SIGKILL);
  robot.wait();
  const Server again(folder_ / "out", {}, server.address());
  Overrides longer = settings();
  longer.emplace_back("source.frames=3000");
  Process next(robot_command(kRobot, server.address(), longer));
  ASSERT_TRUE(next.wait_for_line("the server knows what became of session")) << next.output();
  next.signal(SIGTERM);
  EXPECT_EQ(next.wait(), 0) << next.output();

  std::vector<fs::path> sessions(fs::directory_iterator(folder_ / "out" / kRobot), {});
  std::ranges::sort(sessions);
  ASSERT_EQ(sessions.size(), 2U);
  const auto delivered = read_samples(sessions.front() / "imu0/data.csv");
  // Those of the seconds before the last, of 25 frames each, are in the record.
  EXPECT_GE(delivered.size(), (noted - 1) * 20 * 40);
  EXPECT_LT(delivered.size(), sent.size());
  EXPECT_EQ(delivered, std::vector(sent.begin(),
                                   sent.begin() + static_cast<std::ptrdiff_t>(delivered.size())));
  EXPECT_NE(read_file(sessions.front() / "session.txt")
                .find(fmt::format("imu0 delivered {} on_robot 0 lost 0\n", delivered.size())),
            std::string::npos);
}

}  // namespace
}  // namespace orbbuf::test
