// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <memory>
#include <vector>

#include "server/sink/frame_sink.hpp"
#include "server/sink/session_record.hpp"

namespace orbbuf {

/// Keeps a session on disk; a SessionRecord does it, on the `files` thread. A call that has begun
/// cannot be cancelled: it ends when the disk does. The sink may be destroyed before that. close()
/// has the record finished there, behind what was begun; nobody waits for it but who joins `pool`.
class FileSink final : public FrameSink {
 public:
  /// position: what record->recover() returned. `main` and `pool` must outlive the sink; the pool
  /// is stopped before `main` is destroyed.
  FileSink(boost::asio::io_context& main, boost::asio::thread_pool& pool,
           std::unique_ptr<SessionRecord> record, wire::Position position);

  wire::Position position() const override { return position_; }
  void async_write(FramePtr frame, Done done) override;
  void async_write_drops(std::vector<DropRecord> records, Done done) override;
  void close() override;

 private:
  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const std::shared_ptr<SessionRecord> record_;  // shared with the calls in progress only
  const wire::Position position_;
  bool is_closed_ = false;
};

}  // namespace orbbuf
