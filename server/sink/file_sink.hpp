// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <memory>
#include <vector>

#include "server/sink/frame_sink.hpp"
#include "server/sink/session_files.hpp"

namespace orbbuf {

/// Keeps a session in a folder; SessionFiles does it, on the `files` thread. A call that has begun
/// cannot be cancelled: it ends when the disk does. The sink may be destroyed before that.
class FileSink final : public FrameSink {
 public:
  /// position: what files.recover() returned. `main` and `pool` must outlive the sink; the pool is
  /// stopped before `main` is destroyed.
  FileSink(boost::asio::io_context& main, boost::asio::thread_pool& pool, SessionFiles files,
           wire::Position position);

  wire::Position position() const override { return position_; }
  void async_write(FramePtr frame, Done done) override;
  void async_write_drops(std::vector<DropRecord> records, Done done) override;

 private:
  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const std::shared_ptr<SessionFiles> files_;  // shared with the call in progress only
  const wire::Position position_;
};

}  // namespace orbbuf
