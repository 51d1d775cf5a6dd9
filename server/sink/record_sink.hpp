// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/strand.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "server/recording/session_record.hpp"
#include "server/runtime/group_commit.hpp"
#include "server/sink/frame_sink.hpp"

namespace orbbuf {

/// Keeps a session on disk, in one form or several. One job in the `files` pool writes each
/// record in turn; the last one's position is what the session has, so a record before it may only
/// hold more. A record that fails ends the job, and the next try goes on with that record.
///
/// A job that has begun cannot be cancelled: it ends when the disk does. The sink may be destroyed
/// before that. async_drain() finishes the records. So all work on the records is one job at a
/// time, though `pool` may have several threads; and it has ended before the session may be opened
/// again.
class RecordSink final : public FrameSink {
 public:
  using Records = std::vector<std::unique_ptr<SessionRecord>>;

  /// How the records get onto the device.
  struct Commit {
    GroupCommit* group = nullptr;  ///< null: as the kernel likes; must outlive the sink
    bool is_awaited = false;       ///< async_commit() waits for it
  };

  /// `records` have been recovered, to `position`. `main` and `pool` must outlive the sink; the
  /// pool is stopped before `main` is destroyed.
  RecordSink(boost::asio::io_context& main, boost::asio::thread_pool& pool, Records records,
             wire::Position position, Commit commit);
  ~RecordSink() override;

  wire::Position position() const override { return position_; }
  void async_write(FramePtr frame, Done done) override;
  void async_write_drops(wire::Dropped dropped, Done done) override;
  bool is_partly_taken() const override;
  void async_commit(Done done) override;
  void note(const SessionClosing& reported) override;
  /// The records get their index, and the session its end.
  void async_drain(const SessionClosing& closing, std::function<void()> drained) override;

 private:
  struct Job;
  using Write = std::function<std::optional<Error>(SessionRecord&)>;

  void write_each(Write write, Done done);

  boost::asio::io_context& main_;
  boost::asio::strand<boost::asio::thread_pool::executor_type> strand_;
  const std::shared_ptr<Job> job_;  // shared with what runs in the pool only
  const wire::Position position_;
  const Commit commit_;
  std::shared_ptr<bool> is_commit_due_ = std::make_shared<bool>(false);  // no call waits for it
};

}  // namespace orbbuf
