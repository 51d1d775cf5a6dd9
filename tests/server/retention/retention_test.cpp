// SPDX-License-Identifier: Apache-2.0
#include "server/retention/retention.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <future>
#include <set>

#include "testing/captured_log.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/retention/sessions_on_disk.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using std::chrono::hours;
using std::chrono::minutes;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class RetentionTest : public test::EventLoop {
 protected:
  ~RetentionTest() override {
    stop();
    files_.join();
    run_ready();
  }

  void make(const std::string& name, hours age, Sequence frames = 3) const {
    test::make_session(folder_.path(), name, frames, age);
  }
  void start(const Quota& quota) {
    retention_ = std::make_shared<Retention>(
        main_, files_,
        Retention::Options{folder_.path(), quota, minutes(10), interval_,
                           [this] {
                             ++clock_reads_;
                             SystemClockReading now = read_system_clock();
                             now.is_synchronised = is_synchronised_;
                             return now;
                           }},
        [this](const std::string& robot, const std::string& session) {
          ++asked_;
          return open_.contains(robot + "/" + session);
        });
    retention_->start();
  }
  void stop() {
    if (retention_) retention_->stop();
    retention_.reset();
  }
  /// ROBOT/SESSION of all that is there. Asks the folders only: what they name may go at any
  /// moment.
  std::vector<std::string> left() const {
    std::vector<std::string> names;
    for (const auto& robot : fs::directory_iterator(folder_.path())) {
      for (const auto& session : fs::directory_iterator(robot)) {
        names.push_back(session.path().lexically_relative(folder_.path()));
      }
    }
    std::ranges::sort(names);
    return names;
  }
  bool run_until_left(const std::vector<std::string>& names) {
    return run_until([&] { return left() == names; });
  }
  /// Some passes more, in which nothing may change.
  bool run_some_passes() {
    const int before = asked_;
    return run_until([&] { return asked_ > before + 20; });
  }
  Quota size_of(int sessions) const {
    return {.bytes = static_cast<std::uint64_t>(sessions) * test::disk_usage(folder_ / "r/a")};
  }

  test::TemporaryFolder folder_;
  test::CapturedLog log_;
  std::set<std::string> open_;
  int asked_ = 0;
  int clock_reads_ = 0;
  bool is_synchronised_ = true;
  std::chrono::nanoseconds interval_ = std::chrono::milliseconds(1);
  std::shared_ptr<Retention> retention_;
};

TEST_F(RetentionTest, RemovesTheOldestSessionsOfEachRobot) {
  for (const char* robot : {"r", "q"}) {
    make(std::string(robot) + "/b", hours(3));
    make(std::string(robot) + "/a", hours(4));
    make(std::string(robot) + "/d", hours(1));
    make(std::string(robot) + "/c", hours(2));
  }
  make("p/a", hours(9));
  start(size_of(2));
  ASSERT_TRUE(run_until_left({"p/a", "q/c", "q/d", "r/c", "r/d"}));
  stop();
  EXPECT_EQ(log_.lines("removed").size(), 4U);
  EXPECT_THAT(log_.lines("r a: removed, "),
              ElementsAre(HasSubstr("MiB, last written to 4.0 h ago: over files.keep_size")));
}

TEST_F(RetentionTest, RemovesWhatIsTooOld) {
  make("r/a", hours(100));
  make("r/b", hours(99));
  make("q/a", hours(50));
  start({.age = hours(72)});
  ASSERT_TRUE(run_until_left({"q/a"}));
  stop();
  EXPECT_THAT(log_.lines("r b: removed"), ElementsAre(HasSubstr("over files.keep_time")));
}

TEST_F(RetentionTest, RemovesNothingByAgeWhenTheClockMayBeWrong) {
  is_synchronised_ = false;
  make("r/a", hours(60 * 24 + 2));
  make("r/b", hours(60 * 24 + 1));
  make("r/c", hours(60 * 24));
  start({.age = hours(72)});
  ASSERT_TRUE(run_until([&] { return clock_reads_ > 20; }));
  EXPECT_THAT(left(), ElementsAre("r/a", "r/b", "r/c"));
  EXPECT_THAT(log_.lines("the clock may be wrong"), ElementsAre(HasSubstr("or it is 1440.")));
  is_synchronised_ = true;
  EXPECT_TRUE(run_until_left({}));
}

TEST_F(RetentionTest, TheSizeCountsWhateverTheClockSays) {
  is_synchronised_ = false;
  make("r/a", hours(60 * 24 + 2));
  make("r/b", hours(60 * 24 + 1));
  Quota quota = size_of(1);
  quota.age = hours(72);
  start(quota);
  ASSERT_TRUE(run_until_left({"r/b"}));
  stop();
  EXPECT_THAT(log_.lines("r a: removed"), ElementsAre(HasSubstr("over files.keep_size")));
}

TEST_F(RetentionTest, NeverRemovesAnOpenSession) {
  make("r/a", hours(4));
  make("r/b", hours(3));
  make("r/c", hours(2));
  open_ = {"r/a"};
  start(size_of(1));
  ASSERT_TRUE(run_until_left({"r/a", "r/c"}));
  ASSERT_TRUE(run_some_passes());
  EXPECT_THAT(left(), ElementsAre("r/a", "r/c"));
  open_.clear();
  EXPECT_TRUE(run_until_left({"r/c"}));
}

TEST_F(RetentionTest, AfterARestartTheNewestMayBeContinuedForAWhile) {
  make("r/a", hours(0));
  make("q/a", hours(1));
  start({.age = std::chrono::milliseconds(1)});
  ASSERT_TRUE(run_until_left({"r/a"}));
  ASSERT_TRUE(run_some_passes());
  EXPECT_THAT(left(), ElementsAre("r/a"));
  make("r/b", hours(0));
  EXPECT_TRUE(run_until_left({"r/b"}));
}

TEST_F(RetentionTest, FinishesWhatAnotherServerHadBegunToRemove) {
  make("r/a", hours(1));
  make("r/b", hours(1));
  fs::rename(folder_ / "r/b", set_aside_folder(folder_ / "r", "b"));
  fs::create_directories(set_aside_folder(folder_ / "r", "c") / "images");
  start({.age = hours(5)});
  EXPECT_TRUE(run_until_left({"r/a"}));
}

TEST_F(RetentionTest, SeesASessionGrow) {
  make("r/a", hours(4));
  make("r/b", hours(0));
  open_ = {"r/b"};
  start(size_of(3));
  const auto store = SessionStore::open(folder_ / "r/b", {"r", "s", "", {}}, Durability::kSecond);
  ASSERT_TRUE(store);
  for (Sequence sequence = 3; sequence < 20; ++sequence) {
    ASSERT_FALSE(store.value()->write(test::plain_pair(sequence, 50'000, 30'000), 0));
  }
  EXPECT_TRUE(run_until_left({"r/b"}));
}

TEST_F(RetentionTest, LooksAtOnceWhenItIsWoken) {
  interval_ = hours(100);
  make("r/a", hours(4));
  make("r/b", hours(2));
  start(size_of(1));
  ASSERT_TRUE(run_until_left({"r/b"}));
  make("r/c", hours(1));
  ASSERT_TRUE(run_until([&] {
    retention_->wake();  // nothing, until the first pass is over
    return left() == std::vector<std::string>{"r/c"};
  }));
}

TEST_F(RetentionTest, FramesAreWrittenWhileALargeSessionGoes) {
  make("r/a", hours(4), 2000);
  make("r/b", hours(1));
  start({.bytes = 1});
  const fs::path going = set_aside_folder(folder_ / "r", "a");
  ASSERT_TRUE(run_until([&] { return fs::exists(going); }));
  std::promise<bool> is_there;  // what a frame that is written now waits for
  boost::asio::post(files_, [&] { is_there.set_value(fs::exists(going)); });
  EXPECT_TRUE(is_there.get_future().get());
  EXPECT_TRUE(run_until_left({"r/b"}));
}

TEST_F(RetentionTest, WhatCannotBeRemovedIsSaidOnce) {
  make("r/a", hours(4));
  test::write_file(set_aside_folder(folder_ / "r", "a"), "in the way");
  make("r/b", hours(1));
  start({.bytes = 1});
  ASSERT_TRUE(run_some_passes());
  stop();
  EXPECT_THAT(left(), ElementsAre("r/.removed-a", "r/a", "r/b"));
  EXPECT_EQ(log_.lines("r/a: ").size(), 1U);
}

TEST_F(RetentionTest, StopsInTheMiddle) {
  make("r/a", hours(4), 500);
  make("r/b", hours(1));
  start({.bytes = 1});
  ASSERT_TRUE(run_until([&] { return !fs::exists(folder_ / "r/a"); }));
  stop();
  files_.join();
  run_ready();
  EXPECT_THAT(log_.lines("error"), IsEmpty());
}

}  // namespace
}  // namespace orbbuf
