// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_file.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using Lines = std::vector<std::string>;

std::string session(int number) { return fmt::format("20260101T000000Z-{:016x}", number); }

wire::Stats stats_of(std::uint64_t captured, std::uint64_t acknowledged) {
  wire::Stats stats;
  stats.captured = captured;
  stats.acknowledged = acknowledged;
  return stats;
}

class DropFileTest : public ::testing::Test {
 protected:
  fs::path file(int number) const { return drops_ / (session(number) + ".csv"); }

  /// As a session writes it that has ended `age` seconds ago.
  void leave(int number, int age, const std::string& end) const {
    fs::create_directories(drops_);
    test::write_file(file(number), "sequence,reason,capture_time_s\n" + end);
    fs::last_write_time(file(number), fs::file_time_type::clock::now() - std::chrono::seconds(age));
  }

  std::size_t count_files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(drops_), {}));
  }

  const test::TemporaryFolder folder_;
  const fs::path drops_ = folder_ / "state/drops";
  const test::CapturedLog log_;
};

TEST_F(DropFileTest, HoldsEveryRecordAndHowFarTheSessionGot) {
  DropFile drops(drops_, session(1));
  const std::vector<DropRecord> records = {{7, 0, DropReason::kPolicy}};
  drops.note(stats_of(10, 6));
  drops.note(stats_of(10, 6));
  drops.add(records);
  drops.add({});
  drops.note(stats_of(12, 10));
  const Lines expected = {"sequence,reason,capture_time_s", "# captured,10,confirmed,6",
                          "7,policy,0.000000000", "# captured,12,confirmed,11"};
  EXPECT_EQ(test::read_lines(file(1)), expected);
  drops.end(stats_of(12, 11));
  EXPECT_EQ(test::read_lines(file(1)).back(), "# ended,captured,12,confirmed,12");
  EXPECT_TRUE(log_.lines().empty());
}

TEST_F(DropFileTest, ThereIsNoneWithoutAFolder) {
  DropFile none;
  none.add(std::vector<DropRecord>(1));
  none.note(stats_of(1, 0));
  none.end(stats_of(1, 0));
  DropFile({}, session(1)).note(stats_of(1, 0));
  EXPECT_TRUE(fs::is_empty(folder_.path()));
  EXPECT_TRUE(log_.lines().empty());
}

TEST_F(DropFileTest, SessionWithoutAFrameLeavesNone) {
  DropFile drops(drops_, session(1));
  EXPECT_TRUE(fs::exists(file(1)));
  drops.end(stats_of(0, 0));
  EXPECT_FALSE(fs::exists(file(1)));
}

TEST_F(DropFileTest, NextStartSaysWhichSessionDidNotEndAndWhatItLacks) {
  leave(1, 20, "");
  DropFile(drops_, session(2)).note(stats_of(50, 39));
  const std::string before = test::read_file(file(2));
  const DropFile next(drops_, session(3));
  const std::string text = "warning session " + session(2) +
                           " did not end in order; when last counted, 11 frames were captured and "
                           "not confirmed: " +
                           file(2).string();
  EXPECT_EQ(log_.lines("did not end"), (Lines{log_.lines(session(1)).at(0), text}));
  EXPECT_EQ(test::read_file(file(2)), before);
  EXPECT_TRUE(fs::exists(file(1)));
}

TEST_F(DropFileTest, SessionThatEndedIsNotToldNorOlderOnes) {
  leave(1, 20, "# captured,5,confirmed,1\n");
  leave(2, 10, "# captured,5,confirmed,1\n3,shutdown,0.1\n# ended,captured,5,confirmed,5\n");
  const DropFile next(drops_, session(3));
  EXPECT_TRUE(log_.lines().empty());
}

TEST_F(DropFileTest, LineThatWasCutIsNotBelieved) {
  leave(1, 10, "# captured,100,confirmed,90\n# captured,120,confirmed,11");
  const DropFile next(drops_, session(2));
  EXPECT_EQ(log_.lines(" 10 frames were captured and not confirmed").size(), 1U);
}

TEST_F(DropFileTest, SessionThatDiedBeforeItsFirstCountIsToldToo) {
  leave(1, 10, "# captured,,confirmed,1\n# captured,1,confirmed,2\n# captured,9\n");
  const DropFile next(drops_, session(2));
  EXPECT_EQ(log_.lines("an unknown number of frames were captured").size(), 1U);
}

TEST_F(DropFileTest, OldestFilesGoAndNeverTheOwnNorAnotherProgram) {
  const int most = static_cast<int>(DropFile::kMostFiles);
  for (int i = 0; i < most + 3; ++i) leave(i, 1000 - i, "# ended,captured,1,confirmed,1\n");
  for (const char* name : {"mine.csv", "20260101T000000Z-00000000000000AB.csv", "drops-a1b2c3"}) {
    test::write_file(drops_ / name, "");
    fs::last_write_time(drops_ / name, {});
  }
  leave(999, 5000, "");  // as if the clock had been set back: the own file is the oldest
  DropFile own(drops_, session(999));
  EXPECT_EQ(count_files(), DropFile::kMostFiles + 3);
  EXPECT_TRUE(fs::exists(drops_ / "mine.csv"));
  EXPECT_TRUE(fs::exists(file(999)));
  EXPECT_FALSE(fs::exists(file(3)));
  EXPECT_TRUE(fs::exists(file(4)));
}

TEST_F(DropFileTest, FolderThatCannotBeWrittenIsOneWarning) {
  test::write_file(folder_ / "state", "a file");
  DropFile drops(drops_, session(1));
  drops.add(std::vector<DropRecord>(1));
  drops.note(stats_of(1, 0));
  drops.end(stats_of(1, 0));
  EXPECT_EQ(log_.lines(), Lines{"warning cannot write the drop log " + file(1).string() +
                                ": Not a directory; the stream goes on without it"});
}

TEST_F(DropFileTest, FullDeviceIsOneWarning) {
  fs::create_directories(drops_);
  fs::create_symlink("/dev/full", file(1));
  DropFile drops(drops_, session(1));
  drops.add(std::vector<DropRecord>(1));
  drops.note(stats_of(1, 0));
  drops.end(stats_of(1, 0));
  EXPECT_EQ(log_.lines(), Lines{"warning cannot write the drop log " + file(1).string() +
                                ": No space left on device; the stream goes on without it"});
}

}  // namespace
}  // namespace orbbuf
