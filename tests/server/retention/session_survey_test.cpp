// SPDX-License-Identifier: Apache-2.0
#include "server/retention/session_survey.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

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

TEST_F(SurveyTest, MeasuresWhatDuDoesButForBlocks) {
  make_session(folder_.path(), "r/s", 300, std::chrono::hours(5));
  const auto sessions = found();
  ASSERT_EQ(sessions.size(), 1U);
  EXPECT_EQ(sessions[0].robot_id, "r");
  EXPECT_EQ(sessions[0].session_id, "s");
  const auto used = static_cast<double>(test::disk_usage(folder_ / "r/s"));
  EXPECT_NEAR(static_cast<double>(sessions[0].bytes), used, 0.05 * used);
  const auto age = std::chrono::system_clock::now() - sessions[0].last_write;
  EXPECT_NEAR(std::chrono::duration<double>(age).count(), 5 * 3600, 60);
}

TEST_F(SurveyTest, OfOneThatGrowsItAddsWhatIsNew) {
  make_session(folder_.path(), "r/s", 3);
  const auto before = found().at(0).bytes;
  const auto store = SessionStore::open(folder_ / "r/s", {"r", "s", "", {}}, Durability::kSecond);
  ASSERT_TRUE(store);
  ASSERT_FALSE(store.value()->write(test::plain_pair(3, 200'000, 10), 0));
  ASSERT_TRUE(store.value()->write_late(test::plain_pair(1000, 100'000, 10), 0));
  test::write_file(folder_ / "r/s/s.mcap", std::string(100'000, 'x'));
  const auto sessions = found();
  ASSERT_EQ(sessions.size(), 1U);
  EXPECT_NEAR(static_cast<double>(sessions[0].bytes), static_cast<double>(before + 400'000),
              20'000);
}

TEST_F(SurveyTest, ImagesThatAreRemovedForAPartDoNotCount) {
  make_session(folder_.path(), "r/s", 30);
  const auto store = SessionStore::open(folder_ / "r/s", {"r", "s", "", {}}, Durability::kSecond);
  ASSERT_TRUE(store);
  RecordedPart part{1, {}, store.value()->written(), true, 30 * 80'000};
  ASSERT_FALSE(store.value()->note_part(part));
  ASSERT_EQ(found().size(), 1U);
  EXPECT_LT(found()[0].bytes, 80'000U);
}

TEST_F(SurveyTest, APassGoesOnWhereItWasInterrupted) {
  make_session(folder_.path(), "r/s", 300);
  make_session(folder_.path(), "r/t", 300);
  survey_.begin();
  int steps = 1;
  while (!survey_.go_on(steady_clock::time_point::min())) {
    ASSERT_LT(++steps, 10'000) << "the pass does not end";
  }
  EXPECT_EQ(steps, 2);
  ASSERT_EQ(survey_.sessions().size(), 2U);
  EXPECT_GT(survey_.sessions()[1].bytes, 300 * 80'000U);
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
}

TEST_F(SurveyTest, FindsWhatWasSetAside) {
  make_session(folder_.path(), "r/s", 1);
  fs::rename(folder_ / "r/s", set_aside_folder(folder_ / "r", "s"));
  EXPECT_THAT(found(), IsEmpty());
  EXPECT_THAT(survey_.set_aside_folders(), ElementsAre(set_aside_folder(folder_ / "r", "s")));
}

}  // namespace
}  // namespace orbbuf
