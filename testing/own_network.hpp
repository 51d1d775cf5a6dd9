// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sched.h>

#include <functional>
#include <thread>

namespace orbbuf::test {

/// On a thread that has left for a network of its own, which ends with it; so do the threads that
/// `body` starts. Skips the test where this user may not (not root?).
inline void in_own_network(const std::function<void()>& body) {
  std::thread([&] {
    if (::unshare(CLONE_NEWNET) != 0) GTEST_SKIP() << "cannot make a network namespace (not root?)";
    body();
  }).join();
}

}  // namespace orbbuf::test
