// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dlfcn.h>

#include <cstdlib>

/// Defines a function of the C library anew. The name in C++ differs, since the library's headers
/// may rename theirs (open to open64).
#define ORBBUF_INTERPOSE(result, name, ...)                       \
  extern "C" result simulated_##name(__VA_ARGS__) __asm__(#name); \
  extern "C" result simulated_##name(__VA_ARGS__)

namespace orbbuf::simulation {

/// The C library's own, which `name` hides.
template <class Function>
Function real(const char* name) {
  void* const found = ::dlsym(RTLD_NEXT, name);
  if (found == nullptr) std::abort();
  return reinterpret_cast<Function>(found);
}

/// A system call, past everything that is interposed. -1 and errno.
long raw_call(long number, long a = 0, long b = 0, long c = 0, long d = 0, long e = 0, long f = 0);

}  // namespace orbbuf::simulation

#define ORBBUF_REAL(type, name) \
  static auto* const real_function = ::orbbuf::simulation::real<type>(name)
