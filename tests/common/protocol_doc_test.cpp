// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <sstream>
#include <utility>

#include "common/wire.hpp"
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
  for (const std::string& line : test::read_lines(ORBBUF_SOURCE_DIR "/docs/protocol.md")) {
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
  EncodedFrame late{7, 1'600'000'000'033'333'333, 8'000'000, 640, 480, 0, {0xFF, 0xD8, 0xFF, 0xD9}};
  late.jpeg_crc = crc32(late.jpeg);
  late.quality = 80;
  EncodedFrame frame = late;
  frame.sequence = 1;
  frame.quality = 30;
  frame.whole_bytes = 30'000;
  frame.whole_crc = 0x0A1B2C3D;
  const DropRecord record{0, 1'600'000'000'000'000'000, DropReason::kBusy};
  return {{"hello", hex(encode(Hello{5, 5, "tb3", "s1", "orbbufd 0.1.0", ""}))},
          {"welcome", hex(encode(Welcome{5, {0, 0}, 16U << 20, true}))},
          {"dropped", hex(encode(Dropped{0, {record}}))},
          {"frame", hex(encode_whole(frame))},
          {"ack", hex(encode(Ack{{2, 1}, 2}))},
          {"stats", hex(encode(Report{{2, 1, 0, 0, 1, 0, 0}, 25, 0, 1'000'000, 40'000}))},
          {"spool", hex(encode(Spool{{{"s0", 1, 7}}}))},
          {"late", hex(encode(LatePart{0, 0, 52, encode_late_record("s0", late)}))},
          {"ack of late frames", hex(encode(LateAck{1}))},
          {"bye", hex(encode(Bye{{2, 1}}))},
          {"error", hex(encode(ErrorMessage{ErrorCode::kReplaced, "replaced"}))}};
}

TEST(ProtocolDoc, ExampleIsWhatTheCodeWrites) { EXPECT_EQ(examples(), conversation()); }

}  // namespace
}  // namespace orbbuf::wire
