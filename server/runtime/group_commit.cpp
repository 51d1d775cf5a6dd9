// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/group_commit.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <memory>
#include <utility>

#include "common/log.hpp"
#include "common/unique_fd.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

/// The descriptor stays open: the kernel reports an error of the device once to each.
GroupCommit::Sync sync_of(const std::filesystem::path& folder) {
  const auto fd = std::make_shared<UniqueFd>();
  return [folder, fd]() -> std::optional<Error> {
    if (!*fd) *fd = UniqueFd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!*fd) return system_error("open " + folder.string(), errno);
    if (::syncfs(fd->get()) == 0) return std::nullopt;
    return system_error("sync the file system of " + folder.string(), errno);
  };
}

}  // namespace

GroupCommit::GroupCommit(asio::io_context& main, const std::filesystem::path& folder,
                         std::chrono::milliseconds interval, std::string failure_means)
    : GroupCommit(main, sync_of(folder), interval, std::move(failure_means)) {}

GroupCommit::GroupCommit(asio::io_context& main, Sync sync, std::chrono::milliseconds interval,
                         std::string failure_means)
    : main_(main),
      sync_(std::move(sync)),
      interval_(interval),
      failure_means_(std::move(failure_means)),
      timer_(main) {
  asio::post(thread_, [] { name_this_thread("sync"); });
}

GroupCommit::~GroupCommit() { thread_.join(); }

void GroupCommit::async_commit(Done done) {
  if (failed_) {
    asio::post(main_, [done = std::move(done), error = *failed_] { done(error); });
    return;
  }
  waiting_.push_back(std::move(done));
  if (!std::exchange(is_scheduled_, true)) schedule();
}

void GroupCommit::schedule() {
  timer_.expires_at(next_);
  timer_.async_wait([this](const boost::system::error_code& failed) {
    if (!failed) begin();
  });
}

void GroupCommit::begin() {
  next_ = std::chrono::steady_clock::now() + interval_;
  syncing_ = std::exchange(waiting_, {});
  run_in_pool(main_, thread_, sync_, [this](const std::optional<Error>& error) { finish(error); });
}

void GroupCommit::finish(const std::optional<Error>& error) {
  if (error) {
    failed_ = error;
    log_error("{}; {}: check the disk, then restart the server", error->text, failure_means_);
    syncing_.insert(syncing_.end(), waiting_.begin(), waiting_.end());
    waiting_.clear();
  }
  const auto done = std::exchange(syncing_, {});
  is_scheduled_ = !waiting_.empty();
  if (is_scheduled_) schedule();
  for (const Done& each : done) each(error);
}

}  // namespace orbbuf
