// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/strand.hpp>
#include <boost/asio/thread_pool.hpp>
#include <utility>

namespace orbbuf {

/// Runs what it is given one thing at a time.
using PoolStrand = boost::asio::strand<boost::asio::thread_pool::executor_type>;

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
