// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <type_traits>

namespace orbbuf::bench {

/// What main() returns: what `run` does, or EXIT_SUCCESS if that is nothing. An exception ends the
/// program with one line, "NAME: what failed", and EXIT_FAILURE.
template <class Run>
int run_program(const char* name, const Run& run) {
  try {
    if constexpr (std::is_void_v<decltype(run())>) {
      run();
      return EXIT_SUCCESS;
    } else {
      return run();
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", name, error.what());
    return EXIT_FAILURE;
  }
}

}  // namespace orbbuf::bench
