// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/byte_order.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "daemon/record/drop_ranges.hpp"
#include "daemon/record/kept_frames.hpp"

/// The records of the robot's journal (common/journal). This is their specification; integers are
/// in network order, a text is a u16 length and its bytes. A session's name is ROBOT/SESSION.
///
///   checkpoint  u8    version of this format, 2
///               u32   n, then n times the body of an account: all sessions of which the journal
///                     knows anything, the oldest first
///   account     text  the session's name
///               u8    1: it ended in an orderly way; 2: the server has all of it, it is forgotten
///               u64   frames captured
///               i64   capture time of the last of them, ns
///               u64   frames below it were acknowledged by the server
///               u64   so were all drop records of frames below it
///               u32   n, then n streams beside the frames: u16 id, text name, text codec, u64
///               items
///                     captured, and u64: those below it are not needed any more
///               u32   n, then n drop records: in a checkpoint all that the server may not have,
///                     else those that came since the account before
///                 u64  number of the first frame
///                 u64  frames
///                 i64  capture time of the first, ns
///                 i64  of the last, if there are several
///                 u8   reason
///                 u16  similarity
///   frame       text  the session's name
///               u64   sequence number
///               i64   capture time, ns
///               u32   exposure, ns
///               u16   width in pixels
///               u16   height
///               u32   bytes of the left image (EncodedFrame::left_bytes)
///               u32   checksum of the JPEG
///               u8    quality of the JPEG, 0: unknown
///                     the JPEG, a whole one (EncodedFrame::is_reduced())
///   items       text  the session's name
///               u16   stream
///               u64   number of the first
///                     the payload (wire::Items)
///   released    text  the session's name
///               u32   n, then n times u64: numbers of frames that are not held any more
///   index       u32   n, then for each of n sessions what the segment says of its frames:
///                 text  its name
///                 u32   n, then for each frame record
///                   u64  sequence number
///                   u32  offset of the record in the segment
///                   u32  bytes of it
///                 u32   n, then n times u64: the numbers of all released records
///                 u32   n, then for each items record
///                   u16  stream
///                   u64  number of the first
///                   u16  how many
///                   u32, u32  as of a frame record
///               u32   bytes of the body before this field
///
/// An index is the last record of each complete segment, so that a start need not read the others.
namespace orbbuf::record_format {

inline constexpr std::uint8_t kAccount = 1;
inline constexpr std::uint8_t kFrame = 2;
inline constexpr std::uint8_t kReleased = 3;
inline constexpr std::uint8_t kIndex = 4;
inline constexpr std::uint8_t kItems = 5;

using Bytes = std::span<const std::uint8_t>;

/// A stream beside the frames.
struct StreamAccount {
  wire::StreamDeclaration stream;
  std::uint64_t captured = 0;
  std::uint64_t settled = 0;  ///< those below it are with the server, or lost

  friend bool operator==(const StreamAccount&, const StreamAccount&) = default;
};

/// Without its drop records.
struct Account {
  std::string name;
  bool has_ended = false;
  bool is_settled = false;
  Sequence captured = 0;
  std::int64_t last_capture_time_ns = 0;
  Sequence confirmed = 0;
  Sequence settled_below = 0;
  std::vector<StreamAccount> streams{};
};

/// What a segment says of the frames of each session.
struct IndexEntry {
  std::vector<KeptFrame> kept;  ///< written
  std::vector<Sequence> released;
  std::vector<std::pair<wire::StreamId, KeptFrame>> items{};  ///< written
};
using Index = std::map<std::string, IndexEntry, std::less<>>;

void put(wire::Writer& out, const Account& account, const DropRanges& given_up);
/// Adds the drop records to `given_up`. Nothing: it is none.
std::optional<Account> take_account(wire::Reader& in, DropRanges& given_up);

std::vector<std::uint8_t> frame_head(std::string_view name, const EncodedFrame& frame);
/// The session's name, and the frame.
std::optional<std::pair<std::string, EncodedFrame>> parse_frame(Bytes body);

std::vector<std::uint8_t> encode_items(std::string_view name, const wire::Items& items);
/// How many items a payload has: each codec begins with that.
std::uint16_t count_of(const wire::Items& items);
/// The session's name, and the items.
std::optional<std::pair<std::string, wire::Items>> parse_items(Bytes body);

std::vector<std::uint8_t> encode_released(std::string_view name,
                                          const std::vector<Sequence>& released);
std::optional<std::pair<std::string, std::vector<Sequence>>> parse_released(Bytes body);

std::vector<std::uint8_t> encode(const Index& index);
/// `segment`: that of the frames.
std::optional<Index> parse_index(Bytes body, std::uint32_t segment);

}  // namespace orbbuf::record_format
