// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"

namespace orbbuf {

/// One session as it is kept on disk. Blocking; reentrant, called by one thread at a time.
class SessionRecord {
 public:
  virtual ~SessionRecord() = default;

  /// On error nothing of the frame remains.
  virtual std::optional<Error> write(const EncodedFrame& frame) = 0;
  virtual std::optional<Error> write_drops(const wire::Dropped& dropped) = 0;

  /// The session has ended, though it may be continued later.
  virtual std::optional<Error> finish() { return std::nullopt; }
};

}  // namespace orbbuf
