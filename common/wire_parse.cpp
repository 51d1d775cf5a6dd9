// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <limits>
#include <optional>
#include <utility>

#include "common/wire_fields.hpp"

namespace orbbuf::wire {
namespace {

constexpr std::size_t kHeaderCrcOffset = 16;
constexpr std::size_t kDropRecordBytes = 35;

/// One below this is the last usable number, so that a position after it can be expressed.
constexpr std::uint64_t kEndOfNumbers = std::numeric_limits<std::uint64_t>::max();

Fault malformed(std::string text) { return {ErrorCode::kMalformed, std::move(text)}; }

Fault too_large(std::string_view what, std::uint64_t bytes, std::uint64_t limit) {
  return {ErrorCode::kTooLarge,
          fmt::format("{} of {} bytes is over the limit of {}", what, bytes, limit)};
}

/// `text` with '?' for each control character not in `allowed`, so that a peer can neither forge a
/// log line nor drive a terminal. U+0080 .. U+009F (C2 80 .. C2 9F) are control characters as well.
std::string clean(std::string_view text, std::string_view allowed = {}) {
  std::string result;
  result.reserve(text.size());
  for (const char c : text) {
    const auto byte = static_cast<std::uint8_t>(c);
    if (byte >= 0x80 && byte <= 0x9F && result.ends_with('\xC2')) {
      result.back() = '?';
    } else if ((byte < 0x20 || byte == 0x7F) && allowed.find(c) == std::string_view::npos) {
      result.push_back('?');
    } else {
      result.push_back(c);
    }
  }
  return result;
}

/// Who spoke to us, if not a peer: `"GET " (47 45 54 20)`.
std::string quote(std::span<const std::uint8_t> bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text.push_back(byte >= 0x20 && byte < 0x7F ? static_cast<char>(byte) : '.');
  }
  return fmt::format("\"{}\" ({:02x})", text, fmt::join(bytes, " "));
}

bool is_type(std::uint8_t type) {
  return type != 0 && type <= static_cast<std::uint8_t>(Type::kError);
}

std::optional<Fault> check_length(const Header& header, std::uint32_t max_jpeg_bytes) {
  const bool is_frame = header.type == Type::kFrame;
  const std::uint64_t limit =
      is_frame ? std::uint64_t{kFrameMetaBytes} + max_jpeg_bytes
               : (header.type == Type::kItems ? kMaxItemsBytes : kMaxControlBytes);
  if (header.body_bytes > limit) {
    return too_large(fmt::format("{} body", to_string(header.type)), header.body_bytes, limit);
  }
  if (is_frame && header.body_bytes <= kFrameMetaBytes) {
    return malformed(fmt::format("frame body of {} bytes holds no JPEG", header.body_bytes));
  }
  return std::nullopt;
}

/// One body on its way into a message. The first thing found wrong is what finish() tells; whatever
/// is taken after it is zero or empty.
class Body {
 public:
  Body(const Header& header, std::span<const std::uint8_t> body)
      : Body(header, body, body.size(), crc32(body)) {}

  /// For a part of a body that was checked.
  Body(std::string_view what, std::span<const std::uint8_t> bytes) : what_(what), reader_(bytes) {}

  /// For a body that is only in part in `begin`.
  Body(const Header& header, std::span<const std::uint8_t> begin, std::size_t body_bytes,
       std::uint32_t body_crc)
      : what_(to_string(header.type)), reader_(begin) {
    if (body_bytes != header.body_bytes) {
      fail(malformed(fmt::format("{} body has {} bytes, its header says {}", what_, body_bytes,
                                 header.body_bytes)));
    } else if (body_crc != header.body_crc) {
      fail(malformed(fmt::format("{} body does not match its checksum", what_)));
    }
  }

  template <std::integral T>
  T take() {
    return reader_.take<T>();
  }
  template <class... Values>
  void fields(Values&... values) {
    reader_.fields(values...);
  }
  Reader& reader() { return reader_; }

  void take_zeros(std::size_t count) {
    require(reader_.take_zeros(count), "reserved bytes are not zero");
  }

  /// `streams`, if not null: those that it names.
  Position take_position(std::bitset<kMostStreams>* streams = nullptr) {
    Position position;
    const std::size_t count = take<std::uint16_t>();
    for (std::size_t i = 0, least = 0; i < count; ++i) {
      const StreamId id = take_stream_id(least);
      const auto next = take<std::uint64_t>();
      if (is_wrong()) break;
      position[id] = next;
      if (streams != nullptr) streams->set(id);
      least = id + 1U;
    }
    return position;
  }

  /// Of a list in ascending order.
  StreamId take_stream_id(std::size_t least) {
    const auto id = take<StreamId>();
    require(id >= least && id < kMostStreams,
            fmt::format("stream {}, not {} to {}", id, least, kMostStreams - 1));
    return id;
  }

  /// A fault was found, or too few bytes.
  bool is_wrong() const { return fault_ || reader_.is_short(); }

  std::span<const std::uint8_t> take_bytes(std::size_t count) { return reader_.take_bytes(count); }

  std::string_view take_text(std::string_view what, std::size_t limit) {
    const std::string_view text = reader_.take_text();
    if (text.size() > limit) {
      fail(too_large(fmt::format("{}: {}", what_, what), text.size(), limit));
    }
    return text;
  }

  std::string take_id(std::string_view what) {
    const std::string_view id = take_text(what, kMaxIdBytes);
    if (!is_valid_id(id)) require(false, fmt::format("{} \"{}\" is not valid", what, clean(id)));
    return std::string(id);
  }

  std::size_t left() const { return reader_.left(); }

  void require(bool is_so, std::string_view otherwise) {
    if (!is_so) fail(malformed(fmt::format("{}: {}", what_, otherwise)));
  }

  void fail(Fault fault) {
    if (fault_ || reader_.is_short()) return;
    fault_ = std::move(fault);
    reader_ = Reader({});
  }

  /// `message`, if nothing was wrong and no byte is left over.
  template <class Message>
  Parsed<Message> finish(Message message) {
    if (fault_) return *std::move(fault_);
    if (reader_.is_short()) return malformed(fmt::format("{} ends too early", what_));
    if (left() > 0) {
      return malformed(fmt::format("{} has {} bytes too many", what_, left()));
    }
    return message;
  }

 private:
  std::string_view what_;
  Reader reader_;
  std::optional<Fault> fault_;
};

DropRecord take_drop_record(Body& in) {
  DropRecord record;
  wire::fields(in.reader(), record);
  in.require(record.sequence < kEndOfNumbers, "sequence number out of range");
  in.require(record.frames >= 1 && record.frames <= kEndOfNumbers - record.sequence,
             fmt::format("{} frames from {} on", record.frames, record.sequence));
  in.require(!to_string(record.reason).empty(),
             fmt::format("unknown drop reason {}", static_cast<unsigned>(record.reason)));
  return record;
}

/// To the end of the body.
std::vector<DropRecord> take_drops(Body& in, std::size_t least) {
  std::vector<DropRecord> records;
  const std::size_t count = in.take<std::uint16_t>();
  in.require(count >= least && count <= kMaxDropsPerMessage,
             fmt::format("{} records, not {} to {}", count, least, kMaxDropsPerMessage));
  in.require(in.left() == count * kDropRecordBytes,
             fmt::format("{} bytes are not {} records", in.left(), count));
  if (in.is_wrong()) return records;
  records.reserve(count);
  for (std::size_t i = 0; i < count; ++i) records.push_back(take_drop_record(in));
  return records;
}

std::vector<StreamDeclaration> take_streams(Body& in) {
  std::vector<StreamDeclaration> streams;
  const std::size_t count = in.take<std::uint16_t>();
  for (std::size_t i = 0, least = kFirstOther; i < count && !in.is_wrong(); ++i) {
    StreamDeclaration stream;
    stream.id = in.take_stream_id(least);
    stream.name = clean(in.take_text("name of a stream", kMaxNameBytes));
    stream.codec = clean(in.take_text("codec", kMaxNameBytes));
    in.require(!stream.name.empty() && std::ranges::find(streams, stream.name,
                                                         &StreamDeclaration::name) == streams.end(),
               fmt::format("stream {}: its name \"{}\" is empty or another stream's", stream.id,
                           stream.name));
    least = stream.id + 1U;
    streams.push_back(std::move(stream));
  }
  return streams;
}

}  // namespace

Parsed<Header> parse_header(std::span<const std::uint8_t, kHeaderBytes> bytes,
                            std::uint32_t max_jpeg_bytes) {
  Reader in(bytes);
  if (in.take<std::uint32_t>() != kMagic) {
    constexpr std::array<std::uint8_t, 2> kTlsHandshake = {0x16, 3};
    if (std::ranges::equal(bytes.first(2), kTlsHandshake)) {
      return malformed(
          "the peer speaks TLS, and this end does not: set [tls] here, or remove it there");
    }
    return malformed("not an ORBBuf peer: first bytes " + quote(bytes.first(4)));
  }
  if (const auto format = in.take<std::uint8_t>(); format != kHeaderFormat) {
    return malformed(fmt::format("unknown header format {}", format));
  }
  if (load<std::uint32_t>(&bytes[kHeaderCrcOffset]) != crc32(bytes.first(kHeaderCrcOffset))) {
    return malformed("header does not match its checksum");
  }
  const auto type = in.take<std::uint8_t>();
  if (!is_type(type)) return malformed(fmt::format("unknown message type {}", type));
  if (!in.take_zeros(2)) return malformed("reserved bytes of the header are not zero");

  Header header;
  header.type = static_cast<Type>(type);
  header.body_bytes = in.take<std::uint32_t>();
  header.body_crc = in.take<std::uint32_t>();
  if (auto fault = check_length(header, max_jpeg_bytes)) return *std::move(fault);
  return header;
}

Parsed<Hello> parse_hello(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kHello);
  Body in(header, body);
  Hello hello;
  in.fields(hello.min_version, hello.max_version);
  in.take_zeros(2);
  in.require(hello.min_version <= hello.max_version, "version range is empty");
  hello.robot_id = in.take_id("robot id");
  hello.session_id = in.take_id("session id");
  hello.software = clean(in.take_text("software name", kMaxTextBytes));
  hello.calibration = clean(in.take_text("calibration", kMaxCalibrationBytes), "\t\n\r");
  hello.streams = take_streams(in);
  return in.finish(std::move(hello));
}

Parsed<Welcome> parse_welcome(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kWelcome);
  Body in(header, body);
  Welcome welcome;
  welcome.version = in.take<std::uint8_t>();
  const auto flags = in.take<std::uint8_t>();
  in.require((flags & ~kHasHeartbeat) == 0, "reserved bits are not zero");
  welcome.has_heartbeat = (flags & kHasHeartbeat) != 0;
  in.take_zeros(2);
  welcome.max_frame_bytes = in.take<std::uint32_t>();
  welcome.position = in.take_position(&welcome.takes);
  in.require(welcome.takes[kFrames] && welcome.takes[kDrops], "without frames or drop records");
  return in.finish(welcome);
}

Parsed<Ack> parse_ack(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kAck);
  Body in(header, body);
  Ack ack{in.take_position(), in.take<std::uint64_t>()};
  in.require(ack.received >= ack.position[kFrames], "received is below the position");
  if (in.left() > 0) ack.pause = clean(in.take_text("pause", kMaxTextBytes));
  return in.finish(ack);
}

Parsed<Items> parse_items(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kItems);
  Body in(header, body);
  Items items;
  in.fields(items.stream, items.first);
  in.require(items.stream != kFrames && items.stream < kMostStreams,
             fmt::format("of stream {}", items.stream));
  in.require(items.first < kEndOfNumbers, "number out of range");
  const auto payload = in.take_bytes(in.left());
  in.require(!payload.empty(), "no payload");
  items.payload.assign(payload.begin(), payload.end());
  return in.finish(std::move(items));
}

Parsed<std::vector<DropRecord>> parse_drops(std::span<const std::uint8_t> payload) {
  Body in("drop records", payload);
  return in.finish(take_drops(in, 1));
}

Parsed<Report> parse_stats(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kStats);
  Body in(header, body);
  Report report;
  wire::fields(in.reader(), report);
  report.captured_items = in.take_position();
  return in.finish(report);
}

Parsed<Bye> parse_bye(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kBye);
  Body in(header, body);
  return in.finish(Bye{in.take_position()});
}

Parsed<ErrorMessage> parse_error(const Header& header, std::span<const std::uint8_t> body) {
  assert(header.type == Type::kError);
  Body in(header, body);
  const auto code = in.take<std::uint16_t>();
  const bool is_known = code != 0 && code <= static_cast<std::uint16_t>(ErrorCode::kSentAway);
  // A newer peer may have reasons of its own; its text still tells them.
  return in.finish(ErrorMessage{is_known ? static_cast<ErrorCode>(code) : ErrorCode::kRefused,
                                clean(in.take_text("text", kMaxTextBytes))});
}

Parsed<LatePart> parse_late_part(std::span<const std::uint8_t> payload) {
  Body in("late frame", payload);
  LatePart part;
  in.fields(part.offset, part.record_bytes);
  part.bytes = in.take_bytes(in.left());
  in.require(
      !part.bytes.empty() && std::uint64_t{part.offset} + part.bytes.size() <= part.record_bytes,
      fmt::format("{} bytes from {} on are no part of {}", part.bytes.size(), part.offset,
                  part.record_bytes));
  return in.finish(part);
}

Parsed<Account> parse_account(std::span<const std::uint8_t> payload) {
  Body in("account", payload);
  Account account;
  account.session_id = in.take_id("session id");
  const auto flags = in.take<std::uint8_t>();
  in.require((flags & ~(kIsFinal | kHasEnded)) == 0, "reserved bits are not zero");
  account.is_final = (flags & kIsFinal) != 0;
  account.has_ended = (flags & kHasEnded) != 0;
  in.fields(account.captured, account.last_capture_time_ns, account.confirmed, account.held,
            account.first_held);
  for (StreamDeclaration& stream : take_streams(in)) {
    account.streams.push_back({std::move(stream), 0, 0});
  }
  for (StreamAccount& each : account.streams) in.fields(each.captured, each.held);
  account.given_up = take_drops(in, 0);
  in.require(account.captured < kEndOfNumbers, "sequence number out of range");
  const Sequence end = known_end(account);
  in.require(account.captured == end,
             fmt::format("frame {} is beyond the {} captured", end - 1, account.captured));
  return in.finish(std::move(account));
}

Parsed<LateFrame> parse_late_record(std::span<const std::uint8_t> record) {
  Reader in(record);
  LateFrame late;
  const std::string_view session_id = in.take_text();
  const auto type = in.take<Type>();
  const auto crc = in.take<std::uint32_t>();
  const bool is_items = type == Type::kItems;
  if (in.is_short() || (!is_items && (type != Type::kFrame || in.left() <= kFrameMetaBytes))) {
    return malformed(fmt::format("late frame of {} bytes holds no JPEG", record.size()));
  }
  if (!is_valid_id(session_id)) {
    return malformed(fmt::format("late frame: session id \"{}\" is not valid", clean(session_id)));
  }
  late.session_id = session_id;
  const auto body = record.last(in.left());
  const Header header{type, static_cast<std::uint32_t>(body.size()), crc};
  if (is_items) {
    auto items = parse_items(header, body);
    if (!items) return std::move(items).error();
    if (items.value().stream < kFirstOther) return malformed("late items of a stream of frames");
    late.items = std::move(items).value();
    return late;
  }
  auto frame = parse_frame(header, body.first<kFrameMetaBytes>(),
                           {body.begin() + kFrameMetaBytes, body.end()});
  if (!frame) return std::move(frame).error();
  late.frame = std::move(frame).value();
  if (late.frame.is_reduced()) return malformed("late frame: it is not whole");
  return late;
}

Parsed<EncodedFrame> parse_frame(const Header& header,
                                 std::span<const std::uint8_t, kFrameMetaBytes> meta,
                                 std::vector<std::uint8_t> jpeg) {
  assert(header.type == Type::kFrame);
  EncodedFrame frame;
  frame.jpeg_crc = crc32(jpeg);
  const auto body_crc = static_cast<std::uint32_t>(
      ::crc32_combine(crc32(meta), frame.jpeg_crc, static_cast<z_off_t>(jpeg.size())));
  Body in(header, meta, kFrameMetaBytes + jpeg.size(), body_crc);
  std::uint8_t encoding = 0;
  in.fields(frame.sequence, frame.capture_time_ns, frame.exposure_ns, frame.width_px,
            frame.height_px, encoding, frame.quality);
  in.take_zeros(2);
  in.fields(frame.left_bytes, frame.whole_bytes, frame.whole_crc);
  in.require(!jpeg.empty(), "no JPEG");
  in.require(frame.left_bytes >= 1 && frame.left_bytes <= jpeg.size(),
             fmt::format("left image of {} bytes, of {}", frame.left_bytes, jpeg.size()));
  in.require(encoding == kJpegEncoding, fmt::format("unknown image encoding {}", encoding));
  in.require(frame.quality <= kMaxQuality, fmt::format("quality {}", frame.quality));
  in.require(frame.whole_bytes > jpeg.size() || (frame.whole_bytes == 0 && frame.whole_crc == 0),
             fmt::format("reduced from {} bytes to {}", frame.whole_bytes, jpeg.size()));
  in.require(frame.sequence < kEndOfNumbers, "sequence number out of range");
  frame.jpeg = std::move(jpeg);
  return in.finish(std::move(frame));
}

}  // namespace orbbuf::wire
