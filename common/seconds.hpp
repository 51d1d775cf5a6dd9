// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace orbbuf {

/// As a number, for arithmetic and for logs.
inline double to_seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace orbbuf
