// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/descriptors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "testing/captured_log.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

rlimit open_files() {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  return limit;
}

TEST(Descriptors, TheLimitIsRaisedToWhatTheConnectionsNeed) {
  const test::ResourceLimit low(RLIMIT_NOFILE, 100);
  allow_descriptors_for(50);
  EXPECT_EQ(open_files().rlim_cur, 264U);
}

TEST(Descriptors, TheLimitIsNeverLowered) {
  const test::ResourceLimit enough(RLIMIT_NOFILE, 264);
  allow_descriptors_for(49);
  EXPECT_EQ(open_files().rlim_cur, 264U);
}

TEST(Descriptors, MoreThanTheHardLimitIsWarnedOf) {
  const test::ResourceLimit low(RLIMIT_NOFILE, 100);
  test::CapturedLog log;
  const rlim_t most = open_files().rlim_max;
  allow_descriptors_for(static_cast<std::size_t>(most / 2));
  EXPECT_EQ(open_files().rlim_cur, most);
  EXPECT_THAT(log.lines("warning"), ElementsAre(HasSubstr("open files")));
}

TEST(Descriptors, EnoughIsNotWorthAWord) {
  test::CapturedLog log;
  allow_descriptors_for(1);
  EXPECT_THAT(log.lines("warning"), IsEmpty());
}

}  // namespace
}  // namespace orbbuf
