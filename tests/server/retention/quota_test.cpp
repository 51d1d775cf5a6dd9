// SPDX-License-Identifier: Apache-2.0
#include "server/retention/quota.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using std::chrono::hours;
using testing::ElementsAre;
using testing::IsEmpty;

const std::chrono::system_clock::time_point kNow(hours(10'000));

/// Five sessions, not in order: `a`, the oldest, 50 h ago, to `e`, 10 h ago, of 10 bytes each.
std::vector<KeptSession> five() {
  std::vector<KeptSession> sessions;
  for (const char name : {'c', 'a', 'e', 'b', 'd'}) {
    sessions.push_back({"r", std::string(1, name), 10, kNow - hours(10 * ('f' - name))});
  }
  return sessions;
}

std::vector<std::string> going(const Quota& quota, const std::string& unfinished = "") {
  std::vector<std::string> names;
  for (const auto& session : over_quota(five(), quota, kNow, [&](const KeptSession& of) {
         return unfinished.find(of.session_id) == std::string::npos;
       })) {
    names.push_back(session.session_id);
  }
  return names;
}

TEST(OverQuota, WithoutOneEverythingStays) {
  EXPECT_FALSE(Quota{}.is_set());
  EXPECT_THAT(going({}), IsEmpty());
}

TEST(OverQuota, BySizeTheOldestGoUntilTheRestFits) {
  EXPECT_THAT(going({.bytes = 50}), IsEmpty());
  EXPECT_THAT(going({.bytes = 49}), ElementsAre("a"));
  EXPECT_THAT(going({.bytes = 30}), ElementsAre("a", "b"));
}

TEST(OverQuota, BySizeTheNewestStays) {
  EXPECT_THAT(going({.bytes = 1}), ElementsAre("a", "b", "c", "d"));
}

TEST(OverQuota, ByAgeAllGoThatAreOlder) {
  EXPECT_THAT(going({.age = hours(50)}), IsEmpty());
  EXPECT_THAT(going({.age = hours(25)}), ElementsAre("a", "b", "c"));
  EXPECT_THAT(going({.age = hours(1)}), ElementsAre("a", "b", "c", "d", "e"));
}

TEST(OverQuota, WhatGoesByAgeCountsForTheSize) {
  EXPECT_THAT(going({.bytes = 30, .age = hours(35)}), ElementsAre("a", "b"));
  EXPECT_THAT(going({.bytes = 20, .age = hours(35)}), ElementsAre("a", "b", "c"));
}

TEST(OverQuota, WhatIsNotFinishedStaysAndOthersGoInstead) {
  EXPECT_THAT(going({.bytes = 30}, "a"), ElementsAre("b", "c"));
  EXPECT_THAT(going({.age = hours(1)}, "ace"), ElementsAre("b", "d"));
  EXPECT_THAT(going({.bytes = 1}, "abcde"), IsEmpty());
}

}  // namespace
}  // namespace orbbuf
