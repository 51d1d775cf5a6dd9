// SPDX-License-Identifier: Apache-2.0
#include "server/session/records.hpp"

#include <algorithm>
#include <type_traits>

#include "common/byte_order.hpp"

namespace orbbuf {
namespace {

constexpr std::uint8_t kVersion = 1;
constexpr unsigned kOffsetBits = 40;

/// Bits of a frame.
constexpr std::uint8_t kIsLate = 1;
constexpr std::uint8_t kIsReplacing = 2;

using wire::Reader;
using wire::Writer;

void put(Writer& out, const journal::Place& place) {
  out.put(std::uint64_t{place.segment} << kOffsetBits | place.offset);
}

journal::Place take_place(Reader& in) {
  const auto place = in.take<std::uint64_t>();
  return {static_cast<std::uint32_t>(place >> kOffsetBits),
          place & ((std::uint64_t{1} << kOffsetBits) - 1)};
}

void put(Writer& out, const wire::Position& position) {
  const auto is_used = [&](wire::StreamId id) { return position[id] > 0; };
  std::uint16_t count = 0;
  for (wire::StreamId id = 0; id < wire::kMostStreams; ++id) {
    if (is_used(id)) ++count;
  }
  out.put(count);
  for (wire::StreamId id = 0; id < wire::kMostStreams; ++id) {
    if (!is_used(id)) continue;
    out.put(id);
    out.put(position[id]);
  }
}

wire::Position take_position(Reader& in) {
  wire::Position position;
  for (auto count = in.take<std::uint16_t>(); count > 0 && !in.is_short(); --count) {
    const auto id = in.take<wire::StreamId>();
    const auto next = in.take<std::uint64_t>();
    if (id < wire::kMostStreams) position[id] = next;
  }
  return position;
}

void put(Writer& out, const wire::Stats& stats) {
  for (const std::uint64_t count : {stats.captured, stats.skipped, stats.failed, stats.dropped,
                                    stats.acknowledged, stats.waiting, stats.in_flight}) {
    out.put(count);
  }
}

wire::Stats take_stats(Reader& in) {
  wire::Stats stats;
  for (std::uint64_t* count : {&stats.captured, &stats.skipped, &stats.failed, &stats.dropped,
                               &stats.acknowledged, &stats.waiting, &stats.in_flight}) {
    *count = in.take<std::uint64_t>();
  }
  return stats;
}

void put(Writer& out, const RecordedPart& part) {
  out.put(part.number);
  put(out, part.from);
  put(out, part.to);
  out.put(static_cast<std::uint8_t>(part.is_only_copy));
  out.put(part.image_bytes);
}

void put(Writer& out, const SessionSummary& summary) {
  const auto& [info, position, totals, end, late_end, is_closed, closing, account, part, removed] =
      summary;
  out.put(kVersion);
  out.put_text(info.robot_id);
  out.put_text(info.session_id);
  out.put_text(info.calibration);
  out.put(static_cast<std::uint16_t>(info.streams.size()));
  for (const wire::StreamDeclaration& stream : info.streams) {
    out.put(stream.id);
    out.put_text(stream.name);
    out.put_text(stream.codec);
  }
  out.put(info.segment.epoch);
  put(out, info.segment.from);
  put(out, position);
  for (const std::uint64_t count : {totals.live, totals.late, totals.replaced, totals.named,
                                    totals.image_bytes, end, late_end}) {
    out.put(count);
  }
  out.put(static_cast<std::uint8_t>(is_closed));
  out.put(static_cast<std::uint8_t>(closing.has_ended));
  out.put(static_cast<std::uint8_t>(closing.stats.has_value()));
  if (closing.stats) put(out, *closing.stats);
  out.put(static_cast<std::uint8_t>(closing.clock_offset_ns.has_value()));
  if (closing.clock_offset_ns) out.put(*closing.clock_offset_ns);
  const auto payload = account ? wire::encode_account(*account) : std::vector<std::uint8_t>();
  out.put(static_cast<std::uint16_t>(payload.size()));
  out.put_bytes(payload);
  out.put(static_cast<std::uint8_t>(part.has_value()));
  if (part) put(out, *part);
  put(out, removed);
}

RecordedPart take_part(Reader& in) {
  RecordedPart part;
  part.number = in.take<std::uint32_t>();
  part.from = take_place(in);
  part.to = take_place(in);
  part.is_only_copy = in.take<std::uint8_t>() != 0;
  part.image_bytes = in.take<std::uint64_t>();
  return part;
}

std::optional<SessionSummary> take_summary(Reader& in) {
  if (in.take<std::uint8_t>() != kVersion) return std::nullopt;
  SessionSummary summary;
  auto& [info, position, totals, end, late_end, is_closed, closing, account, part, removed] =
      summary;
  info.robot_id = in.take_text();
  info.session_id = in.take_text();
  info.calibration = in.take_text();
  for (auto count = in.take<std::uint16_t>(); count > 0 && !in.is_short(); --count) {
    wire::StreamDeclaration stream;
    stream.id = in.take<wire::StreamId>();
    stream.name = in.take_text();
    stream.codec = in.take_text();
    if (stream.id < wire::kMostStreams) info.streams.push_back(std::move(stream));
  }
  info.segment.epoch = in.take<std::uint64_t>();
  info.segment.from = take_position(in);
  position = take_position(in);
  for (std::uint64_t* count : {&totals.live, &totals.late, &totals.replaced, &totals.named,
                               &totals.image_bytes, &end, &late_end}) {
    *count = in.take<std::uint64_t>();
  }
  is_closed = in.take<std::uint8_t>() != 0;
  closing.has_ended = in.take<std::uint8_t>() != 0;
  if (in.take<std::uint8_t>() != 0) closing.stats = take_stats(in);
  if (in.take<std::uint8_t>() != 0) closing.clock_offset_ns = in.take<std::int64_t>();
  if (const auto bytes = in.take<std::uint16_t>(); bytes > 0) {
    auto parsed = wire::parse_account(in.take_bytes(bytes));
    if (!parsed) return std::nullopt;
    account = std::move(parsed).value();
  }
  if (in.take<std::uint8_t>() != 0) part = take_part(in);
  removed = take_place(in);
  return summary;
}

void put(Writer& out, const RecordedFrame& frame) {
  out.put(static_cast<std::uint8_t>((frame.is_late ? kIsLate : 0) |
                                    (frame.is_replacing ? kIsReplacing : 0)));
  out.put(frame.quality);
  out.put(frame.width_px);
  out.put(frame.height_px);
  out.put(frame.sequence);
  out.put(frame.capture_time_ns);
  out.put(frame.arrived_ns);
  for (const std::uint32_t field : {frame.exposure_ns, frame.bytes, frame.left_bytes, frame.crc,
                                    frame.crc_right, frame.whole_bytes, frame.whole_crc}) {
    out.put(field);
  }
  if (frame.is_replacing) out.put(frame.replaced_bytes);
}

RecordedFrame take_frame(Reader& in) {
  RecordedFrame frame;
  const auto flags = in.take<std::uint8_t>();
  frame.is_late = (flags & kIsLate) != 0;
  frame.is_replacing = (flags & kIsReplacing) != 0;
  frame.quality = in.take<std::uint8_t>();
  frame.width_px = in.take<std::uint16_t>();
  frame.height_px = in.take<std::uint16_t>();
  frame.sequence = in.take<Sequence>();
  frame.capture_time_ns = in.take<std::int64_t>();
  frame.arrived_ns = in.take<std::int64_t>();
  for (std::uint32_t* field : {&frame.exposure_ns, &frame.bytes, &frame.left_bytes, &frame.crc,
                               &frame.crc_right, &frame.whole_bytes, &frame.whole_crc}) {
    *field = in.take<std::uint32_t>();
  }
  if (frame.is_replacing) frame.replaced_bytes = in.take<std::uint32_t>();
  return frame;
}

void put(Writer& out, const RecordedItems& items) {
  out.put(items.stream);
  out.put(items.first);
  out.put(items.next);
  out.put_bytes(items.payload);
}

std::optional<RecordedItems> take_items(Reader& in) {
  RecordedItems items;
  items.stream = in.take<wire::StreamId>();
  items.first = in.take<std::uint64_t>();
  items.next = in.take<std::uint64_t>();
  const auto payload = in.take_bytes(in.left());
  items.payload.assign(payload.begin(), payload.end());
  if (items.stream == wire::kFrames || items.stream >= wire::kMostStreams) return std::nullopt;
  return items;
}

void put(Writer& out, const RecordedReport& report) {
  put(out, report.stats);
  out.put(report.clock_offset_ns);
}

void put(Writer& out, const wire::Account& account) {
  out.put_bytes(wire::encode_account(account));
}

void put(Writer& out, const RecordedCalibration& calibration) { out.put_text(calibration.text); }

void put(Writer& out, const RecordedEnd& end) { out.put(static_cast<std::uint8_t>(end.has_ended)); }

std::optional<wire::Account> take_account(Reader& in) {
  auto account = wire::parse_account(in.take_bytes(in.left()));
  if (!account) return std::nullopt;
  return std::move(account).value();
}

/// The place in RecordBody is the type.
std::optional<RecordBody> take_body(std::uint8_t type, Reader& in) {
  switch (type) {
    case 0:
      return take_summary(in);
    case 1:
      return take_frame(in);
    case 2:
      return take_items(in);
    case 3: {
      const auto stats = take_stats(in);
      return RecordedReport{stats, in.take<std::int64_t>()};
    }
    case 4:
      return take_account(in);
    case 5:
      return RecordedCalibration{std::string(in.take_text())};
    case 6:
      return RecordedEnd{in.take<std::uint8_t>() != 0};
    case 7:
      return take_part(in);
    default:
      return std::nullopt;
  }
}

void add_frame(const RecordedFrame& frame, SessionSummary& summary) {
  SessionTotals& totals = summary.totals;
  totals.image_bytes += std::uint64_t{frame.bytes} - frame.replaced_bytes;
  if (!frame.is_late) {
    ++totals.live;
    summary.is_closed = summary.closing.has_ended = false;
    summary.position[wire::kFrames] = frame.sequence + 1;
  } else {
    ++(frame.is_replacing ? totals.replaced : totals.late);
    summary.late_end = std::max(summary.late_end, frame.sequence + 1);
  }
  summary.end = std::max(summary.end, frame.sequence + 1);
}

void add_items(const RecordedItems& items, SessionSummary& summary) {
  summary.position[items.stream] = items.next;
  if (items.stream != wire::kDrops) return;
  const auto drops = wire::parse_drops(items.payload);
  if (!drops) return;
  for (const DropRecord& drop : drops.value()) {
    summary.totals.named += drop.frames;
    summary.end = std::max(summary.end, drop.end());
  }
}

}  // namespace

Sequence SessionSummary::captured() const {
  return std::max(known_end(), closing.stats ? closing.stats->captured : 0);
}

std::uint8_t type_of(const RecordBody& body) { return static_cast<std::uint8_t>(body.index()); }

std::vector<std::uint8_t> encode(const RecordBody& body, const journal::Place& kept) {
  Writer out(0);
  put(out, kept);
  std::visit([&](const auto& each) { put(out, each); }, body);
  return std::move(out.bytes());
}

std::optional<SessionRecord> decode_record(std::uint8_t type, std::span<const std::uint8_t> bytes) {
  Reader in(bytes);
  const auto kept = take_place(in);
  auto body = take_body(type, in);
  if (!body || in.is_short() || in.left() > 0) return std::nullopt;
  return SessionRecord{kept, std::move(*body)};
}

bool is_clean_after(const RecordBody& body, bool is_clean) {
  return std::holds_alternative<RecordedEnd>(body) ||
         (is_clean && std::holds_alternative<RecordedPart>(body));
}

void add(const RecordBody& body, SessionSummary& summary) {
  std::visit(
      [&](const auto& each) {
        using Body = std::decay_t<decltype(each)>;
        if constexpr (std::is_same_v<Body, SessionSummary>) {
          summary = each;
        } else if constexpr (std::is_same_v<Body, RecordedFrame>) {
          add_frame(each, summary);
        } else if constexpr (std::is_same_v<Body, RecordedItems>) {
          add_items(each, summary);
        } else if constexpr (std::is_same_v<Body, RecordedReport>) {
          summary.closing = {false, each.stats, each.clock_offset_ns};
        } else if constexpr (std::is_same_v<Body, wire::Account>) {
          summary.account = each;
          summary.account->given_up.clear();
        } else if constexpr (std::is_same_v<Body, RecordedCalibration>) {
          summary.info.calibration = each.text;
        } else if constexpr (std::is_same_v<Body, RecordedEnd>) {
          summary.closing.has_ended = each.has_ended;
          summary.is_closed = true;
        } else if constexpr (std::is_same_v<Body, RecordedPart>) {
          summary.part = each;
          if (each.is_only_copy) {
            summary.totals.image_bytes -= each.image_bytes;
            summary.removed = std::max(summary.removed, each.to);
          }
        }
      },
      body);
}

Result<std::optional<RecordReader::Entry>> RecordReader::next() {
  for (;;) {
    const auto record = reader_.next();
    if (!record) return record.error();
    if (!record.value()) return std::nullopt;
    const auto& [type, place, end, body] = *record.value();
    if (auto decoded = decode_record(type, body)) return Entry{place, end, std::move(*decoded)};
    unknown_bytes_ += end.offset - place.offset;
  }
}

}  // namespace orbbuf
