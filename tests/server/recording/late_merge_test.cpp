// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_merge.hpp"

#include <gtest/gtest.h>

#include <map>
#include <set>
#include <string>
#include <vector>

#include "server/recording/late_files.hpp"
#include "server/recording/mcap/recording.hpp"
#include "server/recording/mcap/scan.hpp"
#include "server/recording/session_files.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::as_text;
using test::plain_frame;
using test::plain_pair;
using test::read_file;

const std::string kPinhole = "Pinhole 100 101 80 60 0\n160 120\nnone\n160 120\n";

class LateMergeTest : public testing::Test {
 protected:
  /// 60 numbers, of which the live stream has passed over 5 to 10 and the last three. All of these
  /// have come late but number 5; number 6 is a pair.
  void record(bool has_mcap) {
    SessionFiles files(folder_, kPinhole);
    mcap::Recording recording(folder_ / "s1.mcap", {"r1", "s1", kPinhole});
    wire::Dropped dropped;
    const auto write = [&](SessionRecord& record, const EncodedFrame& frame) {
      EXPECT_FALSE(record.write(frame));
    };
    for (Sequence i = 0; i < 57; ++i) {
      if (i >= 5 && i < 11) {
        dropped.records.push_back({i, plain_frame(i).capture_time_ns, DropReason::kPolicy});
        continue;
      }
      if (has_mcap) write(recording, plain_frame(i));
      write(files, plain_frame(i));
    }
    for (Sequence i = 57; i < 60; ++i) {
      dropped.records.push_back({i, plain_frame(i).capture_time_ns, DropReason::kShutdown});
    }
    SessionClosing closing{true, wire::Stats{60, 0, 0, 9, 51, 0, 0}};
    if (has_mcap) {
      EXPECT_FALSE(recording.write_drops(dropped));
      EXPECT_FALSE(recording.finish(closing));
    }
    EXPECT_FALSE(files.write_drops(dropped));
    EXPECT_FALSE(files.finish(closing));
    LateFiles late(folder_);
    for (Sequence i = 59; i >= 57; --i) write_late(late, plain_frame(i));
    for (Sequence i = 7; i < 11; ++i) {
      EncodedFrame frame = plain_frame(i);
      frame.quality = i < 9 ? 80 : 0;
      write_late(late, frame);
    }
    write_late(late, plain_pair(6, 50, 70));
  }

  static void write_late(LateFiles& late, const EncodedFrame& frame) {
    const auto is_new = late.write(frame, 1'000'000'000);
    ASSERT_TRUE(is_new) << is_new.error().text;
    EXPECT_TRUE(is_new.value());
  }

  /// A merge that is ended at its change number `changes`; -1: it is not.
  MergedLate merge(int changes = -1) const {
    const auto merged = merge_late(folder_, [&] { return changes < 0 || changes-- > 0; });
    EXPECT_TRUE(merged) << merged.error().text;
    return merged ? merged.value() : MergedLate{};
  }

  /// All files but the recording, which may differ by its chunks, and what nobody reads.
  std::map<std::string, std::string> tree() const {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_)) {
      const std::string name = entry.path().lexically_relative(folder_);
      if (name == "s1.mcap") continue;
      files[name] = entry.is_directory() ? "/" : read_file(entry.path());
    }
    return files;
  }

  struct Recorded {
    std::multiset<Sequence> frames;
    std::multiset<Sequence> calibrations;
    std::multiset<Sequence> drops;
    std::multiset<Sequence> qualities;
    friend bool operator==(const Recorded&, const Recorded&) = default;
  };
  /// What our own scan finds: of every message the number, by the times of all frames.
  Recorded recorded(Sequence last = 59) const {
    const auto none = [](const mcap::MessageHead&) { return false; };
    const auto contents = mcap::scan(folder_ / "s1.mcap", "orbbuf-server", none);
    EXPECT_TRUE(contents);
    std::set<std::uint64_t> times;
    for (Sequence i = 0; i <= last; ++i) {
      times.insert(static_cast<std::uint64_t>(plain_frame(i).capture_time_ns));
    }
    const auto messages = mcap::messages_at(folder_ / "s1.mcap", contents.value(), times);
    EXPECT_TRUE(messages);
    Recorded recorded;
    for (const mcap::MessageHead& head : messages.value()) {
      if (head.channel_id == 7) {
        recorded.drops.insert(head.sequence);
      } else if (head.channel_id == 8) {
        recorded.qualities.insert(head.sequence);
      } else if (head.channel_id == 1 || head.channel_id == 3 || head.channel_id == 5) {
        recorded.frames.insert(head.sequence);
      } else {
        recorded.calibrations.insert(head.sequence);
      }
    }
    return recorded;
  }
  /// Number 5 never came.
  static Recorded everything() {
    Recorded all;
    for (Sequence i = 0; i < 60; ++i) {
      if (i != 5) all.frames.insert(i);
      if (i != 5) all.calibrations.insert(i);
    }
    all.frames.insert(6);  // both images of the pair
    for (Sequence i = 0; i < 9; ++i) all.drops.insert(i);
    all.qualities = {7, 8};
    return all;
  }

  test::TemporaryFolder parent_;
  fs::path folder_ = parent_ / "r1" / "s1";
};

TEST_F(LateMergeTest, PutsEachFrameWhereItBelongs) {
  record(false);
  const auto drops = test::read_lines(folder_ / "drops.csv").size();
  const auto late = read_file(folder_ / "late.csv");
  const auto merged = merge();
  EXPECT_EQ(merged.frames, 8U);
  EXPECT_EQ(merged.missing, 0U);
  EXPECT_TRUE(merged.is_complete);
  const auto times = test::read_lines(folder_ / "times.txt");
  ASSERT_EQ(times.size(), 59U);
  EXPECT_EQ(times[5], "6 0.240000000 8.500000");
  EXPECT_EQ(times[58], "59 2.360000000 8.500000");
  EXPECT_EQ(read_file(folder_ / "images/000006.jpg"), as_text(plain_pair(6, 50, 70).left()));
  EXPECT_EQ(read_file(folder_ / "images_right/000006.jpg"), as_text(plain_pair(6, 50, 70).right()));
  EXPECT_EQ(read_file(folder_ / "images/000059.jpg"), as_text(plain_frame(59).jpeg));
  const auto record = test::read_lines(folder_ / "drops.csv");
  EXPECT_EQ(record.size(), drops);
  EXPECT_EQ(record[1], "5,policy,0.200000000");
  EXPECT_EQ(record[2], "6,late,0.240000000");
  EXPECT_EQ(record[9], "59,late,2.360000000");
  EXPECT_EQ(read_file(folder_ / "late.csv"), late);
  EXPECT_EQ(read_file(folder_ / "quality.csv"),
            "sequence,quality,whole_bytes,whole_crc\n7,80,0,00000000\n8,80,0,00000000\n");
  EXPECT_FALSE(fs::exists(folder_ / "late"));
  EXPECT_FALSE(fs::exists(folder_ / "orphans"));
}

TEST_F(LateMergeTest, WhereverItIsEndedTheNextOneCompletesIt) {
  record(true);
  const fs::path original = parent_ / "original";
  fs::copy(folder_, original, fs::copy_options::recursive);
  merge();
  const auto expected = tree();
  ASSERT_EQ(recorded(), everything());
  int changes = 0;
  for (bool is_complete = false; !is_complete; ++changes) {
    fs::remove_all(folder_);
    fs::copy(original, folder_, fs::copy_options::recursive);
    is_complete = merge(changes).is_complete;
    EXPECT_EQ(fs::exists(folder_ / "late"), !is_complete);
    EXPECT_TRUE(merge().is_complete);
    ASSERT_EQ(tree(), expected) << "ended at change " << changes;
    ASSERT_EQ(recorded(), everything()) << "ended at change " << changes;
  }
  EXPECT_GT(changes, 20);  // 8 frames, 9 images, and the lists
}

TEST_F(LateMergeTest, WhereverItIsEndedTheSessionMayBeOpenedForItsLastDropRecords) {
  record(true);
  const fs::path original = parent_ / "original";
  fs::copy(folder_, original, fs::copy_options::recursive);
  const auto name_one_more = [&] {
    SessionFiles files(folder_, kPinhole);
    mcap::Recording recording(folder_ / "s1.mcap", {"r1", "s1", kPinhole});
    const auto position = files.recover();
    ASSERT_TRUE(position);
    EXPECT_EQ(position.value(), (wire::Position{57, 9}));
    ASSERT_TRUE(recording.recover(position.value()));
    ASSERT_FALSE(recording.take_missed(folder_, position.value()));
    const wire::Dropped last{9, {{60, plain_frame(60).capture_time_ns, DropReason::kUnknown}}};
    EXPECT_FALSE(recording.write_drops(last));
    EXPECT_FALSE(files.write_drops(last));
    SessionClosing closing{true, std::nullopt};
    EXPECT_FALSE(files.finish(closing));
    EXPECT_FALSE(recording.finish(closing));
  };
  name_one_more();
  merge();
  const auto expected = tree();
  auto all = everything();
  all.drops.insert(9);
  int changes = 0;
  for (bool is_complete = false; !is_complete; ++changes) {
    fs::remove_all(folder_);
    fs::copy(original, folder_, fs::copy_options::recursive);
    is_complete = merge(changes).is_complete;
    name_one_more();
    EXPECT_TRUE(merge().is_complete);
    ASSERT_EQ(tree(), expected) << "ended at change " << changes;
    EXPECT_TRUE(closing_from_csv(read_file(folder_ / "end.csv"))->has_ended);
    ASSERT_EQ(recorded(60), all) << "ended at change " << changes;
  }
}

TEST_F(LateMergeTest, WithoutLateFramesNothingHappens) {
  int asked = 0;
  const auto merged = merge_late(folder_, [&] { return ++asked > 0; });
  ASSERT_TRUE(merged);
  EXPECT_EQ(merged.value().frames, 0U);
  EXPECT_TRUE(merged.value().is_complete);
  record(false);
  merge();
  const auto before = tree();
  EXPECT_TRUE(merge_late(folder_, [&] { return ++asked > 0; }).value().is_complete);
  EXPECT_EQ(asked, 0);
  EXPECT_EQ(tree(), before);
}

TEST_F(LateMergeTest, WhatComesAfterAMergeIsMergedByTheNext) {
  record(true);
  merge();
  LateFiles late(folder_);
  write_late(late, plain_frame(5));
  EXPECT_EQ(merge().frames, 1U);
  auto all = everything();
  all.frames.insert(5);
  all.calibrations.insert(5);
  EXPECT_EQ(recorded(), all);
  const auto times = test::read_lines(folder_ / "times.txt");
  ASSERT_EQ(times.size(), 60U);
  EXPECT_EQ(times[5], "5 0.200000000 8.500000");
  EXPECT_EQ(test::read_lines(folder_ / "drops.csv").at(1), "5,late,0.200000000");
  EXPECT_EQ(test::read_lines(folder_ / "drops.csv").at(2), "6,late,0.240000000");
}

TEST_F(LateMergeTest, ASessionMayConsistOfLateFramesOnly) {
  LateFiles late(folder_);
  for (const Sequence number : {8U, 2U, 5U}) write_late(late, plain_frame(number));
  EXPECT_EQ(merge().frames, 3U);
  EXPECT_EQ(read_file(folder_ / "times.txt"),
            "2 0.080000000 8.500000\n5 0.200000000 8.500000\n8 0.320000000 8.500000\n");
  EXPECT_EQ(test::read_lines(folder_ / "checksums.sfv").size(), 3U);
  EXPECT_FALSE(fs::exists(folder_ / "drops.csv"));
  EXPECT_FALSE(fs::exists(folder_ / "s1.mcap"));
  EXPECT_EQ(SessionFiles(folder_, "").recover().value(), wire::Position{});
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 3U);
}

TEST_F(LateMergeTest, ASessionWithoutChecksumsStaysWithout) {
  record(false);
  fs::remove(folder_ / "checksums.sfv");
  EXPECT_EQ(merge().frames, 8U);
  EXPECT_FALSE(fs::exists(folder_ / "checksums.sfv"));
  EXPECT_EQ(SessionFiles(folder_, "").recover().value(), (wire::Position{57, 9}));
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 59U);
}

TEST_F(LateMergeTest, AFrameThatIsNotAsItCameIsSetAside) {
  const test::CapturedLog log;
  record(false);
  LateFiles late(folder_);
  for (Sequence i = 1000; i < 1256; ++i) write_late(late, plain_frame(i));
  test::write_file(folder_ / "late/images/000008.jpg", "broken");
  const auto merged = merge();
  EXPECT_EQ(merged.frames, 7U + 256);
  EXPECT_EQ(merged.missing, 1U);
  EXPECT_FALSE(fs::exists(folder_ / "images/000008.jpg"));
  EXPECT_EQ(read_file(folder_ / "orphans/late/images/000008.jpg"), "broken");
  EXPECT_EQ(test::read_lines(folder_ / "drops.csv").at(4), "8,policy,0.320000000");
  EXPECT_EQ(log.lines("1 late frames are not as they came").size(), 1U);
  EXPECT_EQ(SessionFiles(folder_, "").recover().value(), (wire::Position{57, 9}));
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 58U + 256);
}

TEST_F(LateMergeTest, AnImageOfAFrameThatWasNotAcceptedIsSetAside) {
  record(false);
  test::write_file(folder_ / "late/images/000099.jpg", "whole, without a line");
  test::write_file(folder_ / "late/incoming.tmp", "torn");
  test::write_file(folder_ / "late/times.txt", "of a merge that was killed");
  EXPECT_EQ(merge().frames, 8U);
  EXPECT_FALSE(fs::exists(folder_ / "images/000099.jpg"));
  EXPECT_EQ(read_file(folder_ / "orphans/late/images/000099.jpg"), "whole, without a line");
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 59U);
}

TEST_F(LateMergeTest, WhatTheLiveStreamLeftHalfWrittenGivesWay) {
  record(false);
  test::write_file(folder_ / "images/000057.jpg", "half");
  merge();
  EXPECT_EQ(read_file(folder_ / "images/000057.jpg"), as_text(plain_frame(57).jpeg));
}

TEST_F(LateMergeTest, OnAFullDiskNothingIsLost) {
  record(true);
  for (const rlim_t limit : {100U, 1500U, 3000U, 9000U}) {
    {
      const test::ResourceLimit full(RLIMIT_FSIZE, limit);
      EXPECT_FALSE(merge_late(folder_));
    }
    EXPECT_TRUE(fs::exists(folder_ / "late"));
  }
  EXPECT_TRUE(merge().is_complete);
  EXPECT_EQ(recorded(), everything());
  EXPECT_EQ(test::read_lines(folder_ / "times.txt").size(), 59U);
  EXPECT_EQ(test::read_lines(folder_ / "checksums.sfv").size(), 60U);
}

TEST_F(LateMergeTest, AListWithAForeignLineIsNotReplaced) {
  record(false);
  const auto times = "# my notes\n" + read_file(folder_ / "times.txt");
  test::write_file(folder_ / "times.txt", times);
  const auto merged = merge_late(folder_);
  ASSERT_FALSE(merged);
  EXPECT_NE(merged.error().text.find("\"# my notes\" is not SEQUENCE"), std::string::npos);
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_TRUE(fs::exists(folder_ / "late"));
}

TEST_F(LateMergeTest, AMergedSessionIsOpenedAsItWas) {
  const test::CapturedLog log;
  record(true);
  merge();
  const auto before = tree();
  SessionFiles files(folder_, kPinhole);
  EXPECT_EQ(files.recover().value(), (wire::Position{57, 9}));
  mcap::Recording recording(folder_ / "s1.mcap", {"r1", "s1", kPinhole});
  EXPECT_EQ(recording.recover(wire::Position{57, 9}).value(), (wire::Position{60, 9}));
  EXPECT_EQ(tree(), before);
  EXPECT_EQ(recorded(), everything());
  EXPECT_TRUE(log.lines("s1").empty());
}

}  // namespace
}  // namespace orbbuf
