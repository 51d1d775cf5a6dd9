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
    return EurocSamples(folder_ / "data.csv");
  }

  const test::TemporaryFolder folder_;
};

TEST_F(EurocSamplesTest, HandsOnEachSampleWithTheFirstFrameThatIsNotOlder) {
  auto source = open("#header\n10,1,2,3,4,5,6\n20,1,2,3,4,5,6\n30,1,2,3,4,5,6\n");
  std::vector<std::int64_t> times;
  const auto take = [&](const Sample& sample) { times.push_back(sample.time_ns); };
  source.read_until(9, take);
  EXPECT_TRUE(times.empty());
  source.read_until(20, take);
  EXPECT_EQ(times, (std::vector<std::int64_t>{10, 20}));
  source.read_until(100, take);
  EXPECT_EQ(times, (std::vector<std::int64_t>{10, 20, 30}));
}

TEST_F(EurocSamplesTest, RefusesWhatIsNoSample) {
  EXPECT_THROW(open("10,1,2,3\n"), std::runtime_error);
  EXPECT_THROW(open("10,1,2,3,4,5,6\n10,1,2,3,4,5,6\n"), std::runtime_error);
  EXPECT_THROW(open("#header only\n"), std::runtime_error);
  EXPECT_THROW(EurocSamples(folder_ / "none.csv"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf
