// SPDX-License-Identifier: Apache-2.0
// Any bytes as a record of a journal, the server's or the robot's: what is taken for one must say
// the same again when it is written and read. The first byte is the type; from 128 on the robot's.
#include <algorithm>
#include <cstdlib>
#include <span>

#include "daemon/record/record_state.hpp"
#include "server/session/records.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

void require(bool holds) {
  if (!holds) std::abort();
}

void run_server(std::uint8_t type, std::span<const std::uint8_t> bytes) {
  const auto record = decode_record(type, bytes);
  if (!record) return;
  const Bytes once = encode(record->body, record->kept);
  const auto again = decode_record(type, once);
  require(again && encode(again->body, again->kept) == once);
  SessionSummary summary;
  add(record->body, summary);
  named_by(record->body);
}

void run_robot(std::uint8_t type, std::span<const std::uint8_t> bytes) {
  RecordState state("robot", "present");
  switch (type) {
    case record_format::kAccount:
      state.apply_account(bytes);
      break;
    case record_format::kFrame:
      if (const auto frame = record_format::parse_frame(bytes)) {
        const Bytes once = record_format::frame_head(frame->first, frame->second);
        require(once.size() + frame->second.jpeg.size() == bytes.size());
      }
      break;
    case record_format::kItems:
      if (const auto items = record_format::parse_items(bytes)) {
        require(
            std::ranges::equal(record_format::encode_items(items->first, items->second), bytes));
      }
      break;
    case record_format::kReleased:
      if (const auto released = record_format::parse_released(bytes)) {
        const Bytes once = record_format::encode_released(released->first, released->second);
        require(record_format::parse_released(once) == released);
      }
      break;
    case record_format::kIndex:
      if (const auto index = record_format::parse_index(bytes, 0)) {
        const Bytes once = record_format::encode(*index);
        require(record_format::parse_index(once, 0).has_value());
        state.apply(*index, true);
      }
      break;
    default:
      state.apply_checkpoint(bytes);
  }
  state.begin();
  state.take_accounts();
  state.checkpoint();
}

}  // namespace
}  // namespace orbbuf

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::uint8_t kRobots = 128;
  if (size == 0) return 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  if (data[0] < kRobots) {
    orbbuf::run_server(data[0] % 8, bytes);
  } else {
    orbbuf::run_robot(data[0] % 5, bytes);
  }
  return 0;
}
