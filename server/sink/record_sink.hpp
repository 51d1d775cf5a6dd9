// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>

#include "server/session/shared_store.hpp"
#include "server/sink/frame_sink.hpp"

namespace orbbuf {

/// Keeps a session on disk. What has begun cannot be cancelled: it ends when the disk does. The
/// sink may be destroyed before that.
class RecordSink final : public FrameSink {
 public:
  /// `store` was opened, and stands at `position`.
  RecordSink(std::shared_ptr<SharedStore> store, wire::Position position);

  wire::Position position() const override { return position_; }
  void async_write(FramePtr frame, Done done) override;
  bool takes_items() const override { return true; }
  void async_write_items(ItemsPtr items, Done done) override;
  void async_commit(Done done) override { store_->async_commit(std::move(done)); }
  void note(const SessionClosing& reported) override;
  /// The session gets its end and its views.
  void async_drain(const SessionClosing& closing, Done drained) override;

 private:
  using Write = std::function<std::optional<Error>(SessionStore&)>;

  void write(Write write, Done done);

  const std::shared_ptr<SharedStore> store_;
  const wire::Position position_;
};

}  // namespace orbbuf
