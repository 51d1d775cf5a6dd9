// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_files.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "server/recording/late_files.hpp"
#include "server/recording/late_merge.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

using test::as_text;
using test::plain_frame;
using test::plain_pair;
using test::read_file;
using test::reduced_frame;

class SessionFilesTest : public testing::Test {
 protected:
  SessionFiles files() const { return {folder_, "Pinhole 1 2 3\n"}; }

  wire::Position recovered() const {
    auto position = files().recover();
    EXPECT_TRUE(position);
    return position ? position.value() : wire::Position{};
  }

  std::vector<std::string> names(const std::filesystem::path& folder) const {
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      found.push_back(entry.path().filename());
    }
    std::sort(found.begin(), found.end());
    return found;
  }

  test::TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_ / "robot" / "session";
};

TEST_F(SessionFilesTest, LaysFramesOutAsDsoReadsThem) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  EXPECT_FALSE(out.write(plain_frame(7)));
  EXPECT_FALSE(out.write(plain_frame(1234567)));
  using Names = std::vector<std::string>;
  EXPECT_EQ(names(folder_),
            (Names{"camera.txt", "checksums.sfv", "end.csv", "images", "times.txt"}));
  EXPECT_EQ(names(folder_ / "images"), (Names{"000000.jpg", "000007.jpg", "1234567.jpg"}));
  EXPECT_EQ(read_file(folder_ / "images/000007.jpg"), as_text(plain_frame(7).jpeg));
  EXPECT_EQ(read_file(folder_ / "times.txt"),
            "0 0.000000000 8.500000\n7 0.280000000 8.500000\n1234567 49382.680000000 8.500000\n");
  EXPECT_EQ(read_file(folder_ / "camera.txt"), "Pinhole 1 2 3\n");
}

TEST_F(SessionFilesTest, IsOpenFromTheFirstWriteUntilItIsFinished) {
  const auto end = [&] { return closing_from_csv(read_file(folder_ / "end.csv")); };
  SessionClosing ended{true, wire::Stats{1, 0, 0, 0, 1, 0, 0}};
  auto out = files();
  EXPECT_FALSE(out.finish(ended));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "end.csv"));
  EXPECT_FALSE(out.write(plain_frame(0)));
  EXPECT_EQ(end(), SessionClosing{});
  EXPECT_FALSE(out.finish(ended));
  EXPECT_EQ(end(), ended);
  auto again = files();
  EXPECT_FALSE(again.write(plain_frame(1)));
  EXPECT_EQ(end(), SessionClosing{});
}

TEST_F(SessionFilesTest, KeepsTheLastStatsWhenTheServerDiesAndWhenTheSessionGoesOn) {
  const auto end = [&] { return closing_from_csv(read_file(folder_ / "end.csv")); };
  const wire::Stats stats{500, 0, 0, 3, 440, 0, 0};
  auto killed = files();
  killed.note({false, wire::Stats{1, 0, 0, 0, 0, 0, 0}});
  EXPECT_FALSE(std::filesystem::exists(folder_ / "end.csv"));
  EXPECT_FALSE(killed.write(plain_frame(0)));
  EXPECT_EQ(end()->stats->captured, 1U);
  const SessionClosing reported{false, stats, 3'600'000'000'000};
  killed.note(reported);
  EXPECT_EQ(end(), reported);

  auto again = files();
  EXPECT_TRUE(again.recover());
  EXPECT_FALSE(again.write(plain_frame(1)));
  EXPECT_EQ(end(), reported);
  SessionClosing closing;
  EXPECT_FALSE(again.finish(closing));
  EXPECT_EQ(closing, reported);
  EXPECT_EQ(end(), reported);
}

TEST_F(SessionFilesTest, RightImagesOfStereoFramesHaveTheirOwnFolder) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_pair(0, 10, 20)));
  EXPECT_FALSE(out.write(plain_pair(7, 30, 40)));
  using Names = std::vector<std::string>;
  EXPECT_EQ(names(folder_), (Names{"camera.txt", "checksums.sfv", "end.csv", "images",
                                   "images_right", "times.txt"}));
  EXPECT_EQ(names(folder_ / "images"), (Names{"000000.jpg", "000007.jpg"}));
  EXPECT_EQ(names(folder_ / "images_right"), names(folder_ / "images"));
  EXPECT_EQ(read_file(folder_ / "images/000007.jpg"), as_text(plain_pair(7, 30, 40).left()));
  EXPECT_EQ(read_file(folder_ / "images_right/000007.jpg"), as_text(plain_pair(7, 30, 40).right()));
}

TEST_F(SessionFilesTest, EachImageHasAChecksum) {
  auto out = files();
  auto pair = plain_pair(0, 9, 9);
  const std::string left = "123456789";  // whose CRC-32 is CBF43926 by definition
  std::copy(left.begin(), left.end(), pair.jpeg.begin());
  std::fill(pair.jpeg.begin() + 9, pair.jpeg.end(), '\0');
  EXPECT_FALSE(out.write(pair));
  const auto mono = plain_frame(7);
  EXPECT_FALSE(out.write(mono));
  char crc[9];
  std::snprintf(crc, sizeof crc, "%08X", static_cast<unsigned>(mono.jpeg_crc));
  EXPECT_EQ(read_file(folder_ / "checksums.sfv"),
            std::string("images/000000.jpg CBF43926\nimages_right/000000.jpg E60914AE\n") +
                "images/000007.jpg " + crc + "\n");
}

TEST_F(SessionFilesTest, EachFrameHasItsQualityAndWhatItWasReducedFrom) {
  auto out = files();
  auto whole = plain_frame(1);
  whole.quality = 80;
  EXPECT_FALSE(out.write(plain_frame(0)));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "quality.csv"));
  EXPECT_FALSE(out.write(whole));
  EXPECT_FALSE(out.write(reduced_frame(2)));
  EXPECT_EQ(read_file(folder_ / "quality.csv"),
            "sequence,quality,whole_bytes,whole_crc\n1,80,0,00000000\n2,30,40123,0A1B2C3D\n");
}

TEST_F(SessionFilesTest, ATornQualityIsCutOff) {
  EXPECT_FALSE(files().write(reduced_frame(0)));
  const std::string qualities = read_file(folder_ / "quality.csv");
  test::write_file(folder_ / "quality.csv", qualities + "1,30,401");
  EXPECT_EQ(recovered(), (wire::Position{1, 0}));
  EXPECT_EQ(read_file(folder_ / "quality.csv"), qualities);
}

TEST_F(SessionFilesTest, AFrameWhoseQualityCannotBeWrittenIsNotAccepted) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  std::filesystem::create_directory(folder_ / "quality.csv");
  EXPECT_TRUE(out.write(reduced_frame(1)));
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 1U);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "images/000001.jpg"));
  std::filesystem::remove(folder_ / "quality.csv");
  EXPECT_FALSE(out.write(reduced_frame(1)));
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 2U);
}

TEST_F(SessionFilesTest, NothingIsMadeBeforeTheFirstWrite) {
  EXPECT_EQ(recovered(), wire::Position{});
  EXPECT_FALSE(std::filesystem::exists(folder_));
}

TEST_F(SessionFilesTest, DropRecordsAreCsv) {
  auto out = files();
  EXPECT_FALSE(out.write_drops({0, {{4, 160'000'000, DropReason::kPolicy}}}));
  EXPECT_FALSE(out.write_drops({1, {{6, -1, DropReason::kBusy}}}));
  EXPECT_EQ(read_file(folder_ / "drops.csv"),
            "sequence,reason,capture_time_s\n4,policy,0.160000000\n6,busy,-0.000000001\n");
  EXPECT_EQ(recovered(), (wire::Position{0, 2}));
}

TEST_F(SessionFilesTest, ResumesBehindTheLastAcceptedFrame) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(3)));
  EXPECT_FALSE(out.write(plain_frame(9)));
  EXPECT_EQ(recovered(), (wire::Position{10, 0}));
  auto again = files();
  EXPECT_TRUE(again.recover());
  EXPECT_FALSE(again.write(plain_frame(10)));
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 3U);
}

TEST_F(SessionFilesTest, WhatWasInTheMiddleOfBeingWrittenBecomesAnOrphan) {
  const test::CapturedLog log;
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  EXPECT_FALSE(out.write_drops({0, {{1, 0, DropReason::kPolicy}}}));
  const std::string times = read_file(folder_ / "times.txt");
  const std::string drops = read_file(folder_ / "drops.csv");
  test::write_file(folder_ / "times.txt", times + "2 0.0800");
  test::write_file(folder_ / "drops.csv", drops + "3,pol");
  const std::string checksums = read_file(folder_ / "checksums.sfv");
  test::write_file(folder_ / "checksums.sfv", checksums + "images/000002.jpg 12");
  test::write_file(folder_ / "images/000002.jpg", "whole, but not accepted");
  test::write_file(folder_ / "images/notes.txt", "somebody's");
  test::write_file(folder_ / "incoming.tmp", "torn");

  EXPECT_EQ(recovered(), (wire::Position{1, 1}));
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_EQ(read_file(folder_ / "drops.csv"), drops);
  EXPECT_EQ(read_file(folder_ / "checksums.sfv"), checksums);
  EXPECT_EQ(names(folder_ / "images"), (std::vector<std::string>{"000000.jpg", "notes.txt"}));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "incoming.tmp"));
  EXPECT_EQ(read_file(folder_ / "orphans/incoming.tmp"), "torn");
  EXPECT_EQ(read_file(folder_ / "orphans/images/000002.jpg"), "whole, but not accepted");
  EXPECT_EQ(log.lines("moved 1 images without a line").size(), 1U);
}

TEST_F(SessionFilesTest, BothImagesOfAPairWithoutALineBecomeOrphans) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_pair(0, 10, 10)));
  for (const char* image : {"images/000001.jpg", "images_right/000001.jpg"}) {
    test::write_file(folder_ / image, "whole, but not accepted");
  }
  EXPECT_EQ(recovered(), (wire::Position{1, 0}));
  EXPECT_EQ(names(folder_ / "images"), std::vector<std::string>{"000000.jpg"});
  EXPECT_EQ(names(folder_ / "images_right"), std::vector<std::string>{"000000.jpg"});
}

TEST_F(SessionFilesTest, LinesWithoutWholeImagesAreAskedForAgain) {
  const test::CapturedLog log;
  auto out = files();
  for (Sequence i = 0; i < 6; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  const std::string times = read_file(folder_ / "times.txt");
  test::write_file(folder_ / "images/000003.jpg", "");
  std::filesystem::remove(folder_ / "images/000005.jpg");
  EXPECT_EQ(recovered(), (wire::Position{3, 0}));
  const auto kept = test::read_lines(folder_ / "times.txt").size();
  EXPECT_EQ(kept, 3U);
  EXPECT_EQ(read_file(folder_ / "times.txt") + read_file(folder_ / "orphans/times.txt"), times);
  EXPECT_EQ(names(folder_ / "images").size(), 3U);
  EXPECT_EQ(read_file(folder_ / "orphans/images/000004.jpg"), as_text(plain_frame(4).jpeg));
  EXPECT_EQ(log.lines("3 frames at the end of times.txt are not whole").size(), 1U);
  EXPECT_EQ(recovered(), (wire::Position{3, 0}));  // and that was all
}

TEST_F(SessionFilesTest, AnImageWithOtherBytesIsNotWhole) {
  auto out = files();
  for (Sequence i = 0; i < 2; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  test::write_file(folder_ / "images/000001.jpg", std::string(plain_frame(1).jpeg.size(), '\0'));
  EXPECT_EQ(recovered(), (wire::Position{1, 0}));
}

TEST_F(SessionFilesTest, BothImagesOfAPairMustBeWhole) {
  auto out = files();
  for (Sequence i = 0; i < 2; ++i) EXPECT_FALSE(out.write(plain_pair(i, 10, 10)));
  std::filesystem::resize_file(folder_ / "images_right/000001.jpg", 4);
  EXPECT_EQ(recovered(), (wire::Position{1, 0}));
}

TEST_F(SessionFilesTest, AFrameWhoseChecksumIsLostIsAskedForAgain) {
  auto out = files();
  for (Sequence i = 0; i < 2; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  const auto checksums = read_file(folder_ / "checksums.sfv");
  test::write_file(folder_ / "checksums.sfv", checksums.substr(0, checksums.find('\n') + 1));
  EXPECT_EQ(recovered(), (wire::Position{1, 0}));
}

TEST_F(SessionFilesTest, ASessionWithoutChecksumsIsBelieved) {
  auto out = files();
  for (Sequence i = 0; i < 2; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  std::filesystem::remove(folder_ / "checksums.sfv");
  EXPECT_EQ(recovered(), (wire::Position{2, 0}));
}

TEST_F(SessionFilesTest, LateFramesAreNotItsOwn) {
  const test::CapturedLog log;
  auto out = files();
  for (const Sequence i : {0U, 1U, 5U}) EXPECT_FALSE(out.write(plain_frame(i)));
  LateFiles late(folder_);
  for (const Sequence i : {9U, 3U}) ASSERT_TRUE(late.write(plain_frame(i), 0));
  EXPECT_EQ(recovered(), (wire::Position{6, 0}));
  std::filesystem::rename(folder_ / "late/images/000009.jpg", folder_ / "images/000009.jpg");
  EXPECT_EQ(recovered(), (wire::Position{6, 0}));
  EXPECT_EQ(read_file(folder_ / "images/000009.jpg"), as_text(plain_frame(9).jpeg));
  ASSERT_TRUE(merge_late(folder_));
  EXPECT_EQ(recovered(), (wire::Position{6, 0}));
  EXPECT_EQ(names(folder_ / "images").size(), 5U);
  EXPECT_TRUE(log.lines("session").empty());
}

TEST_F(SessionFilesTest, AmongLateFramesTheLastOfTheLiveStreamIsFound) {
  LateFiles late(folder_);
  for (const Sequence i : {4U, 5U, 6U, 9U}) ASSERT_TRUE(late.write(plain_frame(i), 0));
  ASSERT_TRUE(merge_late(folder_));
  EXPECT_EQ(recovered(), wire::Position{});
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(7)));
  test::write_file(folder_ / "times.txt",
                   "4 0.160000000 0\n5 0.200000000 0\n6 0.240000000 0\n"
                   "7 0.280000000 0\n9 0.360000000 0\n");
  EXPECT_EQ(recovered(), (wire::Position{8, 0}));
}

TEST_F(SessionFilesTest, AllImagesGoneIsAnEmptyRecord) {
  auto out = files();
  for (Sequence i = 0; i < 2; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  std::filesystem::remove_all(folder_ / "images");
  EXPECT_EQ(recovered(), wire::Position{});
}

TEST_F(SessionFilesTest, AnOrphanTakesNoOthersPlace) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  for (const char* content : {"first", "second"}) {
    test::write_file(folder_ / "images/000001.jpg", content);
    EXPECT_EQ(recovered(), (wire::Position{1, 0}));
  }
  EXPECT_EQ(read_file(folder_ / "orphans/images/000001.jpg"), "first");
  EXPECT_EQ(read_file(folder_ / "orphans/images/000001.jpg.1"), "second");
}

TEST_F(SessionFilesTest, ZerosInAListAreItsEnd) {
  auto out = files();
  for (Sequence i = 0; i < 2; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  const auto times = read_file(folder_ / "times.txt");
  test::write_file(folder_ / "times.txt", times + std::string(100, '\0') + "7 1.000000000 0.0\n");
  EXPECT_EQ(recovered(), (wire::Position{2, 0}));
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
}

TEST_F(SessionFilesTest, ATornHeaderOfDropsIsNoRecord) {
  std::filesystem::create_directories(folder_);
  test::write_file(folder_ / "drops.csv", "sequence,rea");
  EXPECT_EQ(recovered(), wire::Position{});
  auto out = files();
  EXPECT_FALSE(out.write_drops({0, {{1, 0, DropReason::kFailed}}}));
  EXPECT_EQ(read_file(folder_ / "drops.csv"),
            "sequence,reason,capture_time_s\n1,failed,0.000000000\n");
}

TEST_F(SessionFilesTest, AForeignLastLineIsAnErrorAndCostsNoImage) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  test::write_file(folder_ / "times.txt", "# my notes\n");
  const auto position = files().recover();
  ASSERT_FALSE(position);
  EXPECT_NE(position.error().text.find("# my notes"), std::string::npos);
  EXPECT_EQ(names(folder_ / "images").size(), 1U);
}

TEST_F(SessionFilesTest, OnAFullDiskNothingOfTheFrameRemains) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 1000);
    EXPECT_TRUE(out.write(plain_frame(1, 5000)));
    EXPECT_EQ(names(folder_ / "images").size(), 1U);
    EXPECT_FALSE(std::filesystem::exists(folder_ / "incoming.tmp"));
  }
  EXPECT_FALSE(out.write(plain_frame(1, 5000)));
  EXPECT_EQ(recovered(), (wire::Position{2, 0}));
}

TEST_F(SessionFilesTest, WhenTheRightImageDoesNotFitTheLeftOneGoesToo) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_pair(0, 10, 10)));
  const std::string times = read_file(folder_ / "times.txt");
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 1000);
    EXPECT_TRUE(out.write(plain_pair(1, 900, 5000)));
  }
  EXPECT_EQ(names(folder_ / "images").size(), 1U);
  EXPECT_EQ(names(folder_ / "images_right").size(), 1U);
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_FALSE(out.write(plain_pair(1, 900, 5000)));
  EXPECT_EQ(recovered(), (wire::Position{2, 0}));
}

TEST_F(SessionFilesTest, WhenTheLineDoesNotFitTheImagesGoToo) {
  auto out = files();
  for (Sequence sequence = 0; sequence < 5; ++sequence) {
    EXPECT_FALSE(out.write(plain_pair(sequence, 10, 10)));
  }
  std::filesystem::remove(folder_ / "checksums.sfv");  // of all lines the longest
  const std::string times = read_file(folder_ / "times.txt");
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, times.size() + 5);
    const auto error = out.write(plain_pair(5, 10, 10));
    ASSERT_TRUE(error);
    EXPECT_NE(error->text.find("times.txt: File too large"), std::string::npos);
  }
  EXPECT_EQ(names(folder_ / "images").size(), 5U);
  EXPECT_EQ(names(folder_ / "images_right").size(), 5U);
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_FALSE(out.write(plain_pair(5, 10, 10)));
  EXPECT_EQ(recovered(), (wire::Position{6, 0}));
}

TEST_F(SessionFilesTest, AFolderThatSomebodyRemovedComesBackWithTheNextTry) {
  auto out = files();
  EXPECT_FALSE(out.write(plain_frame(0)));
  std::filesystem::remove_all(folder_);
  EXPECT_TRUE(out.write(plain_frame(1)));
  EXPECT_FALSE(out.write(plain_frame(1)));
  EXPECT_EQ(names(folder_ / "images"), std::vector<std::string>{"000001.jpg"});
}

}  // namespace
}  // namespace orbbuf
