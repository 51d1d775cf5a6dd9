// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/mobile_link.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf::sim {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

/// 1000 bytes a second for 2 s, nothing for 3 s, 4000 for 1 s.
RateTrace trace() { return {"test", {{2, 1000}, {3, 0}, {1, 4000}}}; }

TEST(MobileLink, SendsAtTheRateOfTheMoment) {
  EXPECT_EQ(finish(trace(), 1, 0, 0, 500), kSecond / 2);
  EXPECT_EQ(finish(trace(), 2, 0, 0, 500), kSecond / 4);
  EXPECT_EQ(finish(trace(), 1, 5, 0, 500), kSecond / 8);
}

TEST(MobileLink, WaitsWhereTheTraceStandsStill) {
  EXPECT_EQ(finish(trace(), 1, 0, kSecond * 3 / 2, 1500), 5 * kSecond + kSecond / 4);
}

TEST(MobileLink, BeginsAgainAtItsEnd) {
  EXPECT_EQ(finish(trace(), 1, 0, 5 * kSecond, 4500), 6 * kSecond + kSecond / 2);
  EXPECT_EQ(finish(trace(), 1, 0, 6 * kSecond, 500), 6 * kSecond + kSecond / 2);
}

TEST(MobileLink, KnowsItsMean) { EXPECT_DOUBLE_EQ(trace().mean_bytes_per_s(), 1000); }

TEST(MobileLink, ReadsBothFormats) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "a.json")
      << "[\n    {\"duration_ms\": 500, \"bandwidth_kbps\": 80, \"latency_ms\": 20}\n]\n";
  std::ofstream(folder.path() / "b.up") << "0\n100\n700\n";
  const RateTrace ghent = read_trace(folder.path() / "a.json");
  ASSERT_EQ(ghent.steps.size(), 1U);
  EXPECT_DOUBLE_EQ(ghent.steps[0].bytes_per_s, 10000);
  const RateTrace mahimahi = read_trace(folder.path() / "b.up");
  ASSERT_EQ(mahimahi.steps.size(), 2U);
  EXPECT_DOUBLE_EQ(mahimahi.steps[0].bytes_per_s, 6000);
  EXPECT_DOUBLE_EQ(mahimahi.steps[1].bytes_per_s, 3000);
  std::ofstream(folder.path() / "c.json") << "[]\n";
  EXPECT_THROW(read_trace(folder.path() / "c.json"), std::runtime_error);
}

TEST(MobileLink, ReadsEntriesHoweverTheyAreBroken) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "a.json")
      << R"([{"duration_ms":500,"bandwidth_kbps":80}, {"duration_ms" : 250,)"
      << "\n"
         R"("bandwidth_kbps":8, "latency_ms":20}])";
  const RateTrace trace = read_trace(folder.path() / "a.json");
  ASSERT_EQ(trace.steps.size(), 2U);
  EXPECT_DOUBLE_EQ(trace.steps[0].bytes_per_s, 10000);
  EXPECT_DOUBLE_EQ(trace.steps[1].duration_s, 0.25);
  EXPECT_DOUBLE_EQ(trace.steps[1].bytes_per_s, 1000);
  std::ofstream(folder.path() / "b.json") << R"([{"duration_ms": 500}, {"duration_ms": 250}])";
  EXPECT_THROW(read_trace(folder.path() / "b.json"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::sim
