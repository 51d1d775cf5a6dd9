// SPDX-License-Identifier: Apache-2.0
// A link with a rate, between two network namespaces: what the robot sends smaller, and that the
// server's account of it is true.
#include <fmt/core.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "testing/namespaces.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

/// A line of quality.csv.
struct Quality {
  std::uint64_t sequence = 0;
  int quality = 0;
  std::uint64_t whole_bytes = 0;
};

std::vector<Quality> read_qualities(const fs::path& session) {
  std::istringstream lines(read_file(session / "quality.csv"));
  std::vector<Quality> qualities;
  std::string line;
  std::getline(lines, line);  // the header
  while (std::getline(lines, line)) {
    std::istringstream fields(line);
    Quality& one = qualities.emplace_back();
    char comma = 0;
    fields >> one.sequence >> comma >> one.quality >> comma >> one.whole_bytes;
    EXPECT_TRUE(fields) << line;
  }
  return qualities;
}

class QualityTest : public ::testing::Test {
 protected:
  /// Frames of 640x480, 40 kB on average, 25 a second: 8 Mbit/s.
  void start(const std::string& rate) {
    hosts_.shape_link(rate);
    server_.emplace(folder_ / "out", Overrides{"listen.insecure=true"}, Namespaces::kServerListen,
                    hosts_.on_server());
    robot_.emplace(robot_command("r", server_->address(),
                                 {"source.kind=generated", "source.frames=1000000",
                                  "buffer.policy=catch-up", "jpeg.least_quality=20"},
                                 hosts_.on_robot()));
    ASSERT_TRUE(robot_->wait_for_line("connected to")) << robot_->output();
  }
  bool wait_for_reports(int count) {
    const std::string report = "] captured ";
    return robot_->wait_for_lines(report, robot_->count_lines(report) + count);
  }
  void stop() {
    robot_->signal(SIGTERM);
    ASSERT_EQ(robot_->wait(), 0) << robot_->output();
    record_ = read_record(folder_ / "out", "r");
    expect_exactly_once(record_, closing_stats(*robot_).at("captured"));
    qualities_ = read_qualities(record_.folder);
  }
  std::size_t reduced() const {
    return static_cast<std::size_t>(
        std::ranges::count_if(qualities_, [](const Quality& one) { return one.whole_bytes > 0; }));
  }

  const Namespaces hosts_;
  const TemporaryFolder folder_;
  std::optional<Server> server_;
  std::optional<Process> robot_;
  Record record_;
  std::vector<Quality> qualities_;
};

TEST_F(QualityTest, AfterAnOutageFramesAreSentSmallerBeforeAnyIsPassedOver) {
  if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
  start("12mbit");
  ASSERT_TRUE(wait_for_reports(3));
  hosts_.cut_link();
  ASSERT_TRUE(robot_->wait_for_line("stalled, nothing acknowledged")) << robot_->output();
  ASSERT_TRUE(wait_for_reports(1));
  hosts_.mend_link();
  ASSERT_TRUE(wait_for_reports(4));
  stop();
  EXPECT_GT(reduced(), 0U);
  for (const Quality& one : qualities_) {
    // A slow machine may take the link for a slower one, for which frames are encoded at less.
    EXPECT_TRUE(one.whole_bytes == 0 || one.quality < 80) << one.sequence;
    EXPECT_GE(one.quality, 20) << one.sequence;
    const auto image = record_.folder / "images" / fmt::format("{:06}.jpg", one.sequence);
    if (one.whole_bytes > 0) {
      EXPECT_LT(fs::file_size(image), one.whole_bytes) << image;
    }
  }
}

TEST_F(QualityTest, ForALinkThatIsTooSlowForGoodFramesAreEncodedAtWhatItCarries) {
  if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
  start("3mbit");
  ASSERT_TRUE(wait_for_reports(10));
  stop();
  const Quality& last = qualities_.back();
  EXPECT_LT(last.quality, 60);
  EXPECT_GT(
      std::ranges::count_if(
          qualities_, [](const Quality& one) { return one.whole_bytes == 0 && one.quality < 60; }),
      25);
}

}  // namespace
}  // namespace orbbuf::test
