// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_probe.hpp"

#include <gtest/gtest.h>

#include <string>

#include "common/sample.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

TEST(SampleProbe, ReportsTheRateAndTheGapsOfAFile) {
  const test::TemporaryFolder folder;
  std::string lines;
  for (std::int64_t i = 0; i <= 200; ++i) {
    if (i != 100) lines += to_euroc_line({i * 5'000'000, {}, {}});
  }
  test::write_file(folder / "data.csv", lines);
  EXPECT_EQ(
      probe_samples({"imu0", "euroc", folder / "data.csv"}, std::chrono::seconds(2)),
      "imu0: 200 samples, 199.0/s; between two of them 5.00 ms, in 90 % 5.00 to 5.00, at most "
      "10.00\n");
}

TEST(SampleProbe, OfTheGeneratedSceneItTakesTheTime) {
  EXPECT_EQ(
      probe_samples({"imu0", "generated"}, std::chrono::seconds(2)),
      "imu0: 401 samples, 200.0/s; between two of them 5.00 ms, in 90 % 5.00 to 5.00, at most "
      "5.00\n");
}

TEST(SampleProbe, SaysThatNoneCame) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(probe_samples({"imu1", "socket", folder / "imu1"}, std::chrono::seconds(1)),
            "imu1: 0 samples within 1 s\n");
}

}  // namespace
}  // namespace orbbuf
