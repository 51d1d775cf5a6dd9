// SPDX-License-Identifier: Apache-2.0
#include "daemon/reducer.hpp"

#include <exception>
#include <memory>
#include <utility>

#include "common/log.hpp"
#include "common/watched_thread.hpp"

namespace orbbuf {
namespace {

Result<EncodedFrame> try_to_reduce(Requantiser& requantiser, const Reductions::Job& job) {
  try {
    return requantiser.reduce(*job.whole, job.quality);
  } catch (const std::exception& error) {  // no memory, for one
    return Error{error.what()};
  }
}

}  // namespace

Reducer::Reducer(FrameBuffer& buffer, std::function<void()> changed)
    : buffer_(buffer), changed_(std::move(changed)) {
  buffer_.expect_reductions();
  thread_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
}

void Reducer::work(const std::stop_token& stop) {
  const WatchedThread watched("reducer");
  LogLimit failure_log{std::chrono::seconds(10)};
  while (const auto job = buffer_.next_to_reduce(stop)) {
    auto reduced = try_to_reduce(requantiser_, *job);
    if (!reduced && failure_log.lets_through()) {
      log_warn(
          "frame {}: cannot make it smaller, so it is sent as it is: {} (further failures are not "
          "logged for 10 s)",
          job->whole->sequence, reduced.error().text);
    }
    buffer_.on_reduced(
        *job, reduced ? std::make_shared<const EncodedFrame>(std::move(reduced).value()) : nullptr);
    changed_();
  }
}

}  // namespace orbbuf
