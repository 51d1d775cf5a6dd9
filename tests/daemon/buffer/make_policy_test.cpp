// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/make_policy.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using testing::Each;
using testing::Lt;

std::unique_ptr<DropPolicy> make(const std::string& name) {
  BufferSettings settings;
  settings.policy = name;
  return make_policy(settings, random_features);
}

TEST(MakePolicyTest, RefusesAnUnknownNameAndSaysIt) {
  try {
    make("drop-some");
    FAIL() << "no exception";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "unknown drop policy 'drop-some'");
  }
}

class EveryPolicyTest : public testing::TestWithParam<std::string_view> {
 protected:
  void push(Sequence sequence) { capture_and_push(buffer_, sequence); }
  std::vector<Sequence> drops() { return sequences_of(collect_drops(buffer_)); }

  static constexpr std::size_t kCapacity = 5;
  FrameBuffer buffer_{{kCapacity}, make(std::string(GetParam()))};
};

INSTANTIATE_TEST_SUITE_P(Policies, EveryPolicyTest, testing::ValuesIn(kPolicies),
                         [](const auto& test) { return test_name(std::string(test.param)); });

TEST_P(EveryPolicyTest, GivesUpNothingUpToCapacity) {
  for (Sequence count = 1; count <= kCapacity; ++count) {
    push(count);
    EXPECT_EQ(buffer_.stats().waiting, count);
    EXPECT_TRUE(drops().empty());
  }
}

TEST_P(EveryPolicyTest, GivesUpOneFrameForEachPushBeyondCapacityAndNeverTheNewest) {
  for (Sequence sequence = 0; sequence < 100; ++sequence) {
    push(sequence);
    const std::vector<Sequence> dropped = drops();
    ASSERT_EQ(dropped.size(), sequence < kCapacity ? 0U : 1U);
    ASSERT_THAT(dropped, Each(Lt(sequence)));
  }
}

TEST_P(EveryPolicyTest, ChoosesAmongAsFewAsTwoFrames) {
  BufferView view{nullptr, {make_frame_ptr(1), make_frame_ptr(2)}};
  EXPECT_EQ(make(std::string(GetParam()))->victim(view), 0U);
  view.previous = make_frame_ptr(0);
  EXPECT_EQ(make(std::string(GetParam()))->victim(view), 0U);
}

TEST_P(EveryPolicyTest, ChoosesTheSameInTheSameRun) {
  FrameBuffer other({kCapacity}, make(std::string(GetParam())));
  for (Sequence sequence = 0; sequence < 100; ++sequence) {
    push(sequence);
    capture_and_push(other, sequence);
  }
  EXPECT_EQ(drops(), sequences_of(collect_drops(other)));
}

TEST_P(EveryPolicyTest, TheBytesThatWaitAreBounded) {
  BufferSettings settings;
  settings.policy = std::string(GetParam());
  settings.capacity = 100;
  settings.memory_bytes = 10 * make_frame_ptr(0)->jpeg.size();
  FrameBuffer buffer = make_buffer(settings, random_features);
  for (Sequence sequence = 0; sequence < 50; ++sequence) capture_and_push(buffer, sequence);
  EXPECT_EQ(buffer.stats().waiting, 10U);
  EXPECT_EQ(buffer.report().waiting_bytes, settings.memory_bytes);
}

}  // namespace
}  // namespace orbbuf
