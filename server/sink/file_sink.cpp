// SPDX-License-Identifier: Apache-2.0
#include "server/sink/file_sink.hpp"

#include <spdlog/spdlog.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <utility>

namespace orbbuf {
namespace {

namespace asio = boost::asio;

/// Runs `work` in the pool and then `done` with its result on `main`, which cannot run out of work
/// in between.
template <class Work>
void run_in_pool(asio::io_context& main, asio::thread_pool& pool, Work work, FrameSink::Done done) {
  asio::post(pool, [guard = asio::make_work_guard(main), work = std::move(work),
                    done = std::move(done)]() mutable {
    asio::post(guard.get_executor(),
               [done = std::move(done), error = work()] { done(std::move(error)); });
  });
}

}  // namespace

FileSink::FileSink(asio::io_context& main, asio::thread_pool& pool,
                   std::unique_ptr<SessionRecord> record, wire::Position position)
    : main_(main), pool_(pool), record_(std::move(record)), position_(position) {}

void FileSink::async_write(FramePtr frame, Done done) {
  run_in_pool(
      main_, pool_, [record = record_, frame = std::move(frame)] { return record->write(*frame); },
      std::move(done));
}

void FileSink::async_write_drops(std::vector<DropRecord> records, Done done) {
  run_in_pool(
      main_, pool_,
      [record = record_, records = std::move(records)] { return record->write_drops(records); },
      std::move(done));
}

void FileSink::close() {
  if (std::exchange(is_closed_, true)) return;
  asio::post(pool_, [record = record_] {
    if (const auto error = record->finish()) spdlog::warn("not finished: {}", error->text);
  });
}

}  // namespace orbbuf
