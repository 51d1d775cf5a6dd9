// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/session_log.hpp"

#include <gtest/gtest.h>

#include <optional>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

constexpr const char* kHead = "sequence,reason,capture_time_s\n";

std::vector<DropRecord> policy_drops(Sequence first, std::size_t count) {
  std::vector<DropRecord> all;
  for (std::size_t i = 0; i < count; ++i) all.push_back({first + i, 0, DropReason::kPolicy});
  return all;
}

/// A process that ends after 10 frames, of which the server has confirmed 7 and no drop record.
void die_in_session(const std::filesystem::path& folder, const std::string& session) {
  SessionLog log(folder, "r", session);
  log.add(policy_drops(7, 1));
  log.note(10, 9000, {7, 0});
}

TEST(SessionLog, RecordsAreWrittenAsTheServerWritesThem) {
  const test::TemporaryFolder folder;
  { SessionLog(folder / "drops", "r", "s").add(policy_drops(7, 1)); }
  EXPECT_EQ(test::read_file(folder / "drops/s.csv"), std::string(kHead) + "7,policy,0.000000000\n");
}

TEST(SessionLog, StateIsReadBack) {
  const SessionState state{SessionState::Stage::kEnded, "tb3", 500, 1'640'000'000'000, {450, 12}};
  EXPECT_EQ(state_from_csv(to_csv(state)), state);
  EXPECT_EQ(to_csv(state).size(), to_csv({SessionState::Stage::kOpen, "tb3", 0, 0, {}}).size());
  EXPECT_EQ(state_from_csv(""), std::nullopt);
  EXPECT_EQ(state_from_csv(to_csv(state).substr(0, 70)), std::nullopt);
}

TEST(SessionLog, NextStartFindsWhatTheServerDidNotConfirm) {
  const test::TemporaryFolder folder;
  die_in_session(folder.path(), "s1");
  const SessionLog present(folder.path(), "r", "s2");
  const auto earlier = find_earlier_sessions(folder.path());
  ASSERT_EQ(earlier.size(), 1U);
  EXPECT_EQ(describe(earlier[0]),
            "session s1 ended with frames 7 to 9 and 1 drop records not confirmed by the server: "
            "see " +
                (folder / "s1.csv").string());
  EXPECT_EQ(earlier[0].records, policy_drops(7, 1));
  settle(earlier[0]);
  EXPECT_TRUE(find_earlier_sessions(folder.path()).empty());
}

TEST(SessionLog, SessionThatTheServerHasWholeIsNotReported) {
  const test::TemporaryFolder folder;
  {
    SessionLog log(folder.path(), "r", "s");
    log.note(10, 9000, {10, 0});
    log.end(true);
  }
  EXPECT_TRUE(find_earlier_sessions(folder.path()).empty());
}

TEST(SessionLog, LineThatWasWrittenInPartIsNoRecord) {
  const test::TemporaryFolder folder;
  die_in_session(folder.path(), "s");
  test::write_file(folder / "s.csv", std::string(kHead) + "7,policy,0.000000000\n8,policy,0.0000");
  EXPECT_EQ(find_earlier_sessions(folder.path()).at(0).records, policy_drops(7, 1));
}

TEST(SessionLog, SessionThatLivesIsNeitherReportedNorRemoved) {
  const test::TemporaryFolder folder;
  const SessionLog alive(folder.path(), "r", "alive");
  for (std::size_t i = 0; i < SessionLog::kMostSessions + 3; ++i) {
    die_in_session(folder.path(), "s" + std::to_string(i));
  }
  EXPECT_TRUE(exists(folder / "alive.csv"));
  EXPECT_EQ(find_earlier_sessions(folder.path()).size(), SessionLog::kMostSessions);
  EXPECT_FALSE(exists(folder / "s0.csv"));
}

TEST(SessionLog, OtherFilesInTheFolderAreLeftAlone) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "notes.csv", "mine");
  for (std::size_t i = 0; i < SessionLog::kMostSessions + 3; ++i) {
    die_in_session(folder.path(), "s" + std::to_string(i));
  }
  EXPECT_EQ(test::read_file(folder / "notes.csv"), "mine");
}

TEST(SessionLog, OldSessionsAreRemovedByTheirSize) {
  const test::TemporaryFolder folder;
  die_in_session(folder.path(), "large");
  std::filesystem::resize_file(folder / "large.csv", SessionLog::kMostBytes + 1);
  const SessionLog present(folder.path(), "r", "present");
  EXPECT_FALSE(exists(folder / "large.csv"));
  EXPECT_TRUE(exists(folder / "present.csv"));
}

TEST(SessionLog, FileOfRecordsIsBounded) {
  const test::CapturedLog captured;
  const test::TemporaryFolder folder;
  {
    SessionLog log(folder.path(), "r", "s");
    log.add(policy_drops(0, SessionLog::kMostPending / 10));
    log.add(policy_drops(0, 1));
  }
  EXPECT_EQ(test::read_file(folder / "s.csv"), kHead);
  EXPECT_EQ(captured.lines("ends here").size(), 1U);
}

TEST(SessionLog, FolderThatCannotBeMadeIsAWarning) {
  const test::CapturedLog captured;
  {
    SessionLog log("/proc/nowhere", "r", "s");
    log.add(policy_drops(0, 1));
    log.note(1, 0, {});
  }
  EXPECT_EQ(captured.lines(),
            std::vector<std::string>{
                "warning cannot write the drop log /proc/nowhere/s.csv: No such file or directory; "
                "the robot keeps no drop log of this session"});
}

}  // namespace
}  // namespace orbbuf
