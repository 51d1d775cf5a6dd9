// SPDX-License-Identifier: Apache-2.0
#include "common/wire.hpp"

#include <zlib.h>

#include <algorithm>
#include <cassert>
#include <limits>

#include "common/byte_order.hpp"

namespace orbbuf::wire {
namespace {

/// Cut to `limit` bytes, not through the middle of a UTF-8 character.
std::string_view cut(std::string_view text, std::size_t limit) {
  if (text.size() <= limit) return text;
  while (limit > 0 && (static_cast<std::uint8_t>(text[limit]) & 0xC0) == 0x80) --limit;
  return text.substr(0, limit);
}

void store_header(std::uint8_t* at, Type type, std::uint32_t body_bytes, std::uint32_t body_crc) {
  std::uint8_t* const begin = at;
  at = store(at, kMagic);
  at = store(at, kHeaderFormat);
  at = store(at, static_cast<std::uint8_t>(type));
  at = store(at, std::uint16_t{0});
  at = store(at, body_bytes);
  at = store(at, body_crc);
  store(at, crc32({begin, at}));
}

/// A control message in the making: put() the body, then take it whole.
class Message : public Writer {
 public:
  explicit Message(Type type) : Writer(kHeaderBytes), type_(type) {}

  /// Of these streams.
  void put_position(const Position& position, const std::bitset<kMostStreams>& streams) {
    put(static_cast<std::uint16_t>(streams.count()));
    for (StreamId id = 0; id < kMostStreams; ++id) {
      if (!streams[id]) continue;
      put(id);
      put(position[id]);
    }
  }
  /// Of those of which there is something.
  void put_position(const Position& position) {
    std::bitset<kMostStreams> streams;
    for (StreamId id = 0; id < kMostStreams; ++id) streams[id] = position[id] > 0;
    put_position(position, streams);
  }

  std::vector<std::uint8_t> take() && {
    const auto body = std::span(bytes()).subspan(kHeaderBytes);
    assert(body.size() <= kMaxControlBytes);
    store_header(bytes().data(), type_, static_cast<std::uint32_t>(body.size()), crc32(body));
    return std::move(bytes());
  }

 private:
  Type type_;
};

/// The first bytes of a frame's body.
void store_meta(std::span<std::uint8_t, kFrameMetaBytes> meta, const EncodedFrame& frame) {
  std::uint8_t* at = meta.data();
  at = store(at, frame.sequence);
  at = store(at, frame.capture_time_ns);
  at = store(at, frame.exposure_ns);
  at = store(at, frame.width_px);
  at = store(at, frame.height_px);
  at = store(at, kJpegEncoding);
  at = store(at, frame.quality);
  at += 2;  // reserved
  at = store(at, static_cast<std::uint32_t>(frame.left().size()));
  at = store(at, frame.whole_bytes);
  store(at, frame.whole_crc);
}

/// Without reading the JPEG.
std::uint32_t body_crc(std::span<const std::uint8_t, kFrameMetaBytes> meta,
                       const EncodedFrame& frame) {
  return static_cast<std::uint32_t>(
      ::crc32_combine(crc32(meta), frame.jpeg_crc, static_cast<z_off_t>(frame.jpeg.size())));
}

void put_drops(Writer& out, std::span<const DropRecord> records) {
  assert(records.size() <= kMaxDropsPerMessage);
  out.put(static_cast<std::uint16_t>(records.size()));
  for (const DropRecord& record : records) {
    out.put(record.sequence);
    out.put(record.frames);
    out.put(record.capture_time_ns);
    out.put(record.last_capture_time_ns);
    out.put(static_cast<std::uint8_t>(record.reason));
    out.put(record.similarity);
  }
}

bool is_id_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == '-';
}

}  // namespace

std::string_view to_string(Type type) {
  switch (type) {
    case Type::kHello:
      return "hello";
    case Type::kWelcome:
      return "welcome";
    case Type::kFrame:
      return "frame";
    case Type::kAck:
      return "ack";
    case Type::kItems:
      return "items";
    case Type::kStats:
      return "stats";
    case Type::kBye:
      return "bye";
    case Type::kError:
      return "error";
  }
  return "unknown";
}

bool is_valid_id(std::string_view id) {
  return !id.empty() && id.size() <= kMaxIdBytes && id.front() != '.' && id.front() != '-' &&
         std::all_of(id.begin(), id.end(), is_id_character);
}

std::vector<std::uint8_t> encode(const Hello& hello) {
  assert(is_valid_id(hello.robot_id) && is_valid_id(hello.session_id));
  Message message(Type::kHello);
  message.put(hello.min_version);
  message.put(hello.max_version);
  message.put_zeros(2);
  message.put_text(hello.robot_id);
  message.put_text(hello.session_id);
  message.put_text(cut(hello.software, kMaxTextBytes));
  message.put_text(cut(hello.calibration, kMaxCalibrationBytes));
  message.put(static_cast<std::uint16_t>(hello.streams.size()));
  for (const StreamDeclaration& stream : hello.streams) {
    message.put(stream.id);
    message.put_text(cut(stream.name, kMaxNameBytes));
    message.put_text(cut(stream.codec, kMaxNameBytes));
  }
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Welcome& welcome) {
  Message message(Type::kWelcome);
  message.put(welcome.version);
  message.put(welcome.has_heartbeat ? kHasHeartbeat : std::uint8_t{0});
  message.put_zeros(2);
  message.put(welcome.max_frame_bytes);
  message.put_position(welcome.position, welcome.takes);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Ack& ack) {
  Message message(Type::kAck);
  message.put_position(ack.position);
  message.put(ack.received);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Items& items) {
  assert(items.stream != kFrames && items.stream < kMostStreams && !items.payload.empty());
  Message message(Type::kItems);
  message.put(items.stream);
  message.put(items.first);
  message.put_bytes(items.payload);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode_drops(std::span<const DropRecord> records) {
  Writer payload(0);
  put_drops(payload, records);
  return std::move(payload.bytes());
}

std::vector<std::uint8_t> encode(const Report& report) {
  Message message(Type::kStats);
  const Stats& stats = report.stats;
  for (const std::uint64_t count : {stats.captured, stats.skipped, stats.failed, stats.dropped,
                                    stats.acknowledged, stats.waiting, stats.in_flight}) {
    message.put(count);
  }
  message.put(report.capacity);
  message.put(report.waiting_bytes);
  message.put(report.link_rate);
  message.put(report.round_trip_us);
  message.put(report.clock_offset_ns);
  message.put(report.irreducible);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Bye& bye) {
  Message message(Type::kBye);
  message.put_position(bye.position);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const ErrorMessage& error) {
  Message message(Type::kError);
  message.put(static_cast<std::uint16_t>(error.code));
  message.put_text(cut(error.text, kMaxTextBytes));
  return std::move(message).take();
}

std::vector<std::uint8_t> encode_late_part(const LatePart& part) {
  assert(!part.bytes.empty());
  Writer payload(0);
  payload.put(part.offset);
  payload.put(part.record_bytes);
  payload.put_bytes(part.bytes);
  return std::move(payload.bytes());
}

Sequence known_end(const Account& account) {
  Sequence end = std::max(account.captured, account.confirmed);
  constexpr auto kMost = std::numeric_limits<Sequence>::max();
  if (account.held > kMost - account.first_held) return kMost;
  if (account.held > 0) end = std::max(end, account.first_held + account.held);
  for (const DropRecord& range : account.given_up) end = std::max(end, range.end());
  return end;
}

std::vector<std::uint8_t> encode_account(const Account& account) {
  Writer payload(0);
  payload.put_text(account.session_id);
  payload.put(static_cast<std::uint8_t>((account.is_final ? kIsFinal : 0) |
                                        (account.has_ended ? kHasEnded : 0)));
  payload.put(known_end(account));
  payload.put(account.last_capture_time_ns);
  payload.put(account.confirmed);
  payload.put(account.held);
  payload.put(account.first_held);
  put_drops(payload, account.given_up);
  return std::move(payload.bytes());
}

std::array<std::uint8_t, kHeaderBytes + kFrameMetaBytes> encode_frame_head(
    const EncodedFrame& frame) {
  assert(!frame.jpeg.empty());
  assert(frame.jpeg.size() <= std::numeric_limits<std::uint32_t>::max() - kFrameMetaBytes);
  std::array<std::uint8_t, kHeaderBytes + kFrameMetaBytes> head{};
  const auto meta = std::span(head).subspan<kHeaderBytes>();
  store_meta(meta, frame);
  store_header(head.data(), Type::kFrame,
               static_cast<std::uint32_t>(kFrameMetaBytes + frame.jpeg.size()),
               body_crc(meta, frame));
  return head;
}

std::vector<std::uint8_t> encode_late_record(std::string_view session_id,
                                             const EncodedFrame& frame) {
  std::array<std::uint8_t, kFrameMetaBytes> meta{};
  store_meta(meta, frame);
  Writer record(0);
  record.put_text(session_id);
  record.put(body_crc(meta, frame));
  record.put_bytes(meta);
  record.put_bytes(frame.jpeg);
  return std::move(record.bytes());
}

}  // namespace orbbuf::wire
