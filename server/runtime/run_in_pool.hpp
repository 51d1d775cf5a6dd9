// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/strand.hpp>
#include <boost/asio/thread_pool.hpp>
#include <latch>
#include <memory>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {

/// Runs what it is given one thing at a time.
using PoolStrand = boost::asio::strand<boost::asio::thread_pool::executor_type>;

/// Of all `count` threads of a pool that has no work yet.
inline void name_threads(boost::asio::thread_pool& pool, const char* name, unsigned count) {
  const auto all_there = std::make_shared<std::latch>(count);
  for (unsigned i = 0; i < count; ++i) {
    boost::asio::post(pool, [name, all_there] {
      name_this_thread(name);
      all_there->arrive_and_wait();  // so each thread runs this once
    });
  }
  all_there->wait();  // a pool that is stopped before would leave some waiting for the others
}

/// Runs `work` in the pool (a thread_pool or a strand of one) and then `done` with its result on
/// `main` (an execution context or an executor), which cannot run out of work in between. `work`
/// ends on `main`, too, after `done`: so what the two may hold between them, a sink that holds
/// timers of `main` say, ends nowhere else. `main` outlives the pool's work.
template <class Main, class Pool, class Work, class Done>
void run_in_pool(Main&& main, Pool& pool, Work work, Done done) {
  boost::asio::post(pool, [guard = boost::asio::make_work_guard(main), work = std::move(work),
                           done = std::move(done)]() mutable {
    auto result = work();
    boost::asio::post(guard.get_executor(),
                      [work = std::move(work), done = std::move(done),
                       result = std::move(result)]() mutable { done(std::move(result)); });
  });
}

}  // namespace orbbuf
