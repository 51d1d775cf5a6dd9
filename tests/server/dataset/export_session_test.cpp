// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/export_session.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <limits>

#include "server/dataset/check_session.hpp"
#include "tests/server/dataset/recording.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::read_file;
using test::write_file;
using testing::Contains;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

/// A folder on another file system than the temporary ones, if this machine has one.
class ElsewhereFolder {
 public:
  ElsewhereFolder() {
    std::string name = "/dev/shm/orbbuf-test.XXXXXX";
    struct stat here {};
    struct stat there {};
    if (!::mkdtemp(name.data())) return;
    path_ = name;
    const bool is_known =
        ::stat(fs::temp_directory_path().c_str(), &here) == 0 && ::stat(name.c_str(), &there) == 0;
    is_elsewhere_ = is_known && here.st_dev != there.st_dev;
  }
  ~ElsewhereFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  ElsewhereFolder(const ElsewhereFolder&) = delete;
  ElsewhereFolder& operator=(const ElsewhereFolder&) = delete;

  bool is_elsewhere() const { return is_elsewhere_; }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
  bool is_elsewhere_ = false;
};

class ExportSession : public test::Recording {
 protected:
  Result<ExportReport> to(const fs::path& out, Layout layout = Layout::kKitti) const {
    return export_session(session_, out, layout, "jpg");
  }
  std::string error_to(const fs::path& out) const {
    const auto report = to(out);
    return report ? "exported" : report.error().text;
  }

  const fs::path out_ = folder_ / "some" / "out";
};

TEST_F(ExportSession, HasLateFramesInOrder) {
  record();
  const auto store = open();
  for (const Sequence number : {7U, 4U}) ASSERT_TRUE(store->write_late(*frame(number), 0));
  ASSERT_FALSE(store->take_account(account(1, 3)));
  const auto report = to(out_, Layout::kTumMono);
  ASSERT_TRUE(report) << report.error().text;
  EXPECT_EQ(report.value().frames, 9U);
  EXPECT_THAT(report.value().notes, Contains("the robot still has 1 frames of this session"));
  EXPECT_EQ(test::read_lines(out_ / "times.txt").at(4), "5 0.200000000 8.500000");
  EXPECT_THAT(test::read_lines(out_ / "drops.csv"),
              ElementsAre("sequence,reason,capture_time_s", "3,busy,0.120000000"));
}

TEST_F(ExportSession, LinksOnTheSameFileSystem) {
  record(true);
  const auto report = to(out_);
  ASSERT_TRUE(report);
  EXPECT_EQ(report.value().frames, 7U);
  EXPECT_EQ(report.value().linked, 14U);
  EXPECT_EQ(report.value().copied, 0U);
  EXPECT_EQ(fs::hard_link_count(out_ / "image_1/000006.jpg"), 2U);
  EXPECT_TRUE(fs::equivalent(out_ / "image_1/000006.jpg", session_ / "images_right/000009.jpg"));
}

TEST_F(ExportSession, CopiesToAnotherFileSystem) {
  const ElsewhereFolder elsewhere;
  if (!elsewhere.is_elsewhere()) GTEST_SKIP() << "/dev/shm is no other file system here";
  record(true);
  const auto report = to(elsewhere.path());
  ASSERT_TRUE(report);
  EXPECT_EQ(report.value().linked, 0U);
  EXPECT_EQ(report.value().copied, 14U);
  EXPECT_EQ(read_file(elsewhere.path() / "image_1/000006.jpg"),
            read_file(session_ / "images_right/000009.jpg"));
  EXPECT_FALSE(fs::exists(elsewhere.path() / "incoming.tmp"));
}

TEST_F(ExportSession, OnAFullDiskNothingRemains) {
  const ElsewhereFolder elsewhere;
  if (!elsewhere.is_elsewhere()) GTEST_SKIP() << "/dev/shm is no other file system here";
  record();
  const fs::path made = elsewhere.path() / "new";
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 100);
    EXPECT_THAT(error_to(made), HasSubstr("write " + made.string()));
    EXPECT_FALSE(fs::exists(made));
    EXPECT_THAT(error_to(elsewhere.path()), HasSubstr("File too large"));
    EXPECT_TRUE(fs::is_empty(elsewhere.path()));
  }
  EXPECT_TRUE(to(made));
}

TEST_F(ExportSession, SetsTheClockRight) {
  ASSERT_FALSE(begin()->note({{}, 3'600'000'000'000}));
  const auto report = to(out_, Layout::kTumMono);
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().notes, Contains("the robot's clock was set: all times have "
                                             "+3600.000 s added"));
  EXPECT_THAT(read_file(out_ / "times.txt"), StartsWith("0 3600.000000000 "));
  EXPECT_THAT(read_file(out_ / "drops.csv"), HasSubstr("\n4,policy,3600.160000000\n"));
}

TEST_F(ExportSession, ChangesNoTimeIfOneWouldBeOutOfRange) {
  constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
  ASSERT_FALSE(begin()->note({{}, kMost - 100'000'000}));
  ASSERT_TRUE(to(out_, Layout::kTumMono));
  EXPECT_THAT(read_file(out_ / "times.txt"), StartsWith("0 0.000000000 "));
}

TEST_F(ExportSession, ARecordingIsOneFileWithAll) {
  record(true, "Pinhole 50 51 32 24 0\n64 48\nnone\n64 48\n0.1\n");
  const auto report = to(out_, Layout::kMcap);
  ASSERT_TRUE(report) << report.error().text;
  EXPECT_THAT(report.value().notes, IsEmpty());
  EXPECT_EQ(report.value().frames, 7U);
  EXPECT_EQ(report.value().copied, 14U);
  const std::string recording = read_file(out_ / "s.mcap");
  EXPECT_TRUE(recording.starts_with("\x89MCAP0\r\n") && recording.ends_with("\x89MCAP0\r\n"));
  for (const Sequence sequence : {0U, 9U, 109U}) {
    const auto jpeg = test::jpeg_frame_ptr(sequence, kWidth, kHeight);
    EXPECT_THAT(recording, HasSubstr(test::as_text(jpeg->jpeg))) << sequence;
  }
  EXPECT_THAT(recording, HasSubstr("\"sequence\":4,\"reason\":\"policy\""));
  EXPECT_FALSE(fs::exists(out_ / "images"));
}

TEST_F(ExportSession, ARecordingThatCannotBeWrittenIsNotLeft) {
  record();
  const test::ResourceLimit full(RLIMIT_FSIZE, 10'000);
  EXPECT_FALSE(to(out_, Layout::kMcap));
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(ExportSession, RefusesAFolderWithSomethingInIt) {
  record();
  fs::create_directories(out_);
  write_file(out_ / "mine", "text");
  EXPECT_THAT(error_to(out_), HasSubstr("not empty"));
  EXPECT_EQ(read_file(out_ / "mine"), "text");
  EXPECT_THAT(error_to(out_ / "mine"), HasSubstr("Not a directory"));
  EXPECT_EQ(read_file(out_ / "mine"), "text");
}

TEST_F(ExportSession, RefusesWhatIsNoSession) {
  EXPECT_THAT(error_to(out_), HasSubstr("not a session"));
  test::write_drops(*open(), {{0, 0, DropReason::kShutdown}});
  EXPECT_THAT(error_to(out_), EndsWith("session: no frames"));
  EXPECT_FALSE(fs::exists(out_.parent_path()));
}

TEST_F(ExportSession, RefusesASessionWhoseImagesAreMissing) {
  record(true);
  fs::remove(session_ / "images_right/000005.jpg");
  fs::remove(session_ / "images/000008.jpg");
  EXPECT_EQ(error_to(out_),
            session_.string() + ": 2 of its images are missing, images_right/000005.jpg first");
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(ExportSession, RefusesTimesThatDoNotIncrease) {
  const auto store = open();
  EncodedFrame second = *frame(1);
  second.capture_time_ns = 0;
  ASSERT_FALSE(store->write(*frame(0), 0));
  ASSERT_FALSE(store->write(second, 0));
  EXPECT_THAT(error_to(out_), EndsWith("frame 1 was taken at 0.000000000 s, not after frame 0"));
}

TEST_F(ExportSession, LeavesOutWhatWasNotAccepted) {
  record(false, "Pinhole 50 51 32 24 0\n64 48\nnone\n64 48\n");
  const auto journal = session_ / "journal.000000";
  write_file(journal, read_file(journal) + "OBJR, and torn");
  write_file(session_ / "images/000010.jpg", "whole, but not accepted");
  const auto report = to(out_);
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().notes, IsEmpty());
  EXPECT_EQ(report.value().frames, 7U);
  EXPECT_FALSE(fs::exists(out_ / "image_0/000007.jpg"));
}

TEST_F(ExportSession, SaysThatThereIsNoCalibration) {
  record();
  const auto report = to(out_);
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().notes, ElementsAre("no calibration: the robot sent none"));
}

}  // namespace
}  // namespace orbbuf
