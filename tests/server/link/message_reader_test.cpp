// SPDX-License-Identifier: Apache-2.0
#include "server/link/message_reader.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::plain_frame;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t kMaxJpegBytes = 10'000'000;

Bytes message_of(const EncodedFrame& frame) {
  const auto head = wire::encode_frame_head(frame);
  Bytes bytes(head.size() + frame.jpeg.size());
  const auto body = std::copy(head.begin(), head.end(), bytes.begin());
  std::copy(frame.jpeg.begin(), frame.jpeg.end(), body);
  return bytes;
}

class MessageReaderTest : public testing::Test {
 protected:
  MessageReaderTest() {
    if (is_one_message(wire::encode(wire::Hello{6, 6, "r", "s", "", "", {}}), 1U << 30U))
      reader_.take();
  }
  /// Gives `bytes` in pieces of at most `piece`; false if they are not just one message.
  bool is_one_message(const Bytes& bytes, std::size_t piece) {
    std::span<const std::uint8_t> left(bytes);
    while (!left.empty()) {
      const auto space = reader_.space();
      const std::size_t n = std::min({piece, space.size(), left.size()});
      std::memcpy(space.data(), left.data(), n);
      left = left.subspan(n);
      most_space_ = std::max(most_space_, space.size());
      const auto is_complete = reader_.commit(n);
      if (!is_complete) {
        fault_ = is_complete.error();
        return false;
      }
      if (is_complete.value()) return left.empty();
    }
    return false;
  }

  MessageReader reader_{kMaxJpegBytes};
  wire::Fault fault_;
  std::size_t most_space_ = 0;
};

TEST_F(MessageReaderTest, AFrameComesOutAsItWentInWhateverThePieces) {
  for (const std::size_t jpeg_bytes : {1U, 1000U, 131'072U, 131'073U, 1'000'000U}) {
    const auto frame = plain_frame(7, jpeg_bytes);
    for (const std::size_t piece : {1U, 19U, 20U, 28U, 4096U, 1U << 30U}) {
      if (jpeg_bytes > 1000 && piece < 4096) continue;
      ASSERT_TRUE(is_one_message(message_of(frame), piece));
      auto message = reader_.take();
      const auto got = wire::parse_frame(message.header, message.meta, std::move(message.body));
      ASSERT_TRUE(got);
      EXPECT_EQ(got.value().sequence, 7U);
      EXPECT_EQ(got.value().jpeg, frame.jpeg);
    }
  }
}

TEST_F(MessageReaderTest, KnowsWhenItIsBetweenMessages) {
  EXPECT_TRUE(reader_.is_between_messages());
  ASSERT_TRUE(reader_.commit(1));
  EXPECT_FALSE(reader_.is_between_messages());
}

TEST_F(MessageReaderTest, NeverAsksForBytesOfTheNextMessage) {
  ASSERT_TRUE(is_one_message(wire::encode(wire::Bye{{1, 2}}), 1U << 30U));
  EXPECT_EQ(reader_.take().header.type, wire::Type::kBye);
  EXPECT_EQ(reader_.space().size(), wire::kHeaderBytes);
}

TEST_F(MessageReaderTest, TakesMemoryOnlyAsBytesCome) {
  const Bytes bytes = message_of(plain_frame(0, 9'000'000));
  const Bytes beginning(bytes.begin(), bytes.begin() + 1000);
  EXPECT_FALSE(is_one_message(beginning, 1U << 30U));
  EXPECT_LE(most_space_, 128U * 1024U);
}

TEST_F(MessageReaderTest, ALengthOverTheLimitIsAFaultBeforeTheBody) {
  const Bytes bytes = message_of(plain_frame(0, kMaxJpegBytes + 1));
  EXPECT_FALSE(is_one_message(bytes, 1U << 30U));
  EXPECT_EQ(fault_.code, wire::ErrorCode::kTooLarge);
  EXPECT_LE(most_space_, wire::kHeaderBytes);
}

}  // namespace
}  // namespace orbbuf
