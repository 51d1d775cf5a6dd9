// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_probe.hpp"

#include <gtest/gtest.h>

#include <string>

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
  SampleProbe probe({"imu0", "euroc", folder / "data.csv"});
  probe.end(500'000'000, 600'000'000);
  EXPECT_EQ(probe.report(),
            "imu0: 200 samples, 199.0/s; between two of them 5.00 ms, in 90 % 5.00 to 5.00, at "
            "most 10.00\n");
}

TEST(SampleProbe, OfTheGeneratedSceneItTakesTheTimeOfTheFrames) {
  SampleProbe probe({"imu0", "generated"});
  probe.end(1'000'000'000, 3'000'000'000);
  ASSERT_EQ(probe.samples().size(), 461U);
  EXPECT_EQ(probe.samples().front().time_ns, 1'000'000'000);
  EXPECT_EQ(probe.samples().back().time_ns, 3'300'000'000);
}

TEST(SampleProbe, SaysThatNoneCame) {
  const test::TemporaryFolder folder;
  SampleProbe probe({"imu1", "socket", folder / "imu1"});
  probe.end(0, 1);
  EXPECT_EQ(probe.report(), "imu1: 0 samples within 0 s\n");
}

}  // namespace
}  // namespace orbbuf
