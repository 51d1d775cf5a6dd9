// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "server/session/session_info.hpp"

namespace orbbuf {

using ItemsPtr = std::shared_ptr<const wire::Items>;

/// Where the frames of one session, and the items of its other streams, go. Thread-bound to `main`;
/// blocking work is the sink's own to hand to another thread. One call is outstanding at a time. A
/// slow sink is back-pressure: nothing more of the robot's stream is read before the handler has
/// run.
class FrameSink {
 public:
  /// No error: taken, and as safe as this sink makes things. Error: not taken, and nothing half
  /// done; the caller tries the same again later. Runs on `main`, never from within the call
  /// itself.
  using Done = std::function<void(std::optional<Error>)>;

  virtual ~FrameSink() = default;

  /// What the sink holds of this session already, from before this server was started.
  virtual wire::Position position() const { return {}; }

  virtual void async_write(FramePtr frame, Done done) = 0;

  /// Whether async_write_items() is to be called: a sink for people's eyes needs no drop records.
  virtual bool takes_items() const { return false; }
  // NOLINTNEXTLINE(performance-unnecessary-value-param): a sink that takes items keeps it
  virtual void async_write_items(ItemsPtr /*items*/, Done done) { done(std::nullopt); }

  /// Brings all that was taken onto the device, if the sink keeps it on one. `done` runs on `main`,
  /// possibly from within the call, when that much may be acknowledged; after an error never again.
  // NOLINTNEXTLINE(performance-unnecessary-value-param): an override may keep it
  virtual void async_commit(Done done) { done(std::nullopt); }

  /// What the robot last reported, of a session that is open; also while a call is outstanding. Now
  /// and then, not each report.
  virtual void note(const SessionClosing& /*reported*/) {}

  /// Frames, and messages with samples, that it answered as taken and then gave up, for readers
  /// that must not hold the stream.
  virtual std::uint64_t lost() const { return 0; }

  /// Stops waiting for a reader: a call that has not begun to write ends soon, with an
  /// error. What has begun goes on, at the pace of the disk or of the reader.
  virtual void cancel() {}

  /// Nothing more will be written: `drained` runs, possibly from within the call, when all that was
  /// answered has gone where it goes. It may never end; close() ends it. A sink that keeps the
  /// session keeps `closing`, too: an error says that it could not, and is worth another call.
  // NOLINTNEXTLINE(performance-unnecessary-value-param): an override may keep it
  virtual void async_drain(const SessionClosing& /*closing*/, Done drained) {
    drained(std::nullopt);
  }

  /// Nothing more will be written; readers see the end. An outstanding call ends soon, with an
  /// error if need be, even where that leaves the reader with half a frame. Harmless when repeated.
  virtual void close() {}
};

}  // namespace orbbuf
