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

  void put_position(const Position& position) {
    put(position.next_sequence);
    put(position.next_drop);
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
    case Type::kDropped:
      return "dropped";
    case Type::kStats:
      return "stats";
    case Type::kBye:
      return "bye";
    case Type::kError:
      return "error";
    case Type::kLate:
      return "late";
    case Type::kLateAck:
      return "late ack";
    case Type::kSpool:
      return "spool";
  }
  return "unknown";
}

bool is_valid_id(std::string_view id) {
  return !id.empty() && id.size() <= kMaxIdBytes && id.front() != '.' && id.front() != '-' &&
         std::all_of(id.begin(), id.end(), is_id_character);
}

std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t seed) {
  // zlib takes a null pointer for a request of its initial value, whatever the seed.
  if (bytes.empty()) return seed;
  return static_cast<std::uint32_t>(::crc32_z(seed, bytes.data(), bytes.size()));
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
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Welcome& welcome) {
  Message message(Type::kWelcome);
  message.put(welcome.version);
  message.put(static_cast<std::uint8_t>((welcome.takes_late ? kTakesLate : 0) |
                                        (welcome.has_heartbeat ? kHasHeartbeat : 0)));
  message.put_zeros(2);
  message.put(welcome.max_frame_bytes);
  message.put_position(welcome.position);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Ack& ack) {
  Message message(Type::kAck);
  message.put_position(ack.position);
  message.put(ack.received);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Dropped& dropped) {
  assert(!dropped.records.empty() && dropped.records.size() <= kMaxDropsPerMessage);
  Message message(Type::kDropped);
  message.put(dropped.first_drop);
  message.put(static_cast<std::uint16_t>(dropped.records.size()));
  for (const DropRecord& record : dropped.records) {
    message.put(record.sequence);
    message.put(record.capture_time_ns);
    message.put(static_cast<std::uint8_t>(record.reason));
    message.put(record.similarity);
  }
  return std::move(message).take();
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

std::vector<std::uint8_t> encode(const LatePart& part) {
  assert(!part.bytes.empty() && part.bytes.size() <= kMaxControlBytes - kLateHeadBytes);
  Message message(Type::kLate);
  message.put(part.number);
  message.put(part.offset);
  message.put(part.record_bytes);
  message.put_bytes(part.bytes);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const LateAck& ack) {
  Message message(Type::kLateAck);
  message.put(ack.next);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Spool& spool) {
  assert(spool.sessions.size() <= kMaxSpooledSessions);
  Message message(Type::kSpool);
  message.put(static_cast<std::uint16_t>(spool.sessions.size()));
  for (const SpooledSession& session : spool.sessions) {
    message.put_text(session.session_id);
    message.put(session.frames);
    message.put(session.first);
  }
  return std::move(message).take();
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
