// SPDX-License-Identifier: Apache-2.0
#include "server/session/records.hpp"

#include <boost/mp11/algorithm.hpp>
#include <type_traits>

#include "common/wire_fields.hpp"

namespace orbbuf {
namespace {

constexpr std::uint8_t kVersion = 2;
constexpr unsigned kOffsetBits = 40;

using wire::FieldsOf;
using wire::Reader;
using wire::Writer;

// Each list of fields is for both directions. A Reader that does not find what there must be is
// short from then on.

void fields(Writer& out, const journal::Place& place) {
  out.put(std::uint64_t{place.segment} << kOffsetBits | place.offset);
}

void fields(Reader& in, journal::Place& place) {
  const auto bits = in.take<std::uint64_t>();
  place = {static_cast<std::uint32_t>(bits >> kOffsetBits),
           bits & ((std::uint64_t{1} << kOffsetBits) - 1)};
}

void fields(Writer& out, const wire::Position& position) { wire::put_position(out, position); }

void fields(Reader& in, wire::Position& position) {
  for (auto count = in.take<std::uint16_t>(); count > 0 && !in.is_short(); --count) {
    const auto id = in.take<wire::StreamId>();
    const auto next = in.take<std::uint64_t>();
    if (id < wire::kMostStreams) position[id] = next;
  }
}

void fields(Writer& out, const wire::Account& account) {
  out.put_bytes(wire::encode_account(account));
}

void fields(Reader& in, wire::Account& account) {
  auto parsed = wire::parse_account(in.take_bytes(in.left()));
  in.require(parsed.has_value());
  if (parsed) account = std::move(parsed).value();
}

/// With its size in front; 0: there is none.
void fields(Writer& out, const std::optional<wire::Account>& account) {
  const auto payload = account ? wire::encode_account(*account) : std::vector<std::uint8_t>();
  out.put(static_cast<std::uint16_t>(payload.size()));
  out.put_bytes(payload);
}

void fields(Reader& in, std::optional<wire::Account>& account) {
  const auto payload = in.take_bytes(in.take<std::uint16_t>());
  if (payload.empty()) return;
  Reader rest(payload);
  fields(rest, account.emplace());
  in.require(!rest.is_short());
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, RecordedPart>& part) {
  archive.fields(part.number);
  fields(archive, part.from);
  fields(archive, part.to);
  archive.fields(part.is_only_copy, part.image_bytes);
}

/// Whether it is there, and what it is then.
template <class Archive, class Value, class Fields>
void optional_fields(Archive& archive, Value& value, Fields fields_of) {
  bool is_there = value.has_value();
  archive.fields(is_there);
  if (!is_there) return;
  if constexpr (std::is_same_v<Archive, Reader>) value.emplace();
  fields_of(*value);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, SessionSummary>& summary) {
  auto& [info, position, totals, end, late_end, is_closed, closing, account, part, removed] =
      summary;
  std::uint8_t version = kVersion;
  archive.fields(version);
  archive.require(version == kVersion);
  archive.fields(info.robot_id, info.session_id, info.calibration);
  archive.list(info.streams, [&](auto& stream) {
    archive.fields(stream.id, stream.name, stream.codec);
    archive.require(stream.id < wire::kMostStreams);
  });
  fields(archive, position);
  archive.fields(totals.live, totals.late, totals.replaced, totals.named, totals.image_bytes,
                 totals.late_items, end, late_end, is_closed, closing.has_ended);
  optional_fields(archive, closing.stats, [&](auto& stats) { wire::fields(archive, stats); });
  optional_fields(archive, closing.clock_offset_ns, [&](auto& ns) { archive.fields(ns); });
  fields(archive, account);
  optional_fields(archive, part, [&](auto& last) { fields(archive, last); });
  fields(archive, removed);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, RecordedFrame>& frame) {
  archive.flags(frame.is_late, frame.is_replacing);
  archive.fields(frame.quality, frame.width_px, frame.height_px, frame.sequence,
                 frame.capture_time_ns, frame.arrived_ns, frame.exposure_ns, frame.bytes,
                 frame.left_bytes, frame.crc, frame.crc_right, frame.whole_bytes, frame.whole_crc);
  if (frame.is_replacing) archive.fields(frame.replaced_bytes);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, RecordedItems>& items) {
  archive.fields(items.stream, items.first, items.next, items.is_late);
  archive.rest(items.payload);
  archive.require(items.stream != wire::kFrames && items.stream < wire::kMostStreams);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, RecordedReport>& report) {
  wire::fields(archive, report.stats);
  archive.fields(report.clock_offset_ns);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, RecordedCalibration>& calibration) {
  archive.fields(calibration.text);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, RecordedEnd>& end) {
  archive.fields(end.has_ended);
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

std::vector<DropRecord> drops_in(const RecordedItems& items) {
  if (items.stream != wire::kDrops) return {};
  auto drops = wire::parse_drops(items.payload);
  return drops ? std::move(drops).value() : std::vector<DropRecord>();
}

void add_items(const RecordedItems& items, SessionSummary& summary) {
  if (items.is_late) {
    ++summary.totals.late_items;
    return;
  }
  summary.position[items.stream] = items.next;
  for (const DropRecord& drop : drops_in(items)) {
    summary.totals.named += drop.frames;
    summary.end = std::max(summary.end, drop.end());
  }
}

/// The robot may have died before it said hello.
void add_account(const wire::Account& account, SessionSummary& summary) {
  summary.account = account;
  summary.account->given_up.clear();
  auto& streams = summary.info.streams;
  for (const wire::StreamAccount& each : account.streams) {
    const auto id = &wire::StreamDeclaration::id;
    const auto place = std::ranges::lower_bound(streams, each.stream.id, {}, id);
    if (place == streams.end() || place->id != each.stream.id) streams.insert(place, each.stream);
  }
}

}  // namespace

Sequence SessionSummary::captured() const {
  return std::max(known_end(), closing.stats ? closing.stats->captured : 0);
}

std::uint8_t type_of(const RecordBody& body) { return static_cast<std::uint8_t>(body.index()); }

std::vector<std::uint8_t> encode(const RecordBody& body, const journal::Place& kept) {
  Writer out(0);
  fields(out, kept);
  std::visit([&](const auto& each) { fields(out, each); }, body);
  return std::move(out.bytes());
}

std::optional<SessionRecord> decode_record(std::uint8_t type, std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kTypes = std::variant_size_v<RecordBody>;
  if (type >= kTypes) return std::nullopt;
  Reader in(bytes);
  journal::Place kept;
  fields(in, kept);
  auto body = boost::mp11::mp_with_index<kTypes>(type, [&](auto place) -> RecordBody {
    std::variant_alternative_t<place, RecordBody> each;
    fields(in, each);
    return each;
  });
  if (in.is_short() || in.left() > 0) return std::nullopt;
  return SessionRecord{kept, std::move(body)};
}

std::vector<DropRecord> named_by(const RecordBody& body) {
  if (const auto* const account = std::get_if<wire::Account>(&body)) return account->given_up;
  const auto* const items = std::get_if<RecordedItems>(&body);
  return items != nullptr ? drops_in(*items) : std::vector<DropRecord>();
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
          add_account(each, summary);
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
