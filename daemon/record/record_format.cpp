// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_format.hpp"

#include <limits>

namespace orbbuf::record_format {
namespace {

constexpr std::uint8_t kHasEnded = 1;
constexpr std::uint8_t kIsSettled = 2;

void put_numbers(wire::Writer& out, std::span<const Sequence> numbers) {
  out.put(static_cast<std::uint32_t>(numbers.size()));
  for (const Sequence number : numbers) out.put(number);
}

std::vector<Sequence> take_numbers(wire::Reader& in) {
  std::vector<Sequence> numbers;
  for (auto count = in.take<std::uint32_t>(); count > 0 && !in.is_short(); --count) {
    numbers.push_back(in.take<Sequence>());
  }
  return numbers;
}

/// Nothing: it is none.
std::optional<DropRecord> take_drop(wire::Reader& in) {
  DropRecord record;
  record.sequence = in.take<Sequence>();
  record.frames = in.take<std::uint64_t>();
  record.capture_time_ns = in.take<std::int64_t>();
  record.last_capture_time_ns = in.take<std::int64_t>();
  record.reason = static_cast<DropReason>(in.take<std::uint8_t>());
  record.similarity = in.take<std::uint16_t>();
  const bool is_range = record.frames > 0 && record.frames <= ~std::uint64_t{0} - record.sequence;
  if (in.is_short() || !is_range || to_string(record.reason).empty()) return std::nullopt;
  return record;
}

}  // namespace

void put(wire::Writer& out, const Account& account, const DropRanges& given_up) {
  out.put_text(account.name);
  out.put(static_cast<std::uint8_t>((account.has_ended ? kHasEnded : 0) |
                                    (account.is_settled ? kIsSettled : 0)));
  out.put(account.captured);
  out.put(account.last_capture_time_ns);
  out.put(account.confirmed);
  out.put(account.settled_below);
  out.put(static_cast<std::uint32_t>(given_up.size()));
  for (const auto& [number, record] : given_up.by_number()) {
    out.put(record.sequence);
    out.put(record.frames);
    out.put(record.capture_time_ns);
    out.put(record.last_capture_time_ns);
    out.put(static_cast<std::uint8_t>(record.reason));
    out.put(record.similarity);
  }
}

std::optional<Account> take_account(wire::Reader& in, DropRanges& given_up) {
  Account account;
  account.name = in.take_text();
  const auto flags = in.take<std::uint8_t>();
  account.has_ended = (flags & kHasEnded) != 0;
  account.is_settled = (flags & kIsSettled) != 0;
  account.captured = in.take<Sequence>();
  account.last_capture_time_ns = in.take<std::int64_t>();
  account.confirmed = in.take<Sequence>();
  account.settled_below = in.take<Sequence>();
  for (auto count = in.take<std::uint32_t>(); count > 0; --count) {
    const auto record = take_drop(in);
    if (!record) return std::nullopt;
    given_up.add(*record);
  }
  if (in.is_short()) return std::nullopt;
  return account;
}

std::vector<std::uint8_t> frame_head(std::string_view name, const EncodedFrame& frame) {
  wire::Writer out(0);
  out.put_text(name);
  out.put(frame.sequence);
  out.put(frame.capture_time_ns);
  out.put(frame.exposure_ns);
  out.put(frame.width_px);
  out.put(frame.height_px);
  out.put(frame.left_bytes);
  out.put(frame.jpeg_crc);
  out.put(frame.quality);
  return std::move(out.bytes());
}

std::optional<std::pair<std::string, EncodedFrame>> parse_frame(Bytes body) {
  wire::Reader in(body);
  std::string name(in.take_text());
  EncodedFrame frame;
  frame.sequence = in.take<Sequence>();
  frame.capture_time_ns = in.take<std::int64_t>();
  frame.exposure_ns = in.take<std::uint32_t>();
  frame.width_px = in.take<std::uint16_t>();
  frame.height_px = in.take<std::uint16_t>();
  frame.left_bytes = in.take<std::uint32_t>();
  frame.jpeg_crc = in.take<std::uint32_t>();
  frame.quality = in.take<std::uint8_t>();
  const auto jpeg = in.take_bytes(in.left());
  if (in.is_short() || jpeg.empty()) return std::nullopt;
  frame.jpeg.assign(jpeg.begin(), jpeg.end());
  return std::pair(std::move(name), std::move(frame));
}

std::vector<std::uint8_t> encode_released(std::string_view name,
                                          std::span<const Sequence> released) {
  wire::Writer out(0);
  out.put_text(name);
  put_numbers(out, released);
  return std::move(out.bytes());
}

std::optional<std::pair<std::string, std::vector<Sequence>>> parse_released(Bytes body) {
  wire::Reader in(body);
  std::string name(in.take_text());
  auto released = take_numbers(in);
  if (in.is_short()) return std::nullopt;
  return std::pair(std::move(name), std::move(released));
}

std::vector<std::uint8_t> encode(const Index& index) {
  wire::Writer out(0);
  out.put(static_cast<std::uint32_t>(index.size()));
  for (const auto& [name, entry] : index) {
    out.put_text(name);
    out.put(static_cast<std::uint32_t>(entry.kept.size()));
    for (const KeptFrame& frame : entry.kept) {
      out.put(frame.sequence);
      out.put(frame.offset);
      out.put(frame.bytes);
    }
    put_numbers(out, entry.released);
  }
  out.put(static_cast<std::uint32_t>(out.bytes().size()));
  return std::move(out.bytes());
}

std::optional<Index> parse_index(Bytes body, std::uint32_t segment) {
  wire::Reader in(body);
  Index index;
  for (auto sessions = in.take<std::uint32_t>(); sessions > 0 && !in.is_short(); --sessions) {
    IndexEntry& entry = index[std::string(in.take_text())];
    for (auto frames = in.take<std::uint32_t>(); frames > 0 && !in.is_short(); --frames) {
      KeptFrame frame{in.take<Sequence>(), segment, 0, 0, KeptFrame::State::kWritten};
      frame.offset = in.take<std::uint32_t>();
      frame.bytes = in.take<std::uint32_t>();
      entry.kept.push_back(frame);
    }
    entry.released = take_numbers(in);
  }
  if (in.is_short()) return std::nullopt;
  return index;
}

}  // namespace orbbuf::record_format
