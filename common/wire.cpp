// SPDX-License-Identifier: Apache-2.0
#include "common/wire.hpp"

#include <zlib.h>

#include <algorithm>
#include <cassert>
#include <limits>

#include "common/wire_fields.hpp"

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

  std::vector<std::uint8_t> take() && {
    const auto body = std::span(bytes()).subspan(kHeaderBytes);
    assert(body.size() <= (type_ == Type::kItems ? kMaxItemsBytes : kMaxControlBytes));
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
  for (const DropRecord& record : records) fields(out, record);
}

void put_streams(Writer& out, std::span<const StreamDeclaration> streams) {
  out.put(static_cast<std::uint16_t>(streams.size()));
  for (const StreamDeclaration& stream : streams) {
    out.put(stream.id);
    out.put_text(cut(stream.name, kMaxNameBytes));
    out.put_text(cut(stream.codec, kMaxNameBytes));
  }
}

std::vector<std::uint8_t> late_record(std::string_view session_id, Type type, std::uint32_t crc,
                                      std::span<const std::uint8_t> begin,
                                      std::span<const std::uint8_t> rest) {
  Writer record(0);
  record.fields(session_id, type, crc);
  record.put_bytes(begin);
  record.put_bytes(rest);
  return std::move(record.bytes());
}

bool is_id_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == '-';
}

}  // namespace

std::string_view to_string(Type type) {
  constexpr std::array<std::string_view, 8> kNames = {"hello", "welcome", "frame", "ack",
                                                      "items", "stats",   "bye",   "error"};
  const auto place = static_cast<std::size_t>(type) - 1;
  return place < kNames.size() ? kNames[place] : "unknown";
}

bool is_valid_id(std::string_view id) {
  return !id.empty() && id.size() <= kMaxIdBytes && id.front() != '.' && id.front() != '-' &&
         std::all_of(id.begin(), id.end(), is_id_character);
}

std::vector<std::uint8_t> encode(const Hello& hello) {
  assert(is_valid_id(hello.robot_id) && is_valid_id(hello.session_id));
  Message message(Type::kHello);
  message.fields(hello.min_version, hello.max_version);
  message.put_zeros(2);
  message.fields(hello.robot_id, hello.session_id);
  message.put_text(cut(hello.software, kMaxTextBytes));
  message.put_text(cut(hello.calibration, kMaxCalibrationBytes));
  put_streams(message, hello.streams);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Welcome& welcome) {
  Message message(Type::kWelcome);
  message.put(welcome.version);
  message.put(welcome.has_heartbeat ? kHasHeartbeat : std::uint8_t{0});
  message.put_zeros(2);
  message.put(welcome.max_frame_bytes);
  put_position(message, welcome.position, welcome.takes);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Ack& ack) {
  Message message(Type::kAck);
  put_position(message, ack.position);
  message.put(ack.received);
  if (!ack.pause.empty()) message.put_text(cut(ack.pause, kMaxTextBytes));
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Items& items) {
  assert(items.stream != kFrames && items.stream < kMostStreams && !items.payload.empty());
  Message message(Type::kItems);
  message.fields(items.stream, items.first);
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
  fields(message, report);
  put_position(message, report.captured_items);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const Bye& bye) {
  Message message(Type::kBye);
  put_position(message, bye.position);
  return std::move(message).take();
}

std::vector<std::uint8_t> encode(const ErrorMessage& error) {
  Message message(Type::kError);
  message.put(error.code);
  message.put_text(cut(error.text, kMaxTextBytes));
  return std::move(message).take();
}

std::vector<std::uint8_t> encode_late_part(const LatePart& part) {
  assert(!part.bytes.empty());
  Writer payload(0);
  payload.fields(part.offset, part.record_bytes);
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

bool Account::is_held() const {
  return held > 0 || std::ranges::any_of(streams, [](const auto& each) { return each.held > 0; });
}

std::vector<std::uint8_t> encode_account(const Account& account) {
  Writer payload(0);
  payload.put(account.session_id);
  payload.flags(account.is_final, account.has_ended);
  payload.fields(known_end(account), account.last_capture_time_ns, account.confirmed, account.held,
                 account.first_held);
  std::vector<StreamDeclaration> streams;
  for (const StreamAccount& each : account.streams) streams.push_back(each.stream);
  put_streams(payload, streams);
  for (const StreamAccount& each : account.streams) payload.fields(each.captured, each.held);
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
  return late_record(session_id, Type::kFrame, body_crc(meta, frame), meta, frame.jpeg);
}

std::vector<std::uint8_t> encode_late_record(std::string_view session_id, const Items& items) {
  const auto message = encode(items);
  const auto body = std::span(message).subspan(kHeaderBytes);
  return late_record(session_id, Type::kItems, crc32(body), body, {});
}

}  // namespace orbbuf::wire
