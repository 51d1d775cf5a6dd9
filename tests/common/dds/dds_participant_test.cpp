// SPDX-License-Identifier: Apache-2.0
#include "common/dds/dds_participant.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <stdexcept>

#include "testing/loopback_dds.hpp"

namespace orbbuf {
namespace {

class DdsParticipantTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("0"); }
};

TEST_F(DdsParticipantTest, ItsDomainIsRos2s) {
  ::setenv("ROS_DOMAIN_ID", "232", 1);
  EXPECT_EQ(DdsParticipant().domain_id(), 232U);
  for (const char* none : {"", "0"}) {
    ::setenv("ROS_DOMAIN_ID", none, 1);
    EXPECT_EQ(DdsParticipant().domain_id(), 0U);
  }
}

TEST_F(DdsParticipantTest, ADomainThatIsNoneIsRefused) {
  for (const char* id : {"233", "-1", "a", "1 "}) {
    ::setenv("ROS_DOMAIN_ID", id, 1);
    EXPECT_THROW(DdsParticipant(), std::runtime_error) << id;
  }
}

TEST_F(DdsParticipantTest, AnErrorNamesTheAttempt) {
  EXPECT_EQ(require_dds(7, "do nothing"), 7);
  try {
    require_dds(-1, "make a topic");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "dds: cannot make a topic: Error");
  }
}

}  // namespace
}  // namespace orbbuf
