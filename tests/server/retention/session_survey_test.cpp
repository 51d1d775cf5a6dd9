// SPDX-License-Identifier: Apache-2.0
#include "server/retention/session_survey.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include "server/recording/late_files.hpp"
#include "server/recording/late_merge.hpp"
#include "tests/server/retention/sessions_on_disk.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;
using test::make_session;
using testing::ElementsAre;
using testing::IsEmpty;

class SurveyTest : public testing::Test {
 protected:
  std::vector<KeptSession> found() {
    survey_.begin();
    EXPECT_TRUE(survey_.go_on(steady_clock::time_point::max()));
    return survey_.sessions();
  }

  test::TemporaryFolder folder_;
  SessionSurvey survey_{folder_.path()};
};

TEST_F(SurveyTest, MeasuresWhatDuDoes) {
  make_session(folder_.path(), "r/s", 300, std::chrono::hours(5));
  const auto sessions = found();
  ASSERT_EQ(sessions.size(), 1U);
  EXPECT_EQ(sessions[0].robot_id, "r");
  EXPECT_EQ(sessions[0].session_id, "s");
  EXPECT_EQ(sessions[0].bytes, test::disk_usage(folder_ / "r/s"));
  const auto age = std::chrono::system_clock::now() - sessions[0].last_write;
  EXPECT_NEAR(std::chrono::duration<double>(age).count(), 5 * 3600, 60);
}

TEST_F(SurveyTest, OfOneThatGrowsItAddsWhatIsNew) {
  make_session(folder_.path(), "r/s", 3);
  found();
  SessionFiles files(folder_ / "r/s", "");
  ASSERT_TRUE(files.recover());
  ASSERT_FALSE(files.write(test::plain_pair(3, 20'000, 10)));
  test::write_file(folder_ / "r/s/s.mcap", std::string(100'000, 'x'));
  fs::remove(folder_ / "r/s/images/000000.jpg");  // not looked at again
  const auto before = test::disk_usage(folder_ / "r/s");
  const auto sessions = found();
  ASSERT_EQ(sessions.size(), 1U);
  EXPECT_GT(sessions[0].bytes, before);
  EXPECT_LE(sessions[0].bytes, before + 8192);
}

TEST_F(SurveyTest, LateFramesCountBeforeAndAfterTheyAreMerged) {
  make_session(folder_.path(), "r/s", 300, std::chrono::hours(5));
  const auto measured = [&] {
    const auto sessions = found();
    return sessions.size() == 1 ? sessions[0].bytes : 0;
  };
  measured();
  LateFiles late(folder_ / "r/s");
  for (Sequence i = 400; i < 500; ++i) {
    ASSERT_TRUE(late.write(test::plain_pair(i, 5000, 3000), 0));
    if (i == 450) measured();
  }
  // The folders in late/ are not counted.
  EXPECT_NEAR(static_cast<double>(measured()),
              static_cast<double>(test::disk_usage(folder_ / "r/s")), 3 * 16'384);
  EXPECT_GT(measured(), 400 * 8192U);
  EXPECT_LT(std::chrono::system_clock::now() - found()[0].last_write, std::chrono::hours(1));
  ASSERT_TRUE(merge_late(folder_ / "r/s"));
  EXPECT_EQ(measured(), test::disk_usage(folder_ / "r/s"));
}

TEST_F(SurveyTest, ASessionOfLateFramesOnlyIsASession) {
  LateFiles late(folder_ / "r/s");
  ASSERT_TRUE(late.write(test::plain_frame(3), 0));
  EXPECT_EQ(found().size(), 1U);
}

TEST_F(SurveyTest, APassGoesOnWhereItWasInterrupted) {
  make_session(folder_.path(), "r/s", 300);
  make_session(folder_.path(), "r/t", 300);
  survey_.begin();
  int steps = 1;
  while (!survey_.go_on(steady_clock::time_point::min())) {
    ASSERT_LT(++steps, 10'000) << "the pass does not end";
  }
  EXPECT_GT(steps, 4);
  ASSERT_EQ(survey_.sessions().size(), 2U);
  EXPECT_EQ(survey_.sessions()[1].bytes, test::disk_usage(folder_ / "r/t"));
}

TEST_F(SurveyTest, WhatIsGoneIsForgotten) {
  make_session(folder_.path(), "r/s", 1);
  EXPECT_EQ(found().size(), 1U);
  fs::remove_all(folder_ / "r/s");
  EXPECT_THAT(found(), IsEmpty());
  fs::remove_all(folder_.path());
  EXPECT_THAT(found(), IsEmpty());
}

TEST_F(SurveyTest, OnlyRecordingsAreSessions) {
  const test::TemporaryFolder elsewhere;
  make_session(elsewhere.path(), "s", 1);
  make_session(folder_.path(), "r/-s", 1);
  fs::create_directories(folder_ / "photos" / "2019");
  test::write_file(folder_ / "photos/2019/one.jpg", "mine");
  test::write_file(folder_ / "photos/times.txt", "mine");
  ASSERT_EQ(::symlink((elsewhere / "s").c_str(), (folder_ / "photos/link").c_str()), 0);
  EXPECT_THAT(found(), IsEmpty());
  fs::create_directories(folder_ / "r/m");
  test::write_file(folder_ / "r/m/m.mcap", "a recording");
  EXPECT_EQ(found().size(), 1U);
}

TEST_F(SurveyTest, FindsWhatWasSetAside) {
  make_session(folder_.path(), "r/s", 1);
  fs::rename(folder_ / "r/s", set_aside_folder(folder_ / "r", "s"));
  EXPECT_THAT(found(), IsEmpty());
  EXPECT_THAT(survey_.set_aside_folders(), ElementsAre(set_aside_folder(folder_ / "r", "s")));
}

}  // namespace
}  // namespace orbbuf
