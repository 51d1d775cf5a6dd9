// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "server/recording/session_closing.hpp"

namespace orbbuf {

/// One session as it is kept on disk. Blocking; reentrant, called by one thread at a time.
class SessionRecord {
 public:
  virtual ~SessionRecord() = default;

  /// On error nothing of the frame remains.
  virtual std::optional<Error> write(const EncodedFrame& frame) = 0;
  virtual std::optional<Error> write_drops(const wire::Dropped& dropped) = 0;

  /// What the robot last reported, of a session that is open. If it cannot be kept, the next write
  /// says why.
  virtual void note(const SessionClosing& /*reported*/) {}

  /// The session is closed, though it may be continued later. What `closing` does not know and this
  /// record has from before is filled in.
  virtual std::optional<Error> finish(SessionClosing& closing) = 0;
};

}  // namespace orbbuf
