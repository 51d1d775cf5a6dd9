// SPDX-License-Identifier: Apache-2.0
#include "common/watched_thread.hpp"

#include <gtest/gtest.h>
#include <pthread.h>

#include <condition_variable>
#include <functional>
#include <latch>
#include <mutex>
#include <thread>
#include <utility>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

/// Whether a thread of that name is watched at all: each has a last beat some time ago.
bool is_watched(const std::string& name) {
  const auto still = WatchedThread::find_still(-1ns);
  return !still.empty() && still.front().name == name;
}

TEST(WatchedThread, IsNamedAndInTheListForAsLongAsItLives) {
  EXPECT_TRUE(WatchedThread::find_still(-1ns).empty()) << "nobody is watched";
  std::thread([] {
    {
      const WatchedThread watched("worker");
      char name[16] = {};
      pthread_getname_np(pthread_self(), name, sizeof name);
      EXPECT_STREQ(name, "worker");
      EXPECT_TRUE(is_watched("worker"));
    }
    EXPECT_FALSE(is_watched("worker"));
    beat();  // of a thread that is not watched any more
  }).join();
}

TEST(WatchedThread, OfSeveralTheOneThatHasNotBeatenForLongestIsFoundFirst) {
  std::latch is_watched_first(1), is_seen(1);
  std::thread first([&] {
    const WatchedThread watched("first");
    is_watched_first.count_down();
    is_seen.wait();
  });
  is_watched_first.wait();
  const WatchedThread watched("second");
  EXPECT_TRUE(is_watched("first"));
  EXPECT_EQ(WatchedThread::find_still(-1ns).size(), 2U);
  EXPECT_TRUE(WatchedThread::find_still(1h).empty());
  is_seen.count_down();
  first.join();
  EXPECT_TRUE(is_watched("second"));
}

/// Never true at first; once the thread that asks has beaten since it last asked.
class HasBeaten {
 public:
  bool operator()() {
    const auto age = WatchedThread::find_still(-1ns).front().time;
    return age < std::exchange(age_, age);
  }

 private:
  std::chrono::nanoseconds age_{0};
};

TEST(WatchedThread, BeatsWhileItWaitsOnACondition) {
  std::mutex mutex;
  std::condition_variable_any never_notified;
  const WatchedThread watched("waiting");
  std::unique_lock lock(mutex);
  const auto begin = WatchedThread::Clock::now();
  HasBeaten has_beaten;
  wait_beating(never_notified, lock, std::ref(has_beaten));
  EXPECT_GE(WatchedThread::Clock::now() - begin, kBeatInterval) << "it does not spin";
  EXPECT_TRUE(wait_beating(never_notified, lock, std::stop_token(), std::ref(has_beaten)));
}

TEST(WatchedThread, AStopEndsTheWait) {
  std::mutex mutex;
  std::condition_variable_any never_notified;
  std::stop_source stop;
  std::jthread other([&] { stop.request_stop(); });
  std::unique_lock lock(mutex);
  EXPECT_FALSE(wait_beating(never_notified, lock, stop.get_token(), [] { return false; }));
  EXPECT_TRUE(wait_beating(never_notified, lock, stop.get_token(), [] { return true; }));
}

}  // namespace
}  // namespace orbbuf
