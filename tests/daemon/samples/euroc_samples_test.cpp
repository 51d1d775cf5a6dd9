// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/euroc_samples.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

class EurocSamplesTest : public ::testing::Test {
 protected:
  EurocSamples open(const std::string& text) {
    std::ofstream(folder_ / "data.csv") << text;
    return {folder_ / "data.csv",
            [this](const Sample& sample) { times_.push_back(sample.time_ns); }};
  }

  const test::TemporaryFolder folder_;
  std::vector<std::int64_t> times_;
};

TEST_F(EurocSamplesTest, HandsOnEachSampleWithTheFirstFrameThatIsNotOlder) {
  auto source = open("#header\n10,1,2,3,4,5,6\n20,1,2,3,4,5,6\n30,1,2,3,4,5,6\n");
  source.on_frame(9);
  EXPECT_TRUE(times_.empty());
  source.on_frame(20);
  EXPECT_EQ(times_, (std::vector<std::int64_t>{10, 20}));
  source.on_frame(100);
  EXPECT_EQ(times_, (std::vector<std::int64_t>{10, 20, 30}));
}

TEST_F(EurocSamplesTest, RefusesWhatIsNoSample) {
  EXPECT_THROW(open("10,1,2,3\n"), std::runtime_error);
  EXPECT_THROW(open("10,1,2,3,4,5,6\n10,1,2,3,4,5,6\n"), std::runtime_error);
  EXPECT_THROW(open("#header only\n"), std::runtime_error);
  EXPECT_THROW(EurocSamples(folder_ / "none.csv", nullptr), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf
