// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <span>

#include "server/link/message_reader.hpp"

namespace orbbuf {
namespace {

constexpr std::uint32_t kMostBytes = 1000;

EncodedFrame frame_of(Sequence sequence, std::size_t bytes = 500) {
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.jpeg.assign(bytes, static_cast<std::uint8_t>(sequence));
  frame.jpeg_crc = wire::crc32(frame.jpeg);
  return frame;
}

class LateAssemblyTest : public ::testing::Test {
 protected:
  auto add(std::uint64_t number, const std::vector<std::uint8_t>& record, std::size_t offset,
           std::size_t bytes) {
    const auto part = std::span(record).subspan(offset).first(bytes);
    return assembly_.add(number, {static_cast<std::uint32_t>(offset),
                                  static_cast<std::uint32_t>(record.size()), part});
  }
  std::string fault_of(std::uint64_t number, std::size_t offset, std::uint32_t record_bytes) {
    const std::vector<std::uint8_t> bytes(10);
    const auto added =
        assembly_.add(number, {static_cast<std::uint32_t>(offset), record_bytes, bytes});
    return added ? "taken" : added.error().text;
  }

  LateAssembly assembly_{kMostBytes};
};

TEST_F(LateAssemblyTest, PartsOfAnySizeMakeTheFrame) {
  for (std::uint64_t number = 0; number < 3; ++number) {
    const auto record = wire::encode_late_record("s", frame_of(number));
    const std::size_t step = number == 0 ? record.size() : number == 1 ? 1 : 100;
    for (std::size_t offset = 0; offset < record.size(); offset += step) {
      const auto added = add(number, record, offset, std::min(step, record.size() - offset));
      ASSERT_TRUE(added) << added.error().text;
      ASSERT_EQ(added.value().has_value(), offset + step >= record.size());
      if (!added.value()) continue;
      EXPECT_EQ(added.value()->session_id, "s");
      EXPECT_EQ(added.value()->frame.sequence, number);
      EXPECT_EQ(added.value()->frame.jpeg, frame_of(number).jpeg);
    }
  }
}

TEST_F(LateAssemblyTest, APartThatIsNotTheNextOneIsRefused) {
  EXPECT_EQ(fault_of(1, 0, 100), "late frame 1 from byte 0 on, not 0 from 0 on");
  EXPECT_EQ(fault_of(0, 10, 100), "late frame 0 from byte 10 on, not 0 from 0 on");
  EXPECT_EQ(fault_of(0, 0, 100), "taken");
  EXPECT_EQ(fault_of(0, 0, 100), "late frame 0 from byte 0 on, not 0 from 10 on");
  EXPECT_EQ(fault_of(0, 20, 100), "late frame 0 from byte 20 on, not 0 from 10 on");
  EXPECT_EQ(fault_of(0, 10, 99), "late frame 0 from byte 10 on, not 0 from 10 on");
  EXPECT_EQ(fault_of(0, 10, 100), "taken");
}

TEST_F(LateAssemblyTest, ARecordOverTheLimitIsRefusedBeforeItComes) {
  // The limit of a JPEG is below that of a message of items.
  const auto most = static_cast<std::uint32_t>(wire::kMaxItemsBytes + wire::kMaxLateHeadBytes);
  EXPECT_EQ(fault_of(0, 0, most + 1), "late frame of 2097264 bytes is over the limit of 2097263");
  EXPECT_EQ(fault_of(0, 0, most), "taken");
}

TEST_F(LateAssemblyTest, PartsThatAreNoFrameAreRefused) {
  EXPECT_EQ(fault_of(0, 0, 10), "late frame of 10 bytes holds no JPEG");
  auto record = wire::encode_late_record("s", frame_of(0));
  record.back() ^= 1;
  EXPECT_EQ(LateAssembly(kMostBytes)
                .add(0, {0, static_cast<std::uint32_t>(record.size()), record})
                .error()
                .text,
            "frame body does not match its checksum");
}

}  // namespace
}  // namespace orbbuf
