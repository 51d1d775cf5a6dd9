// SPDX-License-Identifier: Apache-2.0
#include "server/sink/file_sink.hpp"

#include <spdlog/spdlog.h>

#include <boost/asio/post.hpp>
#include <utility>

#include "server/run_in_pool.hpp"

namespace orbbuf {
namespace asio = boost::asio;

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
