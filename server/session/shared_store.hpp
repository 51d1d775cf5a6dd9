// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "common/error.hpp"
#include "server/runtime/group_commit.hpp"
#include "server/runtime/run_in_pool.hpp"
#include "server/session/session_store.hpp"

namespace orbbuf {

/// A SessionStore for all who write to that session: its live stream, late frames, accounts. Their
/// work runs in the pool, one call after the other, in a strand that all stores of a robot share.
/// Work that has begun cannot be cancelled: it ends when the disk does.
///
/// Thread-bound to `main`. Lives in a shared_ptr, which its work holds.
class SharedStore : public std::enable_shared_from_this<SharedStore> {
 public:
  /// files: of all robots. group: brings what was written onto the device; null: nothing does. It
  /// and `main` must outlive the object; the pool is stopped before `main` is destroyed.
  SharedStore(boost::asio::io_context& main, PoolStrand strand, const std::filesystem::path& files,
              SessionInfo info, Durability durability, GroupCommit* group)
      : main_(main),
        strand_(std::move(strand)),
        folder_(files / info.robot_id / info.session_id),
        info_(std::move(info)),
        durability_(durability),
        group_(group) {}

  const std::filesystem::path& folder() const { return folder_; }

  /// Has the strand run `work` with the store, which is opened before, if it is not; then `main`
  /// runs `done` with what `work` has returned, a Result, or with the error of the opening.
  template <class Work, class Done>
  void run(Work work, Done done) {
    using Answer = decltype(work(std::declval<SessionStore&>()));
    run_in_pool(
        main_, strand_,
        [self = shared_from_this(),
         work = std::move(work)]() mutable -> std::pair<Answer, journal::Place> {
          if (auto error = self->open()) return {Answer(std::move(*error)), {}};
          auto answer = work(*self->store_);
          return {std::move(answer), self->store_->written()};
        },
        [self = shared_from_this(), done = std::move(done)](auto outcome) mutable {
          self->written_ = std::max(self->written_, outcome.second);
          done(std::move(outcome.first));
        });
  }

  /// done: runs on `main`, possibly from within the call, when all that was written may be
  /// acknowledged; after an error of the device never again.
  void async_commit(std::function<void(std::optional<Error>)> done);

  /// Ends the work with the store for now: SessionStore::close(). `closed` runs on `main` after
  /// that. A later run() opens the store again.
  void close(std::function<void()> closed = [] {});

 private:
  std::optional<Error> open();
  void on_committed(const journal::Place& place);

  boost::asio::io_context& main_;
  PoolStrand strand_;
  const std::filesystem::path folder_;
  const SessionInfo info_;
  const Durability durability_;
  GroupCommit* const group_;
  std::unique_ptr<SessionStore> store_;  // used in the strand only; null: not open
  journal::Place written_;
  bool is_commit_due_ = false;  // no call waits for it
};

}  // namespace orbbuf
