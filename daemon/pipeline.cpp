// SPDX-License-Identifier: Apache-2.0
#include "daemon/pipeline.hpp"

#include <fmt/core.h>

#include <exception>
#include <utility>

#include "common/watched_thread.hpp"

namespace orbbuf {

Pipeline::Pipeline(std::unique_ptr<FrameSource> source, const JpegSettings& jpeg,
                   FrameBuffer& buffer, Events events)
    : source_(std::move(source)), buffer_(buffer), events_(std::move(events)), encoder_(jpeg) {}

void Pipeline::start() {
  // First, since the worker stops it when the stream fails.
  capture_ = std::jthread([this](const std::stop_token& stop) { capture(stop); });
  worker_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
}

void Pipeline::stop() {
  capture_.request_stop();
  worker_.request_stop();
}

void Pipeline::capture(const std::stop_token& stop) {
  const WatchedThread watched("capture");
  try {
    std::int64_t clock_step_ns = 0;
    for (Sequence sequence = 0; auto raw = source_->next(stop); ++sequence) {
      beat();
      buffer_.on_captured();
      if (raw->clock_step_ns != std::exchange(clock_step_ns, raw->clock_step_ns)) {
        events_.clock_stepped(clock_step_ns);
      }
      Captured captured{std::move(*raw), sequence};
      if (!source_->is_live() && !mailbox_.wait_until_empty(stop)) {
        lose(captured, DropReason::kShutdown);
      } else if (auto late = mailbox_.put(std::move(captured))) {
        lose(*late, DropReason::kBusy);
      }
    }
  } catch (const std::exception& error) {
    source_failed_ = true;
    log_error("source: {}", error.what());
  }
  mailbox_.close();
}

void Pipeline::work(const std::stop_token& stop) {
  const WatchedThread watched("worker");
  bool has_failed = false;
  try {
    work_until_end(stop);
  } catch (const std::exception& error) {
    has_failed = true;
    log_error("worker: {}", error.what());
    capture_.request_stop();
    while (const auto captured = mailbox_.take()) lose(*captured, DropReason::kFailed);
  }
  events_.ended(has_failed || source_failed_);
}

void Pipeline::work_until_end(const std::stop_token& stop) {
  while (auto captured = mailbox_.take()) {
    if (source_->is_live() || buffer_.wait_for_room(stop)) {
      encode(*captured);
    } else {
      lose(*captured, DropReason::kShutdown);
    }
    events_.changed();
    // What the policy does ahead is done here, in small units, so that no frame waits for it long.
    while (mailbox_.take_would_wait() && buffer_.prepare()) beat();
  }
}

void Pipeline::encode(const Captured& captured) {
  auto encoded = try_to_encode(captured);
  if (encoded) {
    auto frame = std::make_shared<const EncodedFrame>(std::move(encoded.value()));
    compare_size(*frame);
    if (events_.encoded) events_.encoded(frame);
    buffer_.push(std::move(frame));
  } else {
    if (failure_log_.lets_through()) {
      log_warn("frame {}: {} (further failures are not logged for 10 s)", captured.sequence,
               encoded.error().text);
    }
    lose(captured, DropReason::kFailed);
  }
}

void Pipeline::compare_size(const EncodedFrame& frame) {
  const std::pair<int, int> size(frame.width_px, frame.height_px);
  if (!size_) size_ = size;
  if (size == *size_ || std::exchange(has_sizes_, true)) return;
  log_warn(
      "frame {} has {}x{} px, the first one {}x{}: they are sent as they are, but SLAM programs "
      "want one size; give the source images of one",
      frame.sequence, size.first, size.second, size_->first, size_->second);
}

Result<EncodedFrame> Pipeline::try_to_encode(const Captured& captured) {
  if (const auto quality = buffer_.encode_quality()) encoder_.set_quality(*quality);
  try {
    return encoder_.encode(captured.raw, captured.sequence);
  } catch (const std::exception& error) {  // no memory, for one
    return Error{fmt::format("cannot encode it: {}", error.what())};
  }
}

void Pipeline::lose(const Captured& captured, DropReason reason) {
  buffer_.on_lost({captured.sequence, captured.raw.capture_time_ns, reason});
}

}  // namespace orbbuf
