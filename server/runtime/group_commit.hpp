// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// Gets all that was written below a folder onto the device: one syncfs(2) for all who wait, on a
/// thread of its own. It covers what is on the folder's own file system.
///
/// A device that has failed once is not trusted again: the kernel reports an error once, and then
/// takes the lost pages for written. All calls after that fail, until the server is restarted.
///
/// Thread-bound to `main`, which must outlive it.
class GroupCommit {
 public:
  using Sync = std::function<std::optional<Error>()>;
  using Done = std::function<void(const std::optional<Error>&)>;

  /// interval: between the begins of two syncs; more calls then share one. failure_means: for the
  /// log, behind what has failed.
  GroupCommit(boost::asio::io_context& main, const std::filesystem::path& folder,
              std::chrono::milliseconds interval, std::string failure_means);
  /// For tests: `sync` instead of syncfs. It runs on the thread.
  GroupCommit(boost::asio::io_context& main, Sync sync, std::chrono::milliseconds interval,
              std::string failure_means);
  /// Waits for the sync that runs.
  ~GroupCommit();

  /// done: runs on `main`, never from within the call, when all that was written before the call is
  /// on the device, or cannot be brought there.
  void async_commit(Done done);
  /// Nothing gets onto the device any more.
  bool has_failed() const { return failed_.has_value(); }

 private:
  void schedule();
  void begin();
  void finish(const std::optional<Error>& error);

  boost::asio::io_context& main_;
  const Sync sync_;
  const std::chrono::milliseconds interval_;
  const std::string failure_means_;
  std::chrono::steady_clock::time_point next_{};
  boost::asio::steady_timer timer_;
  std::vector<Done> waiting_;
  std::vector<Done> syncing_;
  bool is_scheduled_ = false;  // or running
  std::optional<Error> failed_;
  boost::asio::thread_pool thread_{1};
};

}  // namespace orbbuf
