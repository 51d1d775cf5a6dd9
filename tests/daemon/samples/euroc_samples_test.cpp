// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/euroc_samples.hpp"

#include <gtest/gtest.h>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

class EurocSamplesTest : public ::testing::Test {
 protected:
  std::unique_ptr<EurocSamples> open(const std::string& text) {
    test::write_file(folder_ / "data.csv", text);
    return std::make_unique<EurocSamples>(
        folder_ / "data.csv", [this](const Sample& sample) { times_.push_back(sample.time_ns); });
  }
  void expect_times(const std::string& text, const std::vector<std::int64_t>& times) {
    times_.clear();
    open(text)->on_frame(1'000'000);
    EXPECT_EQ(times_, times) << text;
  }

  const test::TemporaryFolder folder_;
  std::vector<std::int64_t> times_;
};

TEST_F(EurocSamplesTest, HandsOnEachSampleWithTheFirstFrameThatIsNotOlder) {
  const auto source = open("#header\n10,1,2,3,4,5,6\n20,1,2,3,4,5,6\n30,1,2,3,4,5,6\n");
  source->on_frame(9);
  EXPECT_TRUE(times_.empty());
  source->on_frame(20);
  EXPECT_EQ(times_, (std::vector<std::int64_t>{10, 20}));
  source->on_frame(100);
  EXPECT_EQ(times_, (std::vector<std::int64_t>{10, 20, 30}));
}

TEST_F(EurocSamplesTest, PassesOverALineThatIsNoSampleOrOutOfOrderAndCountsIt) {
  const std::string of = ",1,2,3,4,5,6\n";
  const auto file = [&](const std::vector<int>& times) {
    std::string text = "#header\n";
    for (const int time : times) text += std::to_string(time) + of;
    return text;
  };
  const test::CapturedLog log;
  expect_times(file({10, 20, 30}), {10, 20, 30});
  EXPECT_EQ(log.lines("passed over").size(), 0U);
  expect_times(file({10}) + "20,1,2,3\n" + file({30}), {10, 30});
  EXPECT_EQ(log.lines("data.csv: 1 of 3 lines passed over; the first: line 3: expected").size(),
            1U);
  expect_times(file({10, 10, 20, 20}), {10, 20});
  EXPECT_EQ(log.lines("2 of 4 lines passed over; the first: line 3: the time is not").size(), 1U);
  expect_times(file({10, 20, 5, 30}), {10, 20, 30});
  expect_times(file({10, 900, 20, 30}), {10, 20, 30});
  expect_times(file({900, 10, 20}), {10, 20});
}

TEST_F(EurocSamplesTest, RefusesAFileWithoutASample) {
  EXPECT_THROW(open("10,1,2,3\n"), std::runtime_error);
  EXPECT_THROW(open("#header only\n"), std::runtime_error);
  EXPECT_THROW(EurocSamples(folder_ / "none.csv", nullptr), std::runtime_error);
}

TEST_F(EurocSamplesTest, WarnsIfSamplesAndFramesHaveNoTimeInCommon) {
  const std::string samples = "1000000000,1,2,3,4,5,6\n2000000000,1,2,3,4,5,6\n";
  const test::CapturedLog log;
  open(samples)->on_frame(1'000'000'000);
  open(samples).reset();
  EXPECT_EQ(log.lines().size(), 0U);
  open(samples)->on_frame(999'999'999);
  EXPECT_EQ(log.lines("warning " + (folder_ / "data.csv").string() +
                      ": no sample is as early as any frame: the first is of 1.000000000 s, the "
                      "last frame of 0.999999999 s")
                .size(),
            1U);
  open(samples)->on_frame(2'000'000'001);
  EXPECT_EQ(log.lines("all samples are older than the first frame").size(), 1U);
}

}  // namespace
}  // namespace orbbuf
