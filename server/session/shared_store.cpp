// SPDX-License-Identifier: Apache-2.0
#include "server/session/shared_store.hpp"

#include "common/log.hpp"

namespace orbbuf {

namespace asio = boost::asio;

std::optional<Error> SharedStore::open() {
  if (store_) return std::nullopt;
  auto opened = SessionStore::open(folder_, info_, durability_);
  if (!opened) return std::move(opened).error();
  store_ = std::move(opened).value();
  return std::nullopt;
}

void SharedStore::async_commit(std::function<void(std::optional<Error>)> done) {
  if (group_ == nullptr) return done(std::nullopt);
  if (durability_ == Durability::kAck) {
    group_->async_commit([self = shared_from_this(), place = written_,
                          done = std::move(done)](const std::optional<Error>& error) {
      if (!error) self->on_committed(place);
      done(error);
    });
    return;
  }
  if (!std::exchange(is_commit_due_, true)) {
    group_->async_commit([self = shared_from_this(), place = written_](const auto& error) {
      self->is_commit_due_ = false;
      if (!error) self->on_committed(place);
    });
  }
  done(std::nullopt);
}

void SharedStore::on_committed(const journal::Place& place) {
  asio::post(strand_, [self = shared_from_this(), place] {
    if (self->store_) self->store_->set_kept(place);
  });
}

void SharedStore::close(std::function<void()> closed) {
  run_in_pool(
      main_, strand_,
      [self = shared_from_this()] {
        const auto store = std::exchange(self->store_, nullptr);
        return store ? store->close() : std::nullopt;
      },
      [self = shared_from_this(), closed = std::move(closed)](const std::optional<Error>& error) {
        if (error) {
          log_warn("{}: not all is recorded: {}", self->folder_.string(), error->text);
        }
        closed();
      });
}

}  // namespace orbbuf
