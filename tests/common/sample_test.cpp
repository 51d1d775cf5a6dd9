// SPDX-License-Identifier: Apache-2.0
#include "common/sample.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

Sample sample_of(std::int64_t time_ns) {
  return {time_ns, {0.1, -1e-9, 3}, {9.81, 1.0 / 3, -2e300}};
}

TEST(Sample, ALineReadsBackTheSame) {
  const std::string line = to_euroc_line(sample_of(1403636579758555392));
  ASSERT_TRUE(line.ends_with('\n'));
  EXPECT_EQ(parse_euroc_line(line.substr(0, line.size() - 1)), sample_of(1403636579758555392));
}

TEST(Sample, TheDataSetsOwnLinesAreRead) {
  const auto sample = parse_euroc_line("5, -0.5,0.25,1e-1 ,8,0,-1\r");
  EXPECT_EQ(sample, (Sample{5, {-0.5, 0.25, 0.1}, {8, 0, -1}}));
}

TEST(Sample, OtherLinesAreNone) {
  for (const char* line : {"", "#timestamp", "1,2,3,4,5,6", "1,2,3,4,5,6,7,8", "1,2,3,4,5,6,nan",
                           "1,2,3,,5,6,7", "1.5,2,3,4,5,6,7", "1,2,3,4,5,6,7x"}) {
    EXPECT_FALSE(parse_euroc_line(line)) << line;
  }
}

TEST(Sample, APayloadReadsBackTheSame) {
  const std::vector<Sample> samples = {sample_of(-1), sample_of(7)};
  const auto payload = wire::encode_samples(samples);
  EXPECT_EQ(payload.size(), 2U + 2U * 56U);
  EXPECT_EQ(wire::parse_samples(payload).value(), samples);
}

TEST(Sample, APayloadThatIsCutOrLongerOrNotFiniteIsRefused) {
  const std::vector<Sample> samples = {sample_of(1)};
  auto payload = wire::encode_samples(samples);
  for (std::size_t bytes = 0; bytes < payload.size(); ++bytes) {
    EXPECT_FALSE(wire::parse_samples(std::span(payload).first(bytes))) << bytes;
  }
  payload.push_back(0);
  EXPECT_FALSE(wire::parse_samples(payload));
  const std::vector<Sample> infinite = {
      {1, {0, 0, std::numeric_limits<double>::infinity()}, {0, 0, 0}}};
  EXPECT_FALSE(wire::parse_samples(wire::encode_samples(infinite)));
}

TEST(Sample, AStreamsNameIsSafeAsAFolderBesideTheImages) {
  EXPECT_TRUE(wire::is_sample_stream({4, "imu0", "imu"}));
  for (const char* name : {"images", "orphans", "../imu", "imu/..", "", "imu 0"}) {
    EXPECT_FALSE(wire::is_sample_stream({4, name, "imu"})) << name;
  }
  EXPECT_FALSE(wire::is_sample_stream({4, "imu0", "other"}));
}

}  // namespace
}  // namespace orbbuf
