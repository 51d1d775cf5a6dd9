// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/check_session.hpp"

#include <gmock/gmock.h>

#include <filesystem>

#include "server/recording/late_files.hpp"
#include "server/recording/late_merge.hpp"
#include "tests/server/dataset/recording.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::read_file;
using test::write_file;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

class CheckSession : public test::Recording {
 protected:
  std::vector<std::string> problems() const {
    const auto report = check_session(session_);
    EXPECT_TRUE(report);
    return report ? report.value().problems : std::vector<std::string>{"an error"};
  }
  void add_late(const std::vector<Sequence>& numbers, bool is_stereo = false) const {
    LateFiles late(session_);
    for (const Sequence number : numbers) {
      auto frame = test::jpeg_frame_ptr(number, kWidth, kHeight);
      if (is_stereo) {
        frame = test::stereo_frame_ptr(frame, test::jpeg_frame_ptr(number + 50, kWidth, kHeight));
      }
      ASSERT_TRUE(late.write(*frame, 0));
    }
  }
  void append(const char* file, const std::string& text) const {
    write_file(session_ / file, read_file(session_ / file) + text);
  }
  void replace(const char* file, const std::string& from, const std::string& to) const {
    std::string text = read_file(session_ / file);
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    write_file(session_ / file, text.replace(at, from.size(), to));
  }
  void flip_a_byte(const char* file, std::size_t at) const {
    std::string bytes = read_file(session_ / file);
    ASSERT_LT(at, bytes.size());
    bytes[at] = static_cast<char>(bytes[at] ^ 4);
    write_file(session_ / file, bytes);
  }
};

TEST_F(CheckSession, FindsNothingInASoundOne) {
  record(false, "FOV 0.5 0.7 0.5 0.5 0.9\n64 48\ncrop\n64 48\n");
  const auto report = check_session(session_);
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().problems, IsEmpty());
  EXPECT_EQ(report.value().frames, 7U);
  EXPECT_EQ(report.value().dropped, 3U);
  EXPECT_THAT(summary(report.value()), StartsWith("OK: 7 frames, 3 dropped, 0.0 MiB"));
}

TEST_F(CheckSession, SaysHowManyFramesAreReduced) {
  record();
  EXPECT_THAT(check_session(session_).value().notes, IsEmpty());
  append("quality.csv",
         "sequence,quality,whole_bytes,whole_crc\n"
         "0,80,0,00000000\n1,30,4000,0A1B2C3D\n2,30,4000,0A1B2C3D\n2,80,0,00000000\n"
         "99,30,4000,0A1B2C3D\n");  // frame 2 was sent again, whole; frame 99 was not accepted
  const auto report = check_session(session_);
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().problems, IsEmpty());
  EXPECT_THAT(report.value().notes, ElementsAre("1 of 7 frames were sent with a reduced JPEG"));
}

TEST_F(CheckSession, FindsAQualityThatCannotBeRead) {
  record();
  append("quality.csv", "sequence,quality,whole_bytes,whole_crc\n0,101,0,00000000\n1,30");
  EXPECT_THAT(problems(), ElementsAre("quality.csv:2: cannot be read, \"0,101,0,00000000\"",
                                      "quality.csv:3: torn, \"1,30\""));
}

TEST_F(CheckSession, FindsNothingInASoundPair) {
  record(true);
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, FindsNothingInOneOfWhichAllWasDropped) {
  SessionFiles files(session_, "");
  ASSERT_FALSE(files.write_drops({0, {{0, 0, DropReason::kShutdown}}}));
  ASSERT_FALSE(finish(files, {true, wire::Stats{1, 0, 0, 1, 0, 0, 0}}));
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, SaysThatASessionHasNotEnded) {
  record();
  SessionFiles files(session_, "");
  ASSERT_TRUE(files.recover());
  ASSERT_FALSE(files.write(*test::jpeg_frame_ptr(10, kWidth, kHeight)));
  EXPECT_THAT(problems(), ElementsAre("not ended: it is not known how many frames are missing at "
                                      "the end"));
  ASSERT_FALSE(finish(files, {false, wire::Stats{25, 1, 1, 1, 8, 14, 0}}));
  EXPECT_THAT(problems(), ElementsAre("not ended: up to 14 frames unaccounted for at the "
                                      "robot's last report"));
}

TEST_F(CheckSession, NamesTheFramesAtTheEndThatNeverCame) {
  record();
  replace("end.csv", "ended,10,", "ended,12,");
  EXPECT_THAT(problems(), ElementsAre("frames 10 to 11 were neither delivered nor dropped"));
}

TEST_F(CheckSession, ASessionOfAnOlderServerHasNoEnd) {
  record();
  fs::remove(session_ / "end.csv");
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, AnEndThatCannotBeReadIsAProblem) {
  record();
  write_file(session_ / "end.csv", "ended\n");
  EXPECT_THAT(problems(), ElementsAre("end.csv: cannot be read"));
}

TEST_F(CheckSession, LateFramesAreSoundBeforeAndAfterTheMerge) {
  for (const bool is_stereo : {false, true}) {
    fs::remove_all(session_);
    record(is_stereo);
    add_late({3, 7}, is_stereo);
    const auto check = [&] {
      const auto report = check_session(session_);
      ASSERT_TRUE(report);
      EXPECT_THAT(report.value().problems, IsEmpty());
      EXPECT_THAT(summary(report.value()),
                  StartsWith("OK: 10 captured: 7 live, 2 late, 0 on the robot, 1 lost; 0.0 MiB"));
      EXPECT_EQ(report.value().dropped, 1U);
    };
    check();
    ASSERT_TRUE(merge_late(session_));
    check();
    EXPECT_EQ(test::read_lines(session_ / "times.txt").size(), 9U);
  }
}

TEST_F(CheckSession, ASessionOfLateFramesOnlyIsASession) {
  add_late({1, 0});
  EXPECT_THAT(problems(), IsEmpty());
  ASSERT_TRUE(merge_late(session_));
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, LateFramesMayBeNamedAfterTheyWereMerged) {
  record();
  replace("drops.csv", "7,failed,0.280000000\n", "");
  add_late({7});
  ASSERT_TRUE(merge_late(session_));
  append("drops.csv", "7,failed,0.280000000\n");
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, NamesALateImageThatIsGoneOrNotAsItCame) {
  record();
  add_late({3, 4, 7});
  fs::remove(session_ / "late/images/000003.jpg");
  flip_a_byte("late/images/000004.jpg", 100);
  EXPECT_THAT(problems(),
              ElementsAre("late/images/000003.jpg: missing",
                          "late/images/000004.jpg: not as it was received, by its checksum"));
}

TEST_F(CheckSession, NamesALateImageThatBrokeAfterTheMerge) {
  record();
  add_late({3, 4});
  ASSERT_TRUE(merge_late(session_));
  flip_a_byte("images/000003.jpg", 100);
  EXPECT_THAT(problems(),
              ElementsAre("images/000003.jpg: not as it was received, by its checksum"));
}

TEST_F(CheckSession, NamesALateFrameThatIsGone) {
  record();
  replace("drops.csv", "3,busy", "3,late");
  EXPECT_THAT(problems(), ElementsAre("drops.csv: frame 3 came late, and is gone"));
}

TEST_F(CheckSession, CountsWhatTheRobotStillHas) {
  record();
  using Counts = std::pair<std::size_t, std::size_t>;
  const auto check = [&](const RobotHolds& holds) {
    EXPECT_FALSE(LateFiles(session_).note(holds));
    const auto report = check_session(session_);
    return report ? Counts(report.value().on_robot, report.value().lost) : Counts(99, 99);
  };
  EXPECT_EQ(check({0, 0, 0}), Counts(0, 3));
  EXPECT_EQ(check({2, 4, 0}), Counts(2, 1));
  EXPECT_EQ(check({1, 4, 0}), Counts(1, 2));
  EXPECT_EQ(check({1, 3, 0}), Counts(1, 2));
  EXPECT_EQ(check({3, 3, 0}), Counts(3, 0));
  EXPECT_EQ(check({5, 3, 0}), Counts(5, 0));   // two that no list knows
  EXPECT_EQ(check({5, 12, 0}), Counts(5, 3));  // no list knows any
  EXPECT_EQ(check({0, 0, 0}), Counts(0, 3));
}

TEST_F(CheckSession, WhatNoListNamesMayBeOnTheRobot) {
  record();
  replace("drops.csv", "4,policy,0.160000000\n3,busy,0.120000000\n", "");
  replace("end.csv", "ended,10,", "ended,12,");
  ASSERT_FALSE(LateFiles(session_).note({2, 4, 0}));
  EXPECT_THAT(problems(), ElementsAre("frame 3 was neither delivered nor dropped",
                                      "frame 4 is still on the robot, or lost",
                                      "frames 10 to 11 are still on the robot, or lost"));
}

TEST_F(CheckSession, ACountOfTheRobotsThatCannotBeReadIsAProblem) {
  record();
  write_file(session_ / "spool.csv", "many\n");
  EXPECT_THAT(problems(), ElementsAre("spool.csv: cannot be read"));
}

TEST_F(CheckSession, NamesAMissingImageOfEitherSide) {
  record(true);
  fs::remove(session_ / "images/000005.jpg");
  fs::remove(session_ / "images_right/000008.jpg");
  EXPECT_THAT(problems(),
              ElementsAre("images/000005.jpg: missing", "images_right/000008.jpg: missing"));
}

TEST_F(CheckSession, NamesAnImageThatIsCutShort) {
  record();
  const fs::path image = session_ / "images/000005.jpg";
  fs::resize_file(image, fs::file_size(image) - 10);
  fs::resize_file(session_ / "images/000006.jpg", 0);
  EXPECT_THAT(problems(),
              ElementsAre(StartsWith("images/000005.jpg: "), StartsWith("images/000006.jpg: ")));
}

TEST_F(CheckSession, NamesAnImageWithAFlippedByteWhereverItIs) {
  record(true);
  const auto bytes = fs::file_size(session_ / "images/000005.jpg");
  flip_a_byte("images/000005.jpg", 0);
  flip_a_byte("images/000006.jpg", bytes / 2);
  flip_a_byte("images_right/000006.jpg", bytes - 1);
  EXPECT_THAT(problems(),
              ElementsAre("images/000005.jpg: not as it was received, by its checksum",
                          "images/000006.jpg: not as it was received, by its checksum",
                          "images_right/000006.jpg: not as it was received, by its checksum"));
}

TEST_F(CheckSession, WithoutChecksumsTheJpegsAreDecoded) {
  record();
  fs::remove(session_ / "checksums.sfv");
  EXPECT_THAT(problems(), IsEmpty());
  const fs::path image = session_ / "images/000005.jpg";
  const std::string bytes = read_file(image);
  write_file(image, bytes.substr(0, bytes.size() / 2) + "\xFF\xD9");
  EXPECT_THAT(problems(), ElementsAre(StartsWith("images/000005.jpg: cannot decode a JPEG")));
}

TEST_F(CheckSession, NamesAnImageThatWasNoJpegWhenItCame) {
  record();
  SessionFiles files(session_, "");
  ASSERT_FALSE(files.write(test::plain_frame(10)));
  ASSERT_FALSE(finish(files, {true, {}}));
  EXPECT_THAT(problems(), ElementsAre(StartsWith("images/000010.jpg: cannot read the header")));
}

TEST_F(CheckSession, NamesAnImageWithoutAChecksum) {
  record();
  const std::string first = read_file(session_ / "checksums.sfv").substr(0, 27);
  replace("checksums.sfv", first, "");
  append("checksums.sfv", "images/000010.jpg 123\nimages/000011.jpg 1234");
  EXPECT_THAT(problems(), ElementsAre("checksums.sfv:7: cannot be read, \"images/000010.jpg 123\"",
                                      "checksums.sfv:8: torn, \"images/000011.jpg 1234\"",
                                      "images/000000.jpg: without a checksum"));
}

TEST_F(CheckSession, OfTwoChecksumsTheLastCounts) {
  record();
  write_file(session_ / "checksums.sfv",
             "images/000005.jpg 00000000\nimages/000077.jpg 00000000\n" +
                 read_file(session_ / "checksums.sfv"));
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, TheEndOfTimesIsMissedByTheChecksums) {
  record();
  append("checksums.sfv", "images/000010.jpg 00000000\n");
  EXPECT_THAT(problems(), IsEmpty()) << "the frame that was just under way";
  append("checksums.sfv", "images/000011.jpg 00000000\n");
  EXPECT_THAT(problems(),
              ElementsAre("frames 10 to 11 have their checksums, but no line in times.txt"));
}

TEST_F(CheckSession, NamesAStrayAmongTheImagesOfEitherSide) {
  record(true);
  write_file(session_ / "images/000004.jpg", read_file(session_ / "images/000005.jpg"));
  write_file(session_ / "images_right/notes.txt", "mine");
  EXPECT_THAT(problems(), ElementsAre("images/000004.jpg: without a line in times.txt",
                                      "images_right/notes.txt: without a line in times.txt"));
}

TEST_F(CheckSession, FilesBesideTheImagesAreSomebodysOwn) {
  record();
  write_file(session_ / "trajectory.txt", "mine");
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, NamesATornLine) {
  record();
  append("times.txt", "10 0.4000");
  append("drops.csv", "11,pol");
  EXPECT_THAT(problems(),
              ElementsAre("times.txt:8: torn, \"10 0.4000\"", "drops.csv:5: torn, \"11,pol\""));
}

TEST_F(CheckSession, NamesALineThatIsNoneOfOurs) {
  record();
  append("times.txt", "# \x1b[2Jnotes\n");
  replace("drops.csv", "busy", "lazy");
  EXPECT_THAT(problems(), ElementsAre("times.txt:8: cannot be read, \"# ?[2Jnotes\"",
                                      "drops.csv:3: cannot be read, \"3,lazy,0.120000000\"",
                                      "frame 3 was neither delivered nor dropped"));
}

TEST_F(CheckSession, NamesWhatIsOutOfOrder) {
  record();
  replace("times.txt", "1 0.040000000 8.500000\n2 0.080000000 8.500000\n",
          "2 0.080000000 8.500000\n1 0.040000000 8.500000\n");
  EXPECT_THAT(problems(), ElementsAre("times.txt: frame 1 comes after frame 2"));
}

TEST_F(CheckSession, NamesATimeThatDoesNotIncrease) {
  record();
  replace("times.txt", "2 0.080000000", "2 0.040000000");
  EXPECT_THAT(problems(),
              ElementsAre("times.txt: frame 2 was taken at 0.040000000 s, not after frame 1 at "
                          "0.040000000 s"));
}

TEST_F(CheckSession, NamesAFrameThatWasDeliveredAndDropped) {
  record();
  append("drops.csv", "5,policy,0.200000000\n4,policy,0.160000000\n");
  EXPECT_THAT(problems(),
              ElementsAre("drops.csv: frame 5 was delivered", "drops.csv: frame 4 is there twice"));
}

TEST_F(CheckSession, NamesFramesOfWhichNothingIsKnown) {
  record();
  replace("drops.csv", "4,policy,0.160000000\n3,busy,0.120000000\n", "");
  replace("drops.csv", "7,failed", "12,failed");
  EXPECT_THAT(problems(), ElementsAre("frames 3 to 4 were neither delivered nor dropped",
                                      "frame 7 was neither delivered nor dropped",
                                      "frames 10 to 11 were neither delivered nor dropped"));
}

TEST_F(CheckSession, NamesACalibrationThatDsoWouldNotRead) {
  record(false, "Pinhole 1 2 3\n64 48\ncrop\n64 48\n");
  EXPECT_THAT(problems(), ElementsAre(HasSubstr("camera.txt: line 1: expected Pinhole")));
}

TEST_F(CheckSession, WithoutTheFolderOfImagesEachIsNamed) {
  record();
  fs::remove_all(session_ / "images");
  const auto found = problems();
  ASSERT_EQ(found.size(), 1U + kFrames);
  EXPECT_EQ(found[0], "images: No such file or directory");
}

TEST_F(CheckSession, OfAnMcapFileAloneItIsSaidThatItIsNotRead) {
  fs::create_directories(session_);
  const std::string name = session_.filename().string() + ".mcap";
  write_file(session_ / name, "");
  for (const fs::path& folder : {session_, session_ / ""}) {
    const auto report = check_session(folder);
    ASSERT_FALSE(report);
    EXPECT_EQ(report.error().text, folder.string() + ": there is only " + name +
                                       ", which is not read: [files] makes what is");
  }
}

TEST_F(CheckSession, AFolderThatIsNoSessionIsAnError) {
  fs::create_directories(session_ / "images");
  const auto report = check_session(session_);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().text,
            session_.string() + ": not a session: neither times.txt, drops.csv nor late.csv in it");
  EXPECT_FALSE(check_session(folder_ / "nowhere"));
}

TEST_F(CheckSession, ARecordThatCannotBeReadIsAnError) {
  fs::create_directories(session_ / "times.txt");
  const auto report = check_session(session_);
  ASSERT_FALSE(report);
  EXPECT_THAT(report.error().text, HasSubstr("times.txt: Is a directory"));
}

}  // namespace
}  // namespace orbbuf
