// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "common/frame.hpp"

namespace orbbuf {

/// The frames of a session before those in its folder here, wherever they are. Thread-bound to
/// `main`; one call is outstanding at a time. Lives in a shared_ptr, which its operations hold.
class EarlierFrames {
 public:
  using Done = std::function<void(FramePtr)>;

  virtual ~EarlierFrames() = default;

  /// The first frame from `first` on that can be had; null: there is none. Never answers from
  /// within the call. A smaller `first` than the last one is costly.
  virtual void async_next(Sequence first, Done done) = 0;

  /// The outstanding call, and each that follows, is answered with null. Harmless when repeated.
  virtual void close() = 0;
};

}  // namespace orbbuf
