// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "bench/paper/trial/mobile_link.hpp"
#include "bench/paper/trial/report.hpp"
#include "bench/paper/trial/scene.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::paper {
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

TEST(StretchAround, GoesOnBehindTheFirstFrameAfterTheOutage) {
  const std::vector<std::size_t> in_time{90, 99, 150, 151};
  const auto stretch = stretch_around({100, 150}, in_time, 25, 1000);
  ASSERT_TRUE(stretch);
  EXPECT_EQ(stretch->begin, 75U);
  EXPECT_EQ(stretch->end, 200U);
  const std::vector<std::size_t> late{90, 99, 230, 231};
  const auto later = stretch_around({100, 150}, late, 25, 1000);
  ASSERT_TRUE(later);
  EXPECT_EQ(later->end, 280U);
}

TEST(StretchAround, StaysInTheSequence) {
  const std::vector<std::size_t> received{0, 95};
  const auto stretch = stretch_around({10, 60}, received, 25, 100);
  ASSERT_TRUE(stretch);
  EXPECT_EQ(stretch->begin, 0U);
  EXPECT_EQ(stretch->end, 100U);
}

TEST(StretchAround, WhoIsNotBackHasNone) {
  const std::vector<std::size_t> gone{90, 99};
  EXPECT_FALSE(stretch_around({100, 150}, gone, 25, 1000));
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

TEST(LongestGap, CountsWhatIsMissingAtTheEnds) {
  const std::vector<std::size_t> received{3, 4, 7, 15, 16};
  EXPECT_EQ(longest_gap(received, {3, 17}), 7U);
  EXPECT_EQ(longest_gap(received, {3, 25}), 8U);
  EXPECT_EQ(longest_gap(received, {0, 8}), 3U);
  EXPECT_EQ(longest_gap(received, {5, 7}), 2U);
  EXPECT_EQ(longest_gap(received, {17, 40}), 23U);
  EXPECT_EQ(longest_gap({}, {0, 10}), 10U);
  EXPECT_EQ(longest_gap(received, {20, 10}), 0U);
}

TEST(Share, HasWilsonsInterval) {
  const auto [low, high] = Share{19, 20}.interval();  // 0.764 to 0.991 in the tables
  EXPECT_NEAR(low, 0.764, 0.001);
  EXPECT_NEAR(high, 0.991, 0.001);
  EXPECT_EQ(Share({20, 20}).interval().second, 1);
}

TEST(ForEachParallel, DoesEachOnceAndThrowsOn) {
  std::atomic<int> sum = 0;
  for_each_parallel("test", 100, [&](std::size_t i) { sum += static_cast<int>(i); });
  EXPECT_EQ(sum, 4950);
  EXPECT_THROW(for_each_parallel("test", 10, [](std::size_t) { throw std::runtime_error("x"); }),
               std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::paper
