// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_format.hpp"

#include "common/wire_fields.hpp"

namespace orbbuf::record_format {
namespace {

using wire::FieldsOf;
using wire::Reader;
using wire::Writer;

// Each list of fields is for both directions.

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, Account>& account) {
  archive.fields(account.name);
  archive.flags(account.has_ended, account.is_settled);
  archive.fields(account.captured, account.last_capture_time_ns, account.confirmed,
                 account.settled_below);
  archive.list(account.streams, [&](auto& each) {
    archive.fields(each.stream.id, each.stream.name, each.stream.codec, each.captured,
                   each.settled);
    archive.require(each.stream.id < wire::kMostStreams);
  });
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, wire::Items>& items) {
  archive.fields(items.stream, items.first);
  archive.rest(items.payload);
}

/// All but the JPEG.
template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, EncodedFrame>& frame) {
  archive.fields(frame.sequence, frame.capture_time_ns, frame.exposure_ns, frame.width_px,
                 frame.height_px, frame.left_bytes, frame.jpeg_crc, frame.quality);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, std::vector<Sequence>>& numbers) {
  archive.list(numbers, [&](auto& number) { archive.fields(number); });
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, IndexEntry>& entry) {
  archive.list(entry.kept,
               [&](auto& frame) { archive.fields(frame.sequence, frame.offset, frame.bytes); });
  fields(archive, entry.released);
  archive.list(entry.items, [&](auto& each) {
    archive.fields(each.first, each.second.sequence, each.second.count, each.second.offset,
                   each.second.bytes);
  });
}

}  // namespace

void put(Writer& out, const Account& account, const DropRanges& given_up) {
  fields(out, account);
  out.list(given_up.by_number(), [&](const auto& entry) { wire::fields(out, entry.second); });
}

std::optional<Account> take_account(Reader& in, DropRanges& given_up) {
  Account account;
  fields(in, account);
  for (auto count = in.take<std::uint32_t>(); count > 0 && !in.is_short(); --count) {
    DropRecord record;
    wire::fields(in, record);
    in.require(record.frames > 0 && record.frames <= ~std::uint64_t{0} - record.sequence &&
               !to_string(record.reason).empty());
    if (!in.is_short()) given_up.add(record);
  }
  if (in.is_short()) return std::nullopt;
  return account;
}

std::vector<std::uint8_t> frame_head(std::string_view name, const EncodedFrame& frame) {
  Writer out(0);
  out.put(name);
  fields(out, frame);
  return std::move(out.bytes());
}

std::optional<std::pair<std::string, EncodedFrame>> parse_frame(Bytes body) {
  Reader in(body);
  std::pair<std::string, EncodedFrame> parsed;
  auto& [name, frame] = parsed;
  in.fields(name);
  fields(in, frame);
  in.rest(frame.jpeg);
  if (in.is_short() || frame.jpeg.empty()) return std::nullopt;
  return parsed;
}

std::vector<std::uint8_t> encode_items(std::string_view name, const wire::Items& items) {
  Writer out(0);
  out.put(name);
  fields(out, items);
  return std::move(out.bytes());
}

std::uint16_t count_of(const wire::Items& items) {
  return Reader(items.payload).take<std::uint16_t>();
}

std::optional<std::pair<std::string, wire::Items>> parse_items(Bytes body) {
  Reader in(body);
  std::pair<std::string, wire::Items> parsed;
  in.fields(parsed.first);
  fields(in, parsed.second);
  if (in.is_short() || parsed.second.payload.empty()) return std::nullopt;
  return parsed;
}

std::vector<std::uint8_t> encode_released(std::string_view name,
                                          const std::vector<Sequence>& released) {
  Writer out(0);
  out.put(name);
  fields(out, released);
  return std::move(out.bytes());
}

std::optional<std::pair<std::string, std::vector<Sequence>>> parse_released(Bytes body) {
  Reader in(body);
  std::pair<std::string, std::vector<Sequence>> parsed;
  in.fields(parsed.first);
  fields(in, parsed.second);
  if (in.is_short()) return std::nullopt;
  return parsed;
}

std::vector<std::uint8_t> encode(const Index& index) {
  Writer out(0);
  out.list(index, [&](const auto& session) {
    out.put(session.first);
    fields(out, session.second);
  });
  out.put(static_cast<std::uint32_t>(out.bytes().size()));
  return std::move(out.bytes());
}

std::optional<Index> parse_index(Bytes body, std::uint32_t segment) {
  Reader in(body);
  Index index;
  for (auto sessions = in.take<std::uint32_t>(); sessions > 0 && !in.is_short(); --sessions) {
    IndexEntry& entry = index[in.take<std::string>()];
    fields(in, entry);
    const auto place = [segment](KeptFrame& frame) {
      frame.segment = segment;
      frame.state = KeptFrame::State::kWritten;
    };
    for (KeptFrame& frame : entry.kept) place(frame);
    for (auto& [stream, frame] : entry.items) place(frame);
  }
  if (in.is_short()) return std::nullopt;
  return index;
}

}  // namespace orbbuf::record_format
