// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/as_bytes.hpp"
#include "common/byte_order.hpp"
#include "common/wire.hpp"

/// Valid messages of each type, and ways to take one apart.
namespace orbbuf::wire {

using Bytes = std::vector<std::uint8_t>;

inline constexpr std::uint32_t kSampleMaxJpegBytes = 1024 * 1024;

inline Bytes bytes_of(std::string_view text) { return {text.begin(), text.end()}; }

inline std::string hex(std::span<const std::uint8_t> bytes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string result;
  for (const std::uint8_t byte : bytes) result.append({kDigits[byte >> 4], kDigits[byte & 15]});
  return result;
}

inline EncodedFrame mono_frame() {
  EncodedFrame frame{0x0102030405060708, -2, 0x11121314, 1226, 370, 0, {0xFF, 0xD8, 0, 0xFF, 0xD9}};
  frame.jpeg_crc = crc32(frame.jpeg);
  return frame;
}

/// A stereo one, since that has more to go wrong.
inline EncodedFrame sample_frame() {
  EncodedFrame frame = mono_frame();
  frame.jpeg = {0xFF, 0xD8, 1, 0xFF, 0xD9, 0xFF, 0xD8, 2, 2, 0xFF, 0xD9};
  frame.jpeg_crc = crc32(frame.jpeg);
  frame.left_bytes = 5;
  frame.quality = 30;
  return frame;
}

inline EncodedFrame reduced_frame() {
  EncodedFrame frame = sample_frame();
  frame.whole_bytes = 0x01020304;
  frame.whole_crc = 0x11121314;
  return frame;
}

inline Bytes encode_whole(const EncodedFrame& frame) {
  const auto head = encode_frame_head(frame);
  Bytes bytes(head.size() + frame.jpeg.size());
  std::copy(frame.jpeg.begin(), frame.jpeg.end(),
            std::copy(head.begin(), head.end(), bytes.begin()));
  return bytes;
}

inline std::vector<DropRecord> sample_drops() {
  return {{10, -1, DropReason::kPolicy, 257},
          {11, 0, DropReason::kBusy, kUnknownSimilarity, 3, 2},
          {14, 3, DropReason::kLost}};
}

inline Account sample_account() {
  return {"s1", true, true, 0x0102030405060708, -2, 7, 5, 3, sample_drops(), {}};
}

/// By name: items have a payload for each stream, and an item of a stream without one of its own.
inline std::map<std::string, Bytes> sample_messages() {
  const Hello hello{6,
                    7,
                    "tb3-07",
                    "20201024T101500Z",
                    "orbbufd 0.1.0",
                    "0.5\t0.5\n",
                    {{4, "imu", "orbbuf/imu"}, {31, "scan", ""}}};
  Welcome welcome;
  welcome.position = {0x0102030405060708, 0x1112131415161718};
  welcome.max_frame_bytes = 16U << 20;
  welcome.position[4] = 9;
  welcome.takes.set(kFrames).set(kDrops).set(kLate).set(kAccounts).set(4);
  welcome.has_heartbeat = true;
  Ack ack{{7, 3}, 9};
  ack.position[kMostStreams - 1] = 2;
  Report report{{21, 1, 2, 3, 4, 5, 6}, 25, 80'000, 1'000'000, 40'000, -2, 7};
  report.captured_items[4] = 9;
  return {{"hello", encode(hello)},
          {"welcome", encode(welcome)},
          {"frame", encode_whole(reduced_frame())},
          {"ack", encode(ack)},
          {"drops", encode(Items{kDrops, 5, encode_drops(sample_drops())})},
          {"late", encode(Items{kLate, 7, encode_late_part({3, 7, as_bytes("late")})})},
          {"account", encode(Items{kAccounts, 0, encode_account(sample_account())})},
          {"other",
           encode(Items{4, 0x0102030405060708, bytes_of(std::string_view("\0\1one item", 10))})},
          {"stats", encode(report)},
          {"bye", encode(Bye{{8, 4}})},
          {"error", encode(ErrorMessage{ErrorCode::kVersion, "no version in common"})}};
}

inline Parsed<Header> header_of(std::span<const std::uint8_t> message) {
  return parse_header(message.first<kHeaderBytes>(), kSampleMaxJpegBytes);
}

/// Makes header and body agree again after either was changed: lengths and checksums.
inline void reseal(Bytes& message) {
  const auto body = std::span(message).subspan(kHeaderBytes);
  store(&message[8], static_cast<std::uint32_t>(body.size()));
  store(&message[12], crc32(body));
  store(&message[16], crc32(std::span(message).first(16)));
}

template <class Message>
Parsed<Bytes> encode_again(const Parsed<Message>& message) {
  if (!message) return message.error();
  return encode(message.value());
}

/// Parses the payload, if it is one that this version defines, and encodes what came of it.
inline Parsed<Bytes> payload_and_back(const Items& items) {
  switch (items.stream) {
    case kDrops: {
      const auto drops = parse_drops(items.payload);
      return drops ? Parsed<Bytes>(encode_drops(drops.value())) : drops.error();
    }
    case kLate: {
      const auto part = parse_late_part(items.payload);
      return part ? Parsed<Bytes>(encode_late_part(part.value())) : part.error();
    }
    case kAccounts: {
      const auto account = parse_account(items.payload);
      return account ? Parsed<Bytes>(encode_account(account.value())) : account.error();
    }
    default:
      return items.payload;
  }
}

inline Parsed<Bytes> items_and_back(const Header& header, std::span<const std::uint8_t> body) {
  const auto items = parse_items(header, body);
  if (!items) return items.error();
  auto payload = payload_and_back(items.value());
  if (!payload) return payload;
  return encode(Items{items.value().stream, items.value().first, std::move(payload).value()});
}

/// The same with any body.
inline Parsed<Bytes> body_and_back(const Header& header, std::span<const std::uint8_t> body) {
  switch (header.type) {
    case Type::kHello:
      return encode_again(parse_hello(header, body));
    case Type::kWelcome:
      return encode_again(parse_welcome(header, body));
    case Type::kAck:
      return encode_again(parse_ack(header, body));
    case Type::kItems:
      return items_and_back(header, body);
    case Type::kStats:
      return encode_again(parse_stats(header, body));
    case Type::kBye:
      return encode_again(parse_bye(header, body));
    case Type::kError:
      return encode_again(parse_error(header, body));
    case Type::kFrame:
      break;
  }
  const auto jpeg = body.subspan(kFrameMetaBytes);
  const auto frame =
      parse_frame(header, body.first<kFrameMetaBytes>(), Bytes(jpeg.begin(), jpeg.end()));
  if (!frame) return frame.error();
  return encode_whole(frame.value());
}

/// Reads one message from the front of a stream and encodes it again.
inline Parsed<Bytes> there_and_back(std::span<const std::uint8_t> stream) {
  const Fault too_short{ErrorCode::kMalformed, "stream ends"};
  if (stream.size() < kHeaderBytes) return too_short;
  const auto header = header_of(stream);
  if (!header) return header.error();
  const std::size_t body_bytes = header.value().body_bytes;
  if (stream.size() - kHeaderBytes < body_bytes) return too_short;
  return body_and_back(header.value(), stream.subspan(kHeaderBytes, body_bytes));
}

/// What is wrong with `stream`; "accepted" if nothing is.
inline std::string fault_of(std::span<const std::uint8_t> stream) {
  const auto result = there_and_back(stream);
  return result ? "accepted" : result.error().text;
}

}  // namespace orbbuf::wire
