// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/spool.hpp"

#include <gmock/gmock.h>
#include <sys/mount.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <optional>
#include <thread>

#include "testing/captured_log.hpp"
#include "tests/daemon/spool/spool_fixture.hpp"

namespace orbbuf::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using Held = Spool::Held;

constexpr std::uint64_t kMiB = 1 << 20;
constexpr std::size_t kLarge = 200'000;  // five of them in a segment of 1 MiB

TEST_F(SpoolTest, AnEmptySpoolHandsOutNothing) {
  WatchedSpool spool(settings(), "a");
  EXPECT_FALSE(spool->next());
  EXPECT_THAT(spool->held(), IsEmpty());
  EXPECT_EQ(spool->stats(), Spool::Stats());
  spool->acknowledge(1);
  spool->rewind();
  spool->forget(0);
  EXPECT_FALSE(spool->next());
  EXPECT_THAT(segments(), IsEmpty());
}

TEST_F(SpoolTest, OneFrameComesBackAsItWas) {
  WatchedSpool spool(settings(), "a");
  const auto frame = spool_frame(7);
  spool->add(frame);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 1, 7}));
  const SpooledFrame spooled = spool.next();
  EXPECT_EQ(spooled.session_id, "a");
  EXPECT_TRUE(is_same(*spooled.frame, *frame));
  EXPECT_FALSE(spool->next());
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 1, 7}));
  spool->acknowledge(1);
  EXPECT_THAT(spool->held(), IsEmpty());
  EXPECT_EQ(spool->stats().frames, 0U);
}

TEST_F(SpoolTest, FramesComeInTheOrderInWhichTheyWereAdded) {
  WatchedSpool spool(settings(), "a");
  for (const Sequence sequence : {5U, 3U, 9U, 4U}) spool->add(spool_frame(sequence));
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 4, 3}));
  EXPECT_THAT(spool.take(4), ElementsAre(5, 3, 9, 4));
  spool->acknowledge(2);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 2, 4}));
}

TEST_F(SpoolTest, OrderIsKeptOverManySegments) {
  WatchedSpool spool(settings(), "a");
  spool.add(0, 40, kLarge);
  EXPECT_EQ(spool.take(40), numbers(0, 40));
  EXPECT_GT(segments().size(), 7U);
  spool->acknowledge(40);
  EXPECT_THAT(spool->held(), IsEmpty());
}

TEST_F(SpoolTest, FreedSegmentsAreRemoved) {
  {
    WatchedSpool spool(settings(), "a");
    spool.add(0, 40, kLarge);
    spool.take(40);
    spool->acknowledge(39);
  }
  EXPECT_EQ(segments().size(), 1U);
  {
    WatchedSpool spool(settings(), "b");
    EXPECT_THAT(spool.take(1), ElementsAre(39));
    spool->acknowledge(1);
  }
  EXPECT_THAT(segments(), IsEmpty());
}

TEST_F(SpoolTest, ARestartFindsAllFramesOfAllSessions) {
  for (const std::string session : {"a", "b", "c"}) {
    WatchedSpool spool(settings(), session);
    spool.add(10, 20, kLarge);
  }
  WatchedSpool spool(settings(), "d");
  spool.add(1, 3);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 10, 10}, Held{"b", 10, 10}, Held{"c", 10, 10},
                                         Held{"d", 2, 1}));
  for (const std::string session : {"a", "b", "c"}) {
    for (Sequence sequence = 10; sequence < 20; ++sequence) {
      const SpooledFrame spooled = spool.next();
      EXPECT_EQ(spooled.session_id, session);
      EXPECT_TRUE(is_same(*spooled.frame, *spool_frame(sequence, kLarge)));
    }
  }
  EXPECT_THAT(spool.take(2), ElementsAre(1, 2));
}

TEST_F(SpoolTest, WhatWasAcknowledgedDoesNotComeAfterARestart) {
  {
    WatchedSpool spool(settings(), "a");
    spool.add(0, 20, kLarge);
    spool.take(13);
    spool->acknowledge(8);
  }
  WatchedSpool spool(settings(), "b");
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 12, 8}));
  EXPECT_EQ(spool.take(12), numbers(8, 20));
}

TEST_F(SpoolTest, RewindHandsOutAgainWhatWasNotAcknowledged) {
  WatchedSpool spool(settings(), "a");
  spool.add(0, 20, kLarge);
  spool.take(12);
  spool->acknowledge(3);
  spool->rewind();
  EXPECT_EQ(spool.take(17), numbers(3, 20));
  spool->rewind();
  EXPECT_EQ(spool.take(17), numbers(3, 20));
  spool->acknowledge(17);
  spool->rewind();
  EXPECT_FALSE(spool->next());
  EXPECT_THAT(spool->held(), IsEmpty());
}

TEST_F(SpoolTest, AFrameForgottenBeforeItIsWrittenIsNotHeld) {
  SpoolSettings slow = settings();
  slow.rate_bytes_per_s = 1;  // the first is written, the others wait
  {
    WatchedSpool spool(slow, "a");
    spool.add(0, 3);
    spool.take(1);
    spool->forget(1);
    EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 2, 0}));
  }
  WatchedSpool spool(settings(), "b");
  EXPECT_THAT(spool.take(2), ElementsAre(0, 2));
  spool->acknowledge(2);
  EXPECT_THAT(spool->held(), IsEmpty());
}

TEST_F(SpoolTest, AFrameForgottenAfterItWasWrittenIsNotHandedOut) {
  WatchedSpool spool(settings(), "a");
  spool.add(0, 4);
  spool.take(4);
  spool->rewind();
  spool->forget(1);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 3, 0}));
  EXPECT_THAT(spool.take(3), ElementsAre(0, 2, 3));
  spool->acknowledge(1);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 2, 2}));
}

TEST_F(SpoolTest, AFrameForgottenWhileItIsHandedOutIsStillCountedWhenAcknowledged) {
  WatchedSpool spool(settings(), "a");
  spool.add(0, 4);
  spool.take(3);
  spool->forget(0);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 3, 1}));
  spool->acknowledge(2);
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 2, 2}));
}

TEST_F(SpoolTest, AFrameForgottenInASegmentThatIsNotReadIsFound) {
  WatchedSpool spool(settings(), "a");
  spool.add(0, 40, kLarge);
  while (segments().size() < 8) std::this_thread::yield();  // no news of what is written
  spool->forget(20);
  spool->forget(20);
  spool->forget(1000);
  spool.wait_until([&] { return spool->held() == std::vector<Held>{{"a", 39, 0}}; });
  auto expected = numbers(0, 40);
  std::erase(expected, 20);
  EXPECT_EQ(spool.take(39), expected);
  spool->acknowledge(39);
  EXPECT_THAT(spool->held(), IsEmpty());
}

TEST_F(SpoolTest, ForgettingANumberOfAnotherSessionDoesNothing) {
  { WatchedSpool(settings(), "a")->add(spool_frame(5)); }
  WatchedSpool spool(settings(), "b");
  spool->forget(5);
  EXPECT_THAT(spool.take(1), ElementsAre(5));
}

TEST_F(SpoolTest, AFullSpoolLosesItsOldestSegmentAndNamesTheFrames) {
  const CapturedLog log;
  WatchedSpool spool(settings(4 * kMiB), "a");
  spool.add(0, 20, kLarge);
  EXPECT_EQ(spool.take(1), numbers(0, 1));  // handed out: not lost yet
  spool.add(20, 30, kLarge);
  spool.wait_until([&] { return spool->stats().evicted > 0; });
  spool->rewind();
  const auto first = spool.take(1).front();
  EXPECT_EQ(spool->held().front().first, first);
  EXPECT_EQ(spool->stats().evicted, first);
  EXPECT_EQ(spool->stats().frames, 30 - first);
  EXPECT_LE(spool->stats().bytes, 4 * kMiB + Spool::kMostPendingBytes);
  EXPECT_THAT(log.lines("spool: full").front(), HasSubstr("of session a are lost"));
}

TEST_F(SpoolTest, AcknowledgingFramesThatWereEvictedFitsTheCount) {
  WatchedSpool spool(settings(4 * kMiB), "a");
  spool.add(0, 12, kLarge);
  spool.take(7);
  spool.add(12, 30, kLarge);
  spool.wait_until([&] { return spool->stats().evicted > 0; });
  spool->acknowledge(7);
  const auto rest = spool->stats();
  EXPECT_EQ(rest.evicted + rest.frames + 7, 30U);
  spool->rewind();
  EXPECT_EQ(spool->stats().evicted, rest.evicted);
}

TEST_F(SpoolTest, SegmentsOfAnotherRobotAreNotSentAndGoFirst) {
  const CapturedLog log;
  {
    WatchedSpool spool(settings(4 * kMiB), "theirs", "other");
    spool.add(0, 5, kLarge);
  }
  WatchedSpool spool(settings(4 * kMiB), "a");
  EXPECT_EQ(log.lines("are not of robot robot").size(), 1U);
  EXPECT_THAT(spool->held(), IsEmpty());
  EXPECT_GT(spool->stats().bytes, 5 * kLarge);
  spool.add(0, 15, kLarge);
  EXPECT_EQ(spool.take(15), numbers(0, 15));
  EXPECT_EQ(spool->stats().evicted, 0U);
}

TEST_F(SpoolTest, ARobotThatGetsItsNameBackFindsItsFrames) {
  {
    WatchedSpool spool(settings(), "a");
    spool.add(0, 5, kLarge);
    spool.take(2);
    spool->acknowledge(2);
  }
  {
    WatchedSpool spool(settings(), "b", "other");
    spool.add(0, 15, kLarge);
    spool.take(15);
    spool->acknowledge(15);
  }
  WatchedSpool spool(settings(), "c");
  EXPECT_THAT(spool.take(3), ElementsAre(2, 3, 4));
}

TEST_F(SpoolTest, TheOldestOfTooManySessionsIsEvicted) {
  std::filesystem::create_directories(path());
  for (std::uint64_t number = 100; number <= 100 + Spool::kMostSessions; ++number) {
    const auto file = path() / ("000000000" + std::to_string(number) + ".segment");
    auto made = SegmentWriter::create(file, {"robot", "session-" + std::to_string(number), number});
    ASSERT_TRUE(made && made.value().append(*spool_frame(number, 1)));
  }
  WatchedSpool spool(settings(), "last");
  spool->add(spool_frame(0));
  const auto held = spool->held();
  EXPECT_EQ(held.size(), Spool::kMostSessions);
  EXPECT_EQ(held.front().session_id, "session-102");
  EXPECT_EQ(held.back().session_id, "last");
}

TEST_F(SpoolTest, WhatIsMoreThanMayWaitIsNotSpooled) {
  const CapturedLog log;
  SpoolSettings slow = settings();
  slow.rate_bytes_per_s = 1;
  WatchedSpool spool(slow, "a");
  spool.add(0, 1);
  spool.take(1);  // is written
  const std::size_t bytes = Spool::kMostPendingBytes / 16;
  spool.add(1, 17, bytes);
  EXPECT_EQ(spool->stats().not_spooled, 0U);
  spool.add(17, 18, 1);
  spool.add(18, 20, 1);
  EXPECT_EQ(spool->stats().not_spooled, 3U);
  EXPECT_EQ(spool->stats().frames, 17U);
  EXPECT_EQ(log.lines("not spooled").size(), 1U);
}

TEST_F(SpoolTest, AFrameOfHalfTheSizeIsNotSpooled) {
  WatchedSpool spool(settings(4 * kMiB), "a");
  spool.add(0, 1, 2 * kMiB);
  EXPECT_EQ(spool->stats().not_spooled, 1U);
  spool.add(1, 2, 2 * kMiB - kRecordHeadBytes);
  EXPECT_THAT(spool.take(1), ElementsAre(1));
}

TEST_F(SpoolTest, ADamagedFrameIsSkippedAndCounted) {
  { WatchedSpool(settings(), "a").add(0, 5); }
  const auto file = segments().front();
  auto content = read_file(file);
  content[content.size() - kFooterBytes - 2 * (1000 + kRecordHeadBytes) - 1] ^= 1;  // the end of 2
  write_file(file, content);
  const CapturedLog log;
  WatchedSpool spool(settings(), "b");
  EXPECT_THAT(spool.take(4), ElementsAre(0, 1, 3, 4));
  EXPECT_EQ(spool->stats().damaged, 1U);
  EXPECT_EQ(spool->stats().frames, 4U);
  EXPECT_THAT(log.lines("damaged").front(), HasSubstr("frame 2"));
  spool->acknowledge(4);
  EXPECT_THAT(spool->held(), IsEmpty());
}

TEST_F(SpoolTest, AFrameWithADamagedHeadIsCountedAsWell) {
  { WatchedSpool(settings(), "a").add(0, 5); }
  const auto file = segments().front();
  auto content = read_file(file);
  content[content.size() - kFooterBytes - 3 * (1000 + kRecordHeadBytes)] ^= 1;  // the begin of 2
  write_file(file, content);
  WatchedSpool spool(settings(), "b");
  EXPECT_THAT(spool->held(), ElementsAre(Held{"a", 4, 0}));
  EXPECT_EQ(spool->stats().damaged, 1U);
  EXPECT_THAT(spool.take(4), ElementsAre(0, 1, 3, 4));
}

TEST_F(SpoolTest, ASegmentThatDisappearsCostsItsFrames) {
  { WatchedSpool(settings(), "a").add(0, 12, kLarge); }
  WatchedSpool spool(settings(), "b");
  std::filesystem::remove(segments().at(1));
  EXPECT_THAT(spool.take(7), ElementsAre(0, 1, 2, 3, 4, 10, 11));
  EXPECT_EQ(spool->stats().damaged, 5U);
}

TEST_F(SpoolTest, ADamagedCursorOnlyRepeatsFrames) {
  {
    WatchedSpool spool(settings(), "a");
    spool.add(0, 12, kLarge);
    spool.take(7);
    spool->acknowledge(7);
  }
  write_file(path() / "robot.cursor", "nothing of the kind, but long enough");
  WatchedSpool spool(settings(), "b");
  EXPECT_EQ(spool.take(7), numbers(5, 12));  // from the begin of the segment
}

TEST_F(SpoolTest, OtherFilesAreLeftAlone) {
  std::filesystem::create_directories(path());
  for (const char* const name : {"README", "1.segment", "x.segment", "000000000001.segment.old"}) {
    write_file(path() / name, "mine");
  }
  {
    WatchedSpool spool(settings(4 * kMiB), "a");
    spool.add(0, 40, kLarge);
  }
  for (const char* const name : {"README", "1.segment", "x.segment", "000000000001.segment.old"}) {
    EXPECT_EQ(read_file(path() / name), "mine");
  }
}

TEST_F(SpoolTest, ASegmentThatIsNotOneTakesRoomOnly) {
  std::filesystem::create_directories(path());
  write_file(path() / "000000000001.segment", std::string(1000, 'x'));
  write_file(path() / "000000000002.segment", "");
  WatchedSpool spool(settings(), "a");
  EXPECT_EQ(spool->stats().bytes, 1000U);
  spool.add(0, 1);
  EXPECT_THAT(spool.take(1), ElementsAre(0));
  EXPECT_EQ(segments().back(), path() / "000000000003.segment");
}

TEST_F(SpoolTest, TwoProcessesCannotShareAFolder) {
  WatchedSpool spool(settings(), "a");
  try {
    WatchedSpool other(settings(), "b");
    FAIL() << "both have it";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr(path().string()));
    EXPECT_THAT(error.what(), HasSubstr("another orbbufd uses it"));
  }
}

TEST_F(SpoolTest, AFileInPlaceOfTheFolderIsAnError) {
  write_file(path(), "a file");
  EXPECT_THROW(WatchedSpool(settings(), "a"), std::runtime_error);
}

TEST_F(SpoolTest, TheRateLimitsWhatIsWritten) {
  SpoolSettings slow = settings();
  slow.rate_bytes_per_s = 500'000;
  WatchedSpool spool(slow, "a");
  const auto begin = std::chrono::steady_clock::now();
  spool.add(0, 6, kLarge);  // 1.2 MB, of which 0.7 MB may come at once
  EXPECT_EQ(spool.take(6), numbers(0, 6));
  EXPECT_GT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(900));
}

/// A disk of 2 MiB.
class SmallDisk {
 public:
  explicit SmallDisk(std::filesystem::path path) : path_(std::move(path)) {
    std::filesystem::create_directories(path_);
    is_mounted_ = ::mount("tmpfs", path_.c_str(), "tmpfs", 0, "size=2m") == 0;
  }
  ~SmallDisk() {
    if (is_mounted_) ::umount2(path_.c_str(), MNT_DETACH);
  }
  bool is_mounted() const { return is_mounted_; }

 private:
  std::filesystem::path path_;
  bool is_mounted_ = false;
};

TEST_F(SpoolTest, AFullDiskCostsOneLineAndIsTriedAgain) {
  const SmallDisk disk(path());
  if (!disk.is_mounted()) GTEST_SKIP() << "cannot mount a tmpfs (not root?)";
  const CapturedLog log;
  write_file(path() / "other", std::string(kMiB, 'x'));
  WatchedSpool spool(settings(), "a");
  spool.add(0, 12, kLarge);
  log.wait_for("error spool: cannot write");
  EXPECT_THAT(log.lines("error").front(), HasSubstr("No space left on device"));
  EXPECT_EQ(spool->stats().frames, 12U);  // they wait
  spool.add(12, 100, kLarge);
  EXPECT_EQ(spool->stats().not_spooled, 100 - spool->stats().frames);
  EXPECT_EQ(spool.take(4), numbers(0, 4));
  std::filesystem::remove(path() / "other");
  EXPECT_EQ(spool.take(3), numbers(4, 7));
  log.wait_for("takes frames again");
  spool->acknowledge(7);
  EXPECT_EQ(spool.take(3), numbers(7, 10));
  EXPECT_LE(log.lines("error").size(), 2U);
}

TEST_F(SpoolTest, TwoThreadsGetAlong) {
  WatchedSpool spool(settings(8 * kMiB), "a");
  std::uint64_t acknowledged = 0;
  for (Sequence sequence = 0; sequence < 2000; ++sequence) {
    spool->add(spool_frame(sequence, 20'000));
    if (sequence % 7 == 0) spool->forget(sequence);
    if (sequence % 3 == 0 && spool->next()) {
      ++acknowledged;
      spool->acknowledge(1);
    }
    if (sequence % 100 == 0) spool->rewind();
    if (sequence % 50 == 0) spool->stats();
  }
  EXPECT_LE(spool->stats().frames + acknowledged, 2000U);
}

}  // namespace
}  // namespace orbbuf::test
