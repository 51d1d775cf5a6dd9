// SPDX-License-Identifier: Apache-2.0
#include "server/sink/record_sink.hpp"

#include <utility>

#include "common/byte_order.hpp"
#include "common/log.hpp"
#include "common/system_clock.hpp"

namespace orbbuf {
namespace {

/// The payload of each stream begins with the count of its items.
RecordedItems record_of(const wire::Items& items) {
  const auto count = wire::Reader(items.payload).take<std::uint16_t>();
  return {items.stream, items.first, items.first + count, items.payload};
}

/// As far as the robot has reported.
std::optional<Error> note(SessionStore& store, const SessionClosing& closing) {
  if (!closing.stats) return std::nullopt;
  return store.note({*closing.stats, closing.clock_offset_ns.value_or(
                                         store.summary().closing.clock_offset_ns.value_or(0))});
}

}  // namespace

RecordSink::RecordSink(std::shared_ptr<SharedStore> store, wire::Position position)
    : store_(std::move(store)), position_(position) {}

void RecordSink::write(Write write, Done done) {
  store_->run(
      [write = std::move(write)](SessionStore& store) -> Result<bool> {
        if (auto error = write(store)) return std::move(*error);
        return true;
      },
      [done = std::move(done)](const Result<bool>& written) {
        done(written ? std::nullopt : std::optional(written.error()));
      });
}

void RecordSink::async_write(FramePtr frame, Done done) {
  write([frame = std::move(frame)](
            SessionStore& store) { return store.write(*frame, system_time_ns()); },
        std::move(done));
}

void RecordSink::async_write_items(ItemsPtr items, Done done) {
  write([items = std::move(items)](
            SessionStore& store) { return store.write_items(record_of(*items)); },
        std::move(done));
}

void RecordSink::note(const SessionClosing& reported) {
  write([reported](SessionStore& store) { return orbbuf::note(store, reported); },
        [](const std::optional<Error>& error) {
          if (error) log_warn("not noted: {}", error->text);
        });
}

void RecordSink::async_drain(const SessionClosing& closing, Done drained) {
  write(
      [closing](SessionStore& store) {
        auto error = orbbuf::note(store, closing);
        return error ? error : store.finish(closing.has_ended);
      },
      std::move(drained));
}

}  // namespace orbbuf
