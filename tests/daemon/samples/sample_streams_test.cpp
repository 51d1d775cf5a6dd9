// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_streams.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

class SampleStreamsTest : public ::testing::Test {
 protected:
  SampleStreamsTest() {
    std::ofstream file(folder_ / "data.csv");
    for (std::int64_t time = 0; time < 10; ++time) file << to_euroc_line({time, {}, {}});
    file.close();
    streams_.emplace(std::vector<SampleStreamSettings>{{"imu0", "euroc", folder_ / "data.csv"},
                                                       {"imu1", "euroc", folder_ / "data.csv"}});
  }

  const test::TemporaryFolder folder_;
  std::optional<SampleStreams> streams_;
};

TEST_F(SampleStreamsTest, DeclaresEachAndSendsThemByNumber) {
  const auto declared = streams_->declarations();
  ASSERT_EQ(declared.size(), 2U);
  EXPECT_EQ(declared[1], (wire::StreamDeclaration{5, "imu1", "imu"}));
  streams_->capture_until(3);
  EXPECT_FALSE(streams_->take_message(3).empty());
  EXPECT_FALSE(streams_->take_message(3).empty());
  EXPECT_TRUE(streams_->take_message(3).empty());
  wire::Position position;
  streams_->put_ends(position);
  EXPECT_EQ(position[4], 4U);
  EXPECT_EQ(position[5], 4U);
  EXPECT_TRUE(streams_->can_be_at(position));
  EXPECT_FALSE(streams_->is_settled());
  streams_->on_ack(position);
  EXPECT_TRUE(streams_->is_settled());
  position[5] = 5;
  EXPECT_FALSE(streams_->can_be_at(position));
}

TEST_F(SampleStreamsTest, AStreamThatTheServerDoesNotTakeHoldsNothingUp) {
  streams_->on_connected({}, {true, false});
  streams_->capture_until(3);
  EXPECT_FALSE(streams_->take_message(3).empty());
  EXPECT_TRUE(streams_->take_message(3).empty());
  wire::Position position;
  streams_->put_ends(position);
  streams_->on_ack(position);
  EXPECT_TRUE(streams_->is_settled());
  EXPECT_EQ(streams_->stats(),
            "imu0 captured 4 = delivered 4 + waiting 0 + lost 0, "
            "imu1 captured 4 = delivered 0 + waiting 4 + lost 0");
}

}  // namespace
}  // namespace orbbuf
