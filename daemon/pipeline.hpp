// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "common/frame.hpp"
#include "common/log.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/capture/frame_source.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/mailbox.hpp"

namespace orbbuf {

/// Moves frames from the source into the buffer, on two threads: `capture` takes frames from the
/// source and numbers them, `worker` encodes and pushes them. A mailbox of a few frames lies
/// between them: a live source never waits, and a frame that the worker does not take in time is
/// recorded as skipped. A source that is not live is read only when the buffer has room, so it
/// loses nothing. A frame whose encoding throws is recorded as failed; any other exception ends
/// both threads, as a source does that is gone. Thread-bound to `main`.
class Pipeline {
 public:
  struct Events {
    std::function<void()> changed;           ///< `worker`: the buffer has news for the sender
    std::function<void(bool failed)> ended;  ///< `worker`, last: the source is at its end, or gone;
                                             ///< or the worker cannot go on
    std::function<void(const FramePtr&)>
        encoded{};  ///< `worker`: a frame on its way into the buffer
    std::function<void(std::int64_t total_ns)>
        clock_stepped{};  ///< `capture`: RawFrame::clock_step_ns has changed
  };

  /// `buffer` must outlive the pipeline. Nothing runs before start().
  Pipeline(std::unique_ptr<FrameSource> source, const JpegSettings& jpeg, FrameBuffer& buffer,
           Events events);
  /// Stops as stop() does, and joins.
  ~Pipeline() { stop(); }

  void start();
  /// Asks the source to end; what has been captured is still encoded. `ended` follows.
  void stop();

 private:
  struct Captured {
    RawFrame raw;
    Sequence sequence = 0;
  };

  void capture(const std::stop_token& stop);
  void work(const std::stop_token& stop);
  void work_until_end(const std::stop_token& stop);
  void encode(const Captured& captured);
  void compare_size(const EncodedFrame& frame);
  Result<EncodedFrame> try_to_encode(const Captured& captured);
  void lose(const Captured& captured, DropReason reason);

  const std::unique_ptr<FrameSource> source_;
  FrameBuffer& buffer_;
  const Events events_;
  JpegEncoder encoder_;                             // worker only
  std::optional<std::pair<int, int>> size_;         // worker only; the first frame's, in px
  bool has_sizes_ = false;                          // worker only; a frame of another, logged
  LogLimit failure_log_{std::chrono::seconds(10)};  // worker only
  Mailbox<Captured> mailbox_{3};  // a camera's frames come in a burst after `capture` was held up
  bool source_failed_ = false;    // set before mailbox_.close(), read once it is closed
  std::jthread capture_;
  std::jthread worker_;
};

}  // namespace orbbuf
