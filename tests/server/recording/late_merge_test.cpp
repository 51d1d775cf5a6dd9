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
    for (Sequence i = 7; i < 11; ++i) write_late(late, plain_frame(i));
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
    friend bool operator==(const Recorded&, const Recorded&) = default;
  };
  /// What our own scan finds: of every message the number, by the times of all frames.
  Recorded recorded() const {
    const auto none = [](const mcap::MessageHead&) { return false; };
    const auto contents = mcap::scan(folder_ / "s1.mcap", "orbbuf-server", none);
    EXPECT_TRUE(contents);
    std::set<std::uint64_t> times;
    for (Sequence i = 0; i < 60; ++i) {
      times.insert(static_cast<std::uint64_t>(plain_frame(i).capture_time_ns));
    }
    const auto messages = mcap::messages_at(folder_ / "s1.mcap", contents.value(), times);
    EXPECT_TRUE(messages);
    Recorded recorded;
    for (const mcap::MessageHead& head : messages.value()) {
      if (head.channel_id == 7) {
        recorded.drops.insert(head.sequence);
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

}  // namespace
}  // namespace orbbuf
