// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <sstream>
#include <utility>

#include "common/wire.hpp"
#include "testing/source_folder.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/common/wire_samples.hpp"

namespace orbbuf::wire {
namespace {

/// A message of the document: the first word of the comment above its bytes, and the bytes.
using Example = std::pair<std::string, std::string>;

/// The fenced `hex` block of docs/protocol.md. A line is bytes, then `#` and a remark; a line with
/// only a remark begins a message.
std::vector<Example> examples() {
  std::vector<Example> result;
  bool is_inside = false;
  for (const std::string& line :
       test::read_lines(test::kSourceFolder + std::string("/docs/protocol.md"))) {
    if (line.starts_with("```")) is_inside = line == "```hex";
    if (!is_inside || line.empty() || line.starts_with("```")) continue;
    if (line.starts_with("# ")) {
      result.emplace_back(line.substr(2, line.find(':') - 2), "");
      continue;
    }
    std::istringstream bytes(line.substr(0, line.find('#')));
    for (std::string byte; bytes >> byte;) result.back().second += byte;
  }
  return result;
}

/// The conversation that the document tells.
std::vector<Example> conversation() {
  constexpr std::int64_t kSecond = 1'000'000'000;
  constexpr std::int64_t kBegin = 1'600'000'000 * kSecond;
  EncodedFrame late{7, kBegin - kSecond - 33'333'333, 8'000'000, 640, 480,
                    0, {0xFF, 0xD8, 0xFF, 0xD9}};
  late.jpeg_crc = crc32(late.jpeg);
  late.quality = 80;
  EncodedFrame frame = late;
  frame.sequence = 2;
  frame.capture_time_ns = kBegin + 66'666'667;
  frame.quality = 30;
  frame.whole_bytes = 30'000;
  frame.whole_crc = 0x0A1B2C3D;
  const DropRecord busy{0, kBegin, DropReason::kBusy, kUnknownSimilarity, 2, kBegin + 33'333'333};
  const Account killed{"s0", true, false, 9, kBegin - kSecond, 7, 1, 7, {}};
  Welcome welcome;
  welcome.max_frame_bytes = 16U << 20;
  welcome.takes.set(kFrames).set(kDrops).set(kLate).set(kAccounts);
  Ack ack{{3, 1}, 3};
  ack.position[kAccounts] = 1;
  Ack late_ack = ack;
  late_ack.position[kLate] = 1;
  const auto record = encode_late_record("s0", late);
  const auto record_bytes = static_cast<std::uint32_t>(record.size());
  return {{"hello", hex(encode(Hello{6, 6, "tb3", "s1", "orbbufd 0.1.0", "", {}}))},
          {"welcome", hex(encode(welcome))},
          {"account", hex(encode(Items{kAccounts, 0, encode_account(killed)}))},
          {"drops", hex(encode(Items{kDrops, 0, encode_drops({&busy, 1})}))},
          {"frame", hex(encode_whole(frame))},
          {"ack", hex(encode(ack))},
          {"stats", hex(encode(Report{{3, 2, 0, 0, 1, 0, 0}, 25, 0, 1'000'000, 40'000}))},
          {"late", hex(encode(Items{kLate, 0, encode_late_part({0, record_bytes, record})}))},
          {"ack of the late frame", hex(encode(late_ack))},
          {"bye", hex(encode(Bye{{3, 1}}))},
          {"error", hex(encode(ErrorMessage{ErrorCode::kReplaced, "replaced"}))}};
}

TEST(ProtocolDoc, ExampleIsWhatTheCodeWrites) { EXPECT_EQ(examples(), conversation()); }

}  // namespace
}  // namespace orbbuf::wire
