// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/check_session.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <filesystem>

#include "server/dataset/mcap/part.hpp"
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
  SessionReport check() const {
    auto report = check_session(session_);
    EXPECT_TRUE(report) << report.error().text;
    return report ? std::move(report).value() : SessionReport{};
  }
  std::vector<std::string> problems() const { return check().problems; }
  void flip_a_byte(const char* file, std::size_t at) const {
    std::string bytes = read_file(session_ / file);
    ASSERT_LT(at, bytes.size());
    bytes[at] = static_cast<char>(bytes[at] ^ 4);
    write_file(session_ / file, bytes);
  }
};

TEST_F(CheckSession, FindsNothingInASoundOne) {
  record(false, "FOV 0.5 0.7 0.5 0.5 0.9\n64 48\ncrop\n64 48\n");
  const auto report = check();
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(report.notes, IsEmpty());
  EXPECT_THAT(summary(report), StartsWith("OK: 10 captured: 7 live, 0 late, 0 on the robot, 3 "
                                          "dropped (1 policy, 1 busy, 1 failed); 0.0 MiB"));
}

TEST_F(CheckSession, FindsNothingInASoundPair) {
  record(true);
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, FindsNothingInOneOfWhichAllWasDropped) {
  const auto store = open();
  test::write_drops(*store, {{0, 0, DropReason::kShutdown}});
  ASSERT_FALSE(store->finish(true));
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, SaysHowManyFramesAreReducedAndHowManyWereReplaced) {
  const auto store = open();
  for (Sequence i = 0; i < 3; ++i) {
    EncodedFrame reduced = *frame(i);
    const auto whole = frame(i + 50);
    reduced.quality = 30;
    reduced.whole_bytes = static_cast<std::uint32_t>(whole->jpeg.size());
    reduced.whole_crc = crc32(whole->jpeg);
    ASSERT_FALSE(store->write(reduced, 0));
  }
  EncodedFrame whole = *frame(51);
  whole.sequence = 1;
  whole.capture_time_ns = test::kFrameNs;
  ASSERT_EQ(store->write_late(whole, 0).value(), SessionStore::Late::kReplaced);
  ASSERT_FALSE(store->finish(true));
  const auto report = check();
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(report.notes,
              ElementsAre("2 of 3 frames have a reduced JPEG; 1 came reduced, and whole later"));
  EXPECT_THAT(summary(report), StartsWith("OK: 3 captured: 3 live, 0 late"));
}

TEST_F(CheckSession, SaysThatASessionHasNotEnded) {
  const auto store = begin();
  EXPECT_THAT(problems(), ElementsAre("not ended: it is not known how many frames are missing at "
                                      "the end"));
  ASSERT_FALSE(store->note({wire::Stats{25, 1, 1, 1, 7, 15, 0}, 0}));
  EXPECT_THAT(problems(), ElementsAre("not ended: up to 15 frames unaccounted for at the "
                                      "robot's last report"));
  ASSERT_FALSE(store->finish(false));
  EXPECT_THAT(problems(), ElementsAre(StartsWith("not ended: up to 15 frames")));
}

TEST_F(CheckSession, OfAnOpenSessionTheRestIsOnTheRobot) {
  const auto store = begin();
  ASSERT_FALSE(store->note({wire::Stats{25, 1, 1, 1, 7, 15, 0}, 0}));
  // The images of frames whose records follow, live or late.
  write_file(session_ / "images/000004.jpg", read_file(session_ / "images/000005.jpg"));
  write_file(session_ / "images/000010.jpg", read_file(session_ / "images/000005.jpg"));
  auto report = check_session(session_, true).value();
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(summary(report), StartsWith("open: 25 captured: 7 live, 0 late, 15 on the robot, 3 "
                                          "dropped; "));
  flip_a_byte("images/000006.jpg", 9);
  EXPECT_THAT(check_session(session_, true).value().problems,
              ElementsAre(StartsWith("images/000006.jpg: ")));
  ASSERT_FALSE(store->finish(true));
  EXPECT_THAT(check_session(session_, true).value().problems,
              testing::Not(IsEmpty()));  // it has ended meanwhile
}

/// A server that was killed has left it there, or one that does not tell.
TEST_F(CheckSession, AnImageBehindTheEndOfTheJournalIsNoStray) {
  const auto store = begin();
  write_file(session_ / "images/000004.jpg", read_file(session_ / "images/000005.jpg"));
  write_file(session_ / "images/000010.jpg", read_file(session_ / "images/000005.jpg"));
  EXPECT_THAT(problems(), ElementsAre(StartsWith("not ended: "),
                                      "images/000004.jpg: not of any frame of the session"));
}

// What a robot said that died before its first contact: only its spool arrives.
TEST_F(CheckSession, ASessionOfLateFramesOnlyHasNotEnded) {
  const auto store = open();
  for (const Sequence sequence : {1U, 4U}) {
    ASSERT_TRUE(store->write_late(*frame(sequence), 0));
  }
  EXPECT_THAT(problems(), ElementsAre("not ended: up to 3 frames unaccounted for at the robot's "
                                      "last report"));
  wire::Account last = account(0, 0);
  last.is_final = true;
  last.has_ended = false;
  last.captured = 5;
  ASSERT_FALSE(store->take_account(last));
  const auto report = check();
  EXPECT_THAT(report.problems, ElementsAre("not ended: the robot was killed; frames of its last "
                                           "seconds may be missing"));
  EXPECT_THAT(summary(report), StartsWith("1 problem: 5 captured: 0 live, 2 late, 0 on the robot, "
                                          "3 dropped (3 unknown)"));
}

TEST_F(CheckSession, NamesTheFramesAtTheEndThatNeverCame) {
  const auto store = begin();
  ASSERT_FALSE(store->note({wire::Stats{12, 1, 1, 1, 9, 0, 0}, 0}));
  ASSERT_FALSE(store->finish(true));
  EXPECT_THAT(problems(), ElementsAre("2 frames neither delivered nor dropped, nor on the robot, "
                                      "among: frames 10 to 11"));
}

TEST_F(CheckSession, NamesSomeOfManyGaps) {
  const auto store = open();
  for (Sequence i = 0; i < 13; ++i) ASSERT_FALSE(store->write(*frame(2 * i + 1), 0));
  ASSERT_FALSE(store->finish(true));
  const auto found = problems();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0], StartsWith("13 frames neither delivered"));
  EXPECT_THAT(found[0], HasSubstr(" frame 18, 3 other gaps"));
}

TEST_F(CheckSession, LateFramesCountAsSuch) {
  for (const bool is_stereo : {false, true}) {
    fs::remove_all(session_);
    record(is_stereo);
    const auto store = open();
    for (const Sequence sequence : {7U, 3U}) {
      ASSERT_TRUE(store->write_late(*frame(sequence, is_stereo), 0));
    }
    const auto report = check();
    EXPECT_THAT(report.problems, IsEmpty());
    EXPECT_THAT(summary(report), StartsWith("OK: 10 captured: 7 live, 2 late, 0 on the robot, 1 "
                                            "dropped (1 policy); 0.0 MiB"));
  }
}

TEST_F(CheckSession, CountsWhatTheRobotStillHas) {
  record();
  const auto store = open();
  using Counts = std::pair<std::uint64_t, std::uint64_t>;
  const auto counts = [&](std::uint64_t held, Sequence first_held) {
    EXPECT_FALSE(store->take_account(account(held, first_held)));
    const auto report = check();
    EXPECT_THAT(report.problems, IsEmpty());
    EXPECT_EQ(report.captured, report.live + report.late + report.on_robot + report.dropped);
    return Counts(report.on_robot, report.dropped);
  };
  EXPECT_EQ(counts(2, 4), Counts(2, 1));
  store->finish(true);  // the next account is recorded at once
  EXPECT_EQ(counts(0, 0), Counts(0, 3));
  EXPECT_EQ(counts(3, 3), Counts(3, 0));
}

/// The robot ended in an outage, its next start accounted for the session and died.
TEST_F(CheckSession, SamplesThatTheRobotHoldsAreOnTheRobot) {
  const wire::StreamDeclaration stream{4, "imu0", "imu"};
  auto opened = SessionStore::open(session_, {"robot", "session", "", {stream}}, Durability::kAck);
  SessionStore& store = *opened.value();
  ASSERT_FALSE(store.write(*frame(0), 0));
  ASSERT_FALSE(store.write_items({4, 0, 2, wire::encode_samples({{{1, {}, {}}, {2, {}, {}}}})}));
  wire::Account account;
  account.session_id = "session";
  account.is_final = account.has_ended = true;
  account.captured = 1;
  account.streams = {{stream, 10, 7}};
  ASSERT_FALSE(store.take_account(account));
  ASSERT_FALSE(store.finish(true));
  EXPECT_THAT(check().notes, ElementsAre("imu0: 2 samples, 7 on the robot, 1 lost"));
  EXPECT_THAT(read_file(session_ / "session.txt"),
              HasSubstr("imu0 delivered 2 on_robot 7 lost 1\n"));
}

TEST_F(CheckSession, WhatIsNotNamedMayBeOnTheRobot) {
  const auto store = open();
  for (const Sequence sequence : delivered()) ASSERT_FALSE(store->write(*frame(sequence), 0));
  wire::Account has = account(2, 4);
  has.captured = 11;
  ASSERT_FALSE(store->take_account(has));
  ASSERT_FALSE(store->finish(true));
  const auto report = check();  // 3, 4, 7 and 10
  EXPECT_EQ(report.on_robot, 2U);
  EXPECT_THAT(report.problems,
              ElementsAre("2 frames neither delivered nor dropped, nor on the robot, among: frame "
                          "3, frame 4, frame 7, frame 10"));
}

TEST_F(CheckSession, NamesAMissingImageOfEitherSide) {
  record(true);
  fs::remove(session_ / "images/000005.jpg");
  fs::remove(session_ / "images_right/000008.jpg");
  EXPECT_THAT(problems(), ElementsAre(HasSubstr("images/000005.jpg: No such file"),
                                      HasSubstr("images_right/000008.jpg: No such file")));
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

TEST_F(CheckSession, NamesAnImageThatWasNoJpegWhenItCame) {
  const auto store = begin();
  ASSERT_FALSE(store->write(test::plain_frame(10), 0));
  ASSERT_FALSE(store->finish(true));
  EXPECT_THAT(problems(), ElementsAre(StartsWith("images/000010.jpg: cannot read a JPEG")));
}

TEST_F(CheckSession, NamesAStrayAmongTheImagesOfEitherSide) {
  record(true);
  write_file(session_ / "images/000004.jpg", read_file(session_ / "images/000005.jpg"));
  write_file(session_ / "images/5.jpg", "");
  write_file(session_ / "images_right/notes.txt", "mine");
  EXPECT_THAT(problems(), testing::UnorderedElementsAre(
                              "images/000004.jpg: not of any frame of the session",
                              "images/5.jpg: not of any frame of the session",
                              "images_right/notes.txt: not of any frame of the session"));
}

TEST_F(CheckSession, FilesBesideTheImagesAreAnyones) {
  record();
  write_file(session_ / "trajectory.txt", "mine");
  write_file(session_ / "times.txt", "no view is looked at");
  EXPECT_THAT(problems(), IsEmpty());
}

TEST_F(CheckSession, NamesATimeThatDoesNotIncrease) {
  const auto store = open();
  EncodedFrame second = *frame(1);
  second.capture_time_ns = 0;
  ASSERT_FALSE(store->write(*frame(0), 0));
  ASSERT_FALSE(store->write(second, 0));
  ASSERT_FALSE(store->finish(true));
  EXPECT_THAT(problems(), ElementsAre("frame 1 was taken at 0.000000000 s, not after frame 0 at "
                                      "0.000000000 s"));
}

TEST_F(CheckSession, NamesACalibrationThatDsoWouldNotRead) {
  record(false, "Pinhole 1 2 3\n64 48\ncrop\n64 48\n");
  EXPECT_THAT(problems(), ElementsAre(HasSubstr("camera.txt: line 1: expected Pinhole")));
}

TEST_F(CheckSession, DamageOfTheJournalIsAProblem) {
  record();
  flip_a_byte("journal.000000", fs::file_size(session_ / "journal.000000") / 2);
  const auto found = problems();
  ASSERT_FALSE(found.empty());
  EXPECT_THAT(found[0], HasSubstr("bytes are damaged"));
}

TEST_F(CheckSession, ImagesThatOnlyARecordingHasAreNotMissing) {
  const auto store = begin();
  mcap::PartMaker maker(session_, store->summary(), {1, {}, store->written()});
  while (!maker.go_on().value()) {
  }
  RecordedPart part = maker.part();
  part.is_only_copy = true;
  ASSERT_FALSE(store->note_part(part));
  ASSERT_FALSE(mcap::remove_images(session_, part));
  ASSERT_FALSE(store->write(*frame(10), 0));
  ASSERT_FALSE(store->finish(true));
  auto report = check();
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(report.notes, ElementsAre("7 images are not kept, but in the MCAP recording"));
  fs::remove(session_ / "images/000010.jpg");
  EXPECT_THAT(problems(), ElementsAre(HasSubstr("images/000010.jpg: No such file")));
}

TEST_F(CheckSession, AFolderThatIsNoSessionIsAnError) {
  fs::create_directories(session_ / "images");
  const auto report = check_session(session_);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().text, session_.string() + ": not a session: no journal in it");
  EXPECT_FALSE(check_session(folder_ / "nowhere"));
}

/// It would be waited for a writer.
TEST_F(CheckSession, AFifoInPlaceOfAFileIsNoFile) {
  record(true);
  for (const char* file : {"images/000005.jpg", "images_right/000008.jpg", "session.txt"}) {
    fs::remove(session_ / file);
    ASSERT_EQ(::mkfifo((session_ / file).c_str(), 0600), 0);
  }
  EXPECT_THAT(problems(), ElementsAre(HasSubstr("images/000005.jpg: it is a FIFO or a device"),
                                      HasSubstr("images_right/000008.jpg: it is a FIFO")));
  fs::remove(session_ / "journal.000000");
  ASSERT_EQ(::mkfifo((session_ / "journal.000000").c_str(), 0600), 0);
  const auto report = check_session(session_);
  ASSERT_FALSE(report);
  EXPECT_THAT(report.error().text, HasSubstr("journal.000000: it is a FIFO"));
}

TEST_F(CheckSession, AJournalOfAnotherSessionIsAProblemEvenWithTheSameImages) {
  record();
  const fs::path moved = folder_ / "moved";
  fs::rename(session_, moved);
  EXPECT_THAT(check_session(moved).value().problems, IsEmpty());  // a folder may have any name
  const auto other = test::open_store(folder_ / "other", {"r", "other", "", {}});
  for (const Sequence sequence : delivered()) ASSERT_FALSE(other->write(*frame(sequence), 0));
  ASSERT_FALSE(other->finish(true));
  fs::copy_file(folder_ / "other/journal.000000", moved / "journal.000000",
                fs::copy_options::overwrite_existing);
  EXPECT_THAT(check_session(moved).value().problems,
              testing::Contains("the journal is of session other of robot r, and session.txt is "
                                "not"));
}

TEST_F(CheckSession, AJournalThatCannotBeReadIsAnError) {
  fs::create_directories(session_ / "journal.000000");
  const auto report = check_session(session_);
  ASSERT_FALSE(report);
  EXPECT_THAT(report.error().text, HasSubstr("journal.000000: Is a directory"));
}

}  // namespace
}  // namespace orbbuf
