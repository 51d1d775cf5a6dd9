// SPDX-License-Identifier: Apache-2.0
// Input that is wrong costs itself, and nothing else: damaged images, a full disk.
#include <gtest/gtest.h>
#include <sys/mount.h>

#include <csignal>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

/// Makes a folder of small JPEGs by letting the programs record one.
fs::path record_scene(const TemporaryFolder& folder, int frames) {
  Server server(folder / "recorded");
  const Finished robot =
      run(robot_command("r", server.address(),
                        {"source.frames=" + std::to_string(frames), "source.realtime=false",
                         "source.width=160", "source.height=120"}));
  EXPECT_EQ(robot.status, 0) << robot.output;
  return read_record(folder / "recorded", "r").folder / "images";
}

TEST(BadInput, TruncatedImageIsNamedAndTheRestArrives) {
  const TemporaryFolder folder;
  const fs::path images = record_scene(folder, 5);
  fs::resize_file(images / "000002.jpg", fs::file_size(images / "000002.jpg") / 2);
  write_file(images / "000003.jpg", "");
  Server server(folder / "out");
  Process robot(robot_command("r", server.address(), replay(images)));
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  const Record record = read_record(folder / "out", "r");
  expect_exactly_once(record, 5);
  EXPECT_EQ(record.dropped, (std::map<std::uint64_t, std::string>{{2, "failed"}, {3, "failed"}}));
  EXPECT_EQ(robot.count_lines("frame 2: "), 1) << robot.output();
  EXPECT_EQ(closing_stats(robot).at("failed"), 2U);
}

/// A file system of its own with very little room.
class SmallDisk {
 public:
  explicit SmallDisk(const fs::path& where) : where_(where) {
    fs::create_directories(where);
    is_mounted_ = ::mount("tmpfs", where.c_str(), "tmpfs", 0, "size=512k") == 0;
  }
  ~SmallDisk() {
    if (is_mounted_) ::umount(where_.c_str());
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  bool is_mounted() const { return is_mounted_; }

 private:
  fs::path where_;
  bool is_mounted_ = false;
};

TEST(BadInput, FullDiskHoldsTheStreamUntilThereIsRoom) {
  const TemporaryFolder folder;
  const SmallDisk disk(folder / "disk");
  if (!disk.is_mounted()) GTEST_SKIP() << "cannot mount a small file system (not root?)";
  write_file(folder / "disk/filler", std::string(400 * 1024, 'x'));
  Server server(folder / "disk/out");
  Process robot(robot_command(
      "r", server.address(),
      {"source.frames=40", "source.realtime=false", "source.width=160", "source.height=120"}));
  ASSERT_TRUE(server.process().wait_for_line("No space left on device"));
  ASSERT_TRUE(robot.wait_for_line("takes nothing at the moment: "));
  fs::remove(folder / "disk/filler");
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  EXPECT_EQ(server.process().count_lines("No space left on device"), 1)
      << server.process().output();
  EXPECT_EQ(robot.count_lines("No space left on device"), 1) << robot.output();
  const Record record = read_record(folder / "disk/out", "r");
  expect_exactly_once(record, 40);
  EXPECT_EQ(record.delivered.size(), 40U);
}

TEST(BadInput, FullDiskOfOneRobotLeavesTheProcessAnswering) {
  const TemporaryFolder folder;
  const SmallDisk disk(folder / "disk");
  if (!disk.is_mounted()) GTEST_SKIP() << "cannot mount a small file system (not root?)";
  Server server(folder / "disk/out");
  Process robot(
      robot_command("r", server.address(), {"source.frames=1000", "source.realtime=false"}));
  ASSERT_TRUE(server.process().wait_for_line("No space left on device"));
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(), 0) << "a stop must not wait for room on the disk";
}

}  // namespace
}  // namespace orbbuf::test
