// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/byte_order.hpp"
#include "common/wire.hpp"

/// The fields of what messages and journals have in common (byte_order.hpp), for both directions.
namespace orbbuf::wire {

/// Whether it can be one is not checked: the reason, too, may be any number.
template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, DropRecord>& record) {
  archive.fields(record.sequence, record.frames, record.capture_time_ns,
                 record.last_capture_time_ns, record.reason, record.similarity);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, Stats>& stats) {
  archive.fields(stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged,
                 stats.waiting, stats.in_flight);
}

template <class Archive>
void fields(Archive& archive, FieldsOf<Archive, Report>& report) {
  fields(archive, report.stats);
  archive.fields(report.capacity, report.waiting_bytes, report.link_rate, report.round_trip_us,
                 report.clock_offset_ns, report.irreducible);
}

/// u16 count, and for each of these streams its u16 id and u64 next number.
inline void put_position(Writer& out, const Position& position,
                         const std::bitset<kMostStreams>& streams) {
  out.put(static_cast<std::uint16_t>(streams.count()));
  for (StreamId id = 0; id < kMostStreams; ++id) {
    if (streams[id]) out.fields(id, position[id]);
  }
}
/// Of those streams of which there is something.
inline void put_position(Writer& out, const Position& position) {
  std::bitset<kMostStreams> streams;
  for (StreamId id = 0; id < kMostStreams; ++id) streams[id] = position[id] > 0;
  put_position(out, position, streams);
}

}  // namespace orbbuf::wire
