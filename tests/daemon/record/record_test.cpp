// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sched.h>
#include <sys/file.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "testing/captured_log.hpp"
#include "tests/daemon/record/record_fixture.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::uint64_t kMiB = 1 << 20;
constexpr std::size_t kLarge = 200'000;  // five or six of them in a segment of 1 MiB

TEST_F(RecordTest, ANewRecordHasNothing) {
  WatchedRecord record(settings(), "a");
  EXPECT_FALSE(record->next());
  EXPECT_EQ(record->stats(), Record::Stats());
  record->rewind();
  record->release(0);
  record->remove({});
  record->settle("a");
  EXPECT_EQ(record.account_of("a")->captured, 0U);
  EXPECT_TRUE(record->keeps_frames());
}

TEST_F(RecordTest, WithoutAPathItKnowsThePresentSessionAndWritesNothing) {
  WatchedRecord record(RecordSettings{}, "a");
  EXPECT_FALSE(record->keeps_frames());
  record->give_up(std::vector{drop(3)});
  record->keep(kept_frame(4));
  record->note(progress(9, 2));
  const auto account = record.account_of("a");
  EXPECT_EQ(account->captured, 9U);
  EXPECT_EQ(account->confirmed, 2U);
  EXPECT_EQ(account->held, 0U);
  EXPECT_EQ(record->stats(), Record::Stats());
  record->end();
}

TEST_F(RecordTest, SamplesThatWaitedAreSentByTheNextStart) {
  const wire::Items items{4, 7, {0, 2, 1, 2, 3}};
  auto progress = test::progress(9);
  progress.streams = {{{4, "imu0", "imu"}, 9, 7}};
  {
    WatchedRecord record(without_frames(), "a");
    EXPECT_TRUE(record->keep(items));
    record->note(progress);
  }
  for (const char* const session : {"b", "c"}) {
    WatchedRecord record(without_frames(), session);
    const auto late = record.next();
    EXPECT_EQ(late.session_id, "a");
    EXPECT_EQ(late.frame, nullptr);
    EXPECT_EQ(late.items, items);
  }
  {
    WatchedRecord record(without_frames(), "d");
    record.deliver(1);
    record->settle("a");
    EXPECT_FALSE(record.account_of("a"));
  }
}

/// Those that are too many wait in memory, and are offered again with the next note().
TEST_F(RecordTest, TheRateHoldsForSamplesToo) {
  RecordSettings slow = without_frames();
  slow.rate_bytes_per_s = 1;
  WatchedRecord record(slow, "a");
  EXPECT_TRUE(record->keep(wire::Items{4, 7, {0, 2, 1, 2, 3}}));
  EXPECT_FALSE(record->keep(wire::Items{4, 9, {0, 2, 1, 2, 3}}));
}

TEST_F(RecordTest, WithoutAPathSamplesAreNotKept) {
  WatchedRecord record(RecordSettings{}, "a");
  EXPECT_FALSE(record->keep(wire::Items{4, 7, {0, 2, 1, 2, 3}}));
}

TEST_F(RecordTest, OneFrameComesBackAsItWas) {
  WatchedRecord record(settings(), "a");
  const auto frame = kept_frame(7);
  record->keep(frame);
  EXPECT_EQ(record->stats().held, 1U);
  const auto late = record.next();
  EXPECT_EQ(late.session_id, "a");
  EXPECT_TRUE(is_same(*late.frame, *frame));
  EXPECT_FALSE(record->next());
  EXPECT_EQ(record.account_of("a")->held, 1U);
  record->remove(late.id);
  EXPECT_EQ(record.account_of("a")->held, 0U);
}

TEST_F(RecordTest, ThePresentSessionsFramesFromTheLiveOnesOnAreHeldBack) {
  WatchedRecord record(settings(), "a");
  record->set_live_from(2);
  record.keep(0, 4);
  EXPECT_EQ(record.take(2), numbers(0, 2));
  EXPECT_FALSE(record->next());
  record->set_live_from(3);
  EXPECT_EQ(record.take(1), numbers(2, 3));
}

TEST_F(RecordTest, OrderIsKeptOverManySegments) {
  WatchedRecord record(settings(4 * kMiB), "a");
  record.keep(0, 15, kLarge);
  EXPECT_EQ(record.take(15), numbers(0, 15));
  EXPECT_GT(segments().size(), 2U);
}

TEST_F(RecordTest, SegmentsAreRemovedInOrderWhenNothingInThemIsHeld) {
  {
    WatchedRecord record(settings(8 * kMiB), "a");
    record->note(progress(30));
    record.keep(0, 30, kLarge);
    record.deliver(29);
  }
  WatchedRecord record(settings(8 * kMiB), "b");
  EXPECT_EQ(record.take(1), numbers(29, 30));
  record->note(progress(1));                                // its sync makes the removal possible
  record.keep(0, 1);                                        // its news comes after that
  while (segments().size() > 2) std::this_thread::yield();  // no news of removed files
  EXPECT_EQ(record->stats().held, 2U);
}

TEST_F(RecordTest, ARestartFindsAllFramesOfAllSessions) {
  for (const std::string session : {"a", "b", "c"}) {
    WatchedRecord record(settings(16 * kMiB), session);
    record.keep(10, 20, kLarge);
  }
  WatchedRecord record(settings(16 * kMiB), "d");
  record.keep(1, 3);
  for (const std::string session : {"a", "b", "c"}) {
    const auto account = record.account_of(session);
    EXPECT_EQ(account->held, 10U);
    EXPECT_EQ(account->first_held, 10U);
    EXPECT_EQ(account->captured, 20U);
    EXPECT_TRUE(account->is_final);
    for (Sequence sequence = 10; sequence < 20; ++sequence) {
      const auto late = record.next();
      EXPECT_EQ(late.session_id, session);
      EXPECT_TRUE(is_same(*late.frame, *kept_frame(sequence, kLarge)));
    }
    record->rewind();  // for the accounts
    for (int i = 0; i < 10; ++i) record->remove(record.next().id);
  }
  EXPECT_THAT(record.take(2), ElementsAre(1, 2));
}

TEST_F(RecordTest, WhatTheServerHasDoesNotComeAfterARestart) {
  {
    WatchedRecord record(settings(8 * kMiB), "a");
    record.keep(0, 20, kLarge);
    auto frames = record.take_frames(13);
    for (const std::size_t i : {0U, 1U, 2U, 5U, 12U}) record->remove(frames[i].id);
  }
  WatchedRecord record(settings(8 * kMiB), "b");
  EXPECT_EQ(record->stats().held, 15U);
  EXPECT_THAT(record.take(15), ElementsAre(3, 4, 6, 7, 8, 9, 10, 11, 13, 14, 15, 16, 17, 18, 19));
}

TEST_F(RecordTest, ABrokenConnectionsFramesAreNextAgain) {
  WatchedRecord record(settings(), "a");
  record.keep(0, 20, kLarge);
  auto frames = record.take_frames(12);
  for (const std::size_t i : {0U, 1U, 7U}) record->remove(frames[i].id);
  auto rest = numbers(2, 20);
  std::erase(rest, 7);
  for (int i = 0; i < 2; ++i) {
    record->rewind();
    EXPECT_EQ(record.take(17), rest);
  }
  EXPECT_FALSE(record->next());
}

TEST_F(RecordTest, AFrameReleasedBeforeItIsWrittenIsNotHeld) {
  RecordSettings slow = settings();
  slow.rate_bytes_per_s = 1;  // the first is written, the others wait
  {
    WatchedRecord record(slow, "a");
    record.keep(0, 3);
    record.take(1);
    record->release(1);
    EXPECT_EQ(record->stats().held, 2U);
  }
  WatchedRecord record(settings(), "b");
  EXPECT_THAT(record.take(2), ElementsAre(0, 2));
}

TEST_F(RecordTest, AFrameReleasedAfterItWasWrittenIsNotSent) {
  {
    WatchedRecord record(settings(), "a");
    record.keep(0, 4);
    record.take(4);
    record->rewind();
    record->release(1);
    EXPECT_THAT(record.take(3), ElementsAre(0, 2, 3));
    record->release(2);  // on its way
    EXPECT_EQ(record->stats().held, 2U);
  }
  WatchedRecord record(settings(), "b");
  record->release(3);  // of another session
  EXPECT_THAT(record.take(2), ElementsAre(0, 3));
}

TEST_F(RecordTest, AFullRecordLosesItsOldestSegmentAndSaysSo) {
  const CapturedLog log;
  {
    WatchedRecord record(settings(4 * kMiB), "a");
    record->note(progress(30));
    record.keep(0, 30, kLarge);
    record.wait_until([&] { return record->stats().evicted > 0; });
    EXPECT_THAT(log.lines("kept frames of session robot/a are lost").front(),
                HasSubstr("spool.size is reached"));
    EXPECT_TRUE(record.account_of("a"));
  }
  WatchedRecord record(settings(4 * kMiB), "b");
  const auto account = record.account_of("a");
  EXPECT_EQ(account->captured, 30U);
  EXPECT_EQ(account->held + account->first_held, 30U);
  EXPECT_EQ(record.take(account->held), numbers(account->first_held, 30));
  EXPECT_LE(record->stats().bytes, 4 * kMiB);
}

TEST_F(RecordTest, WhatIsMoreThanMayWaitIsNotKept) {
  const CapturedLog log;
  RecordSettings slow = settings(128 * kMiB);
  slow.rate_bytes_per_s = 1;
  WatchedRecord record(slow, "a");
  record.keep(0, 1);
  record.take(1);  // is written
  record.keep(1, 17, Record::kMostPendingBytes / 16);
  EXPECT_EQ(record->stats().not_kept, 0U);
  record.keep(17, 20, 1);
  EXPECT_EQ(record->stats().not_kept, 3U);
  EXPECT_EQ(record->stats().held, 17U);
  EXPECT_EQ(log.lines("a frame is not kept").size(), 1U);
}

TEST_F(RecordTest, AFrameOfMoreThanHalfTheSizeIsNotKept) {
  WatchedRecord record(settings(4 * kMiB), "a");
  record.keep(0, 1, 2 * kMiB + 1);
  EXPECT_EQ(record->stats().not_kept, 1U);
  record.keep(1, 2, 2 * kMiB);
  EXPECT_THAT(record.take(1), ElementsAre(1));
}

TEST_F(RecordTest, ADamagedFrameIsPassedOverAndCounted) {
  { WatchedRecord(settings(), "a").keep(0, 5); }
  const auto content = read_file(segment(0));
  const auto middle = kept_frame(2)->jpeg;
  const auto at = content.find(std::string(middle.begin(), middle.end()));
  ASSERT_NE(at, std::string::npos);
  const CapturedLog log;
  WatchedRecord record(settings(), "b");
  std::fstream file(segment(0), std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(at)).put(static_cast<char>(content[at] ^ 1)).flush();
  EXPECT_THAT(record.take(4), ElementsAre(0, 1, 3, 4));
  EXPECT_EQ(record->stats().damaged, 1U);
  EXPECT_EQ(record->stats().held, 4U);
  EXPECT_THAT(log.lines("is damaged").front(), HasSubstr("frame 2"));
}

TEST_F(RecordTest, FramesThatCannotBeReadForAWhileAreNotLost) {
  { WatchedRecord(settings(), "a").keep(0, 5); }
  const CapturedLog log;
  WatchedRecord record(settings(), "b");
  std::vector<Sequence> taken = record.take(1);
  const std::string why = system_error("", EMFILE).text;
  {
    const ResourceLimit no_more(RLIMIT_NOFILE, 1);  // those that are open stay so
    for (; record->next(); record->take_next()) taken.push_back(record->next()->frame->sequence);
    log.wait_for(why + "; it is tried again");
  }
  while (taken.size() < 5) taken.push_back(record.next().frame->sequence);
  EXPECT_EQ(taken, numbers(0, 5));
  EXPECT_EQ(record->stats().damaged, 0U);
}

TEST_F(RecordTest, ASegmentThatDisappearsCostsItsFrames) {
  { WatchedRecord(settings(4 * kMiB), "a").keep(0, 12, kLarge); }  // six in each segment
  WatchedRecord record(settings(4 * kMiB), "b");
  record.take(1);
  std::filesystem::remove(segment(1));
  EXPECT_EQ(record.take(5), numbers(1, 6));
  record.wait_until([&] { return record->stats().damaged == 6; });
  EXPECT_EQ(record->stats().held, 6U);
}

/// Someone removes the folder while the robot runs: it goes on in a new one.
TEST_F(RecordTest, AFolderThatDisappearsIsMadeAgain) {
  const CapturedLog log;
  {
    WatchedRecord record(settings(), "a");
    record->note(progress(5));
    record.keep(0, 4);
    record.take(4);  // all are read: none can be missed there before the record looks for its files
    std::filesystem::remove_all(path());
    record->note(progress(9));
    record.wait_until([&] { return record->stats().evicted == 4; });
    EXPECT_EQ(log.lines("error record: the files in").size(), 1U);
    record.keep(6, 8);
    EXPECT_THAT(record.take(2), ElementsAre(6, 7));
    EXPECT_THROW(WatchedRecord(settings(), "c"), std::runtime_error);  // it is locked, too
  }
  WatchedRecord record(settings(), "b");
  EXPECT_EQ(record.account_of("a")->captured, 9U);
  EXPECT_THAT(record.take(2), ElementsAre(6, 7));
}

TEST_F(RecordTest, OtherFilesAreLeftAlone) {
  std::filesystem::create_directories(path());
  const std::vector<std::string> names = {"README", "journal.1", "journal.x", "journal.000001.old"};
  for (const auto& name : names) write_file(path() / name, "mine");
  { WatchedRecord(settings(4 * kMiB), "a").keep(0, 40, kLarge); }
  for (const auto& name : names) EXPECT_EQ(read_file(path() / name), "mine");
}

TEST_F(RecordTest, TwoProcessesCannotShareAFolder) {
  const WatchedRecord record(settings(), "a");
  for (const auto& other : {settings(), without_frames()}) {
    try {
      const WatchedRecord second(other, "b");
      FAIL() << "both have it";
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(path().string()));
      EXPECT_THAT(error.what(), HasSubstr("another orbbufd uses it"));
    }
  }
}

TEST_F(RecordTest, AFileInPlaceOfTheFolderIsAWarning) {
  write_file(path(), "a file");
  const CapturedLog log;
  for (const auto& kind : {settings(), without_frames()}) {
    WatchedRecord record(kind, "a");
    EXPECT_FALSE(record->keeps_frames());
    record->note(progress(5));
    EXPECT_EQ(record.account_of("a")->captured, 5U);
  }
  EXPECT_EQ(log.lines("warning record: cannot").size(), 2U);
}

TEST_F(RecordTest, TheRateLimitsTheFramesThatAreWritten) {
  RecordSettings slow = settings();
  slow.rate_bytes_per_s = 500'000;
  WatchedRecord record(slow, "a");
  const auto begin = std::chrono::steady_clock::now();
  record.keep(0, 6, kLarge);  // 1.2 MB, of which 0.7 MB may come at once
  EXPECT_EQ(record.take(6), numbers(0, 6));
  EXPECT_GT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(900));
}

/// Runs `body`, which returns whether all was as expected, in a process of its own: a limit on the
/// size of files holds for all threads of a process.
template <class Body>
bool holds_in_a_process(Body body) {
  const pid_t pid = ::fork();
  if (pid == 0) std::_Exit(body() ? 0 : 1);
  int status = 0;
  ::waitpid(pid, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST_F(RecordTest, AFullDiskCostsOneLineAndIsTriedAgain) {
  EXPECT_TRUE(holds_in_a_process([this] {
    const CapturedLog log;
    WatchedRecord record(settings(), "a");
    {
      const ResourceLimit full(RLIMIT_FSIZE, kMiB);
      record->note(progress(12));
      record.keep(0, 12, kLarge);
      log.wait_for("error record: write");
      if (record->stats().held != 12) return false;  // they wait
      record.keep(12, 100, kLarge);
      if (record->stats().not_kept != 100 - record->stats().held) return false;
      if (record.take(5) != numbers(0, 5)) return false;
    }
    if (record.take(3) != numbers(5, 8)) return false;
    record->note(progress(100));
    log.wait_for("takes records again");
    return log.lines("error").size() == 1;
  }));
  WatchedRecord record(settings(), "b");
  EXPECT_GE(record.account_of("a")->captured, 12U);  // and those that were kept beyond
}

bool mount_disk(const std::filesystem::path& path, const char* size) {
  return ::unshare(CLONE_NEWNS) == 0 &&
         ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
         ::mount("tmpfs", path.c_str(), "tmpfs", 0, size) == 0;
}

TEST_F(RecordTest, AReadOnlyDiskCostsTheRecordAndNotTheStreamUnlessAnotherProcessUsesIt) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, for a disk of its own";
  std::filesystem::create_directories(path());
  EXPECT_TRUE(holds_in_a_process([this] {
    if (!mount_disk(path(), "size=6m")) return false;
    { WatchedRecord(settings(4 * kMiB), "a").keep(0, 4, kLarge); }
    constexpr auto kReadOnly = MS_REMOUNT | MS_BIND | MS_RDONLY;
    if (::mount(nullptr, path().c_str(), nullptr, kReadOnly, nullptr) != 0) return false;
    const CapturedLog log;
    WatchedRecord record(settings(4 * kMiB), "b");
    record.keep(0, 4, kLarge);
    record->note(progress(5));
    if (record->keeps_frames() || record->stats().held != 0) return false;
    if (log.lines("Read-only file system; the robot streams without spool").size() != 1)
      return false;
    const UniqueFd other(::open((path() / "lock").c_str(), O_RDONLY | O_CLOEXEC));
    if (::flock(other.get(), LOCK_EX | LOCK_NB) != 0) return false;
    try {
      const WatchedRecord second(settings(4 * kMiB), "c");
      return false;
    } catch (const std::runtime_error& error) {
      return std::string(error.what()).find("another orbbufd uses it") != std::string::npos;
    }
  }));
}

TEST_F(RecordTest, FramesLeaveRoomForAccountsOnAFullDisk) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, for a disk of its own";
  std::filesystem::create_directories(path());
  EXPECT_TRUE(holds_in_a_process([this] {
    if (!mount_disk(path(), "size=4m")) return false;
    const CapturedLog log;
    {
      WatchedRecord record(settings(), "a");
      record.keep(0, 30, kLarge);  // 6 MB
      record.wait_until([&] { return record->stats().not_kept > 10; });
      if (record->stats().held < 5) return false;
      record->note(progress(30));
    }
    if (!log.lines("error").empty()) return false;
    WatchedRecord record(settings(), "b");
    return record.account_of("a")->captured == 30;
  }));
}

TEST_F(RecordTest, SamplesLeaveRoomForAccountsOnAFullDisk) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, for a disk of its own";
  std::filesystem::create_directories(path());
  EXPECT_TRUE(holds_in_a_process([this] {
    if (!mount_disk(path(), "size=3m")) return false;
    const CapturedLog log;
    auto progress = test::progress(30);
    progress.streams = {{{4, "imu0", "imu"}, 300, 0}};
    {
      WatchedRecord record(without_frames(), "a");
      for (std::uint64_t i = 0; i < 39; ++i) {  // 3.9 MB
        std::vector<std::uint8_t> payload(100'000);
        payload[1] = 5;
        if (!record->keep(wire::Items{4, 5 * i, payload})) return false;
      }
      record->note(progress);
      log.wait_for("samples are not kept: the disk is full");
      progress.captured = 31;
      record->note(progress);
    }
    if (!log.lines("error").empty()) return false;
    WatchedRecord record(without_frames(), "b");
    const auto account = record.account_of("a");
    return account->captured == 31 && account->streams.front().held > 50 &&
           account->streams.front().held < 150;
  }));
}

/// Accounts go before frames on a disk that other programs have filled.
TEST_F(RecordTest, OnAFullDiskTheOldestFramesMakeRoomForAccounts) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, for a disk of its own";
  std::filesystem::create_directories(path());
  EXPECT_TRUE(holds_in_a_process([this] {
    if (!mount_disk(path(), "size=6m")) return false;
    const CapturedLog log;
    WatchedRecord record(settings(4 * kMiB), "a");
    record.keep(0, 14, kLarge);
    record.take(14);
    record->note(progress(14));
    std::ofstream other(path() / "other", std::ios::binary);
    const std::string block(4096, 'x');
    while (other.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
    }
    std::vector<DropRecord> drops;  // more than there is room for
    for (Sequence i = 0; i < 1000; ++i) drops.push_back(drop(100 + 2 * i));
    record->give_up(drops);
    record->note(progress(3000));
    record.wait_until([&] { return record->stats().evicted > 0; });
    log.wait_for("since the disk is full");
    log.wait_for("takes records again");
    return record->stats().held > 0;
  }));
}

TEST_F(RecordTest, AFullDiskDoesNotCostDropRecords) {
  EXPECT_TRUE(holds_in_a_process([this] {
    const CapturedLog log;
    WatchedRecord record(without_frames(), "a");
    {
      const ResourceLimit full(RLIMIT_FSIZE, 10);
      record->give_up(std::vector{drop(1)});
      record->note(progress(5));
      log.wait_for("error record: write");
      record->give_up(std::vector{drop(3)});
      record->note(progress(7));
    }
    return true;  // the end writes it
  }));
  WatchedRecord record(without_frames(), "b");
  const auto account = record.account_of("a");
  ASSERT_TRUE(account);
  EXPECT_EQ(account->captured, 7U);
  EXPECT_THAT(account->given_up, ElementsAre(drop(1), drop(3)));
}

TEST_F(RecordTest, ALongSessionsDropRecordsTakeOneSegment) {
  {
    WatchedRecord record(without_frames(), "a");
    for (Sequence second = 0; second < 3000; ++second) {
      std::vector<DropRecord> drops;
      for (Sequence i = 0; i < 20; ++i) drops.push_back(drop(second * 25 + i));
      record->give_up(drops);
      record->note(progress(second * 25 + 25, second * 25));
    }
  }
  EXPECT_LE(segments().size(), 2U);
  WatchedRecord record(without_frames(), "b");
  EXPECT_EQ(record.account_of("a")->given_up.size(), 20U);  // the server has the others
}

TEST_F(RecordTest, TwoThreadsGetAlong) {
  WatchedRecord record(settings(8 * kMiB), "a");
  std::uint64_t delivered = 0;
  for (Sequence sequence = 0; sequence < 2000; ++sequence) {
    record->keep(kept_frame(sequence, 20'000));
    record->give_up(std::vector{drop(sequence)});
    if (sequence % 7 == 0) record->release(sequence);
    if (sequence % 3 == 0) {
      if (const auto next = record->next()) {
        record->take_next();
        record->remove(next->id);
        ++delivered;
      }
    }
    if (sequence % 20 == 0) record->note(progress(sequence));
    if (sequence % 100 == 0) record->rewind();
    if (sequence % 50 == 0) record->stats();
  }
  EXPECT_LE(record->stats().held + delivered, 2000U);
}

}  // namespace
}  // namespace orbbuf::test
