// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/descriptors.hpp"

#include <sys/resource.h>

#include <algorithm>

#include "common/log.hpp"

namespace orbbuf {
namespace {

constexpr rlim_t kPerConnection = 4;  // its socket; its session's pipe, SLAM's output and end
constexpr rlim_t kOthers = 64;

}  // namespace

void allow_descriptors_for(std::size_t connections) {
  const rlim_t wanted = kPerConnection * connections + kOthers;
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= wanted) return;
  limit.rlim_cur = std::min(wanted, limit.rlim_max);
  if (::setrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur < wanted) {
    log_warn("{} connections may need {} open files; the hard limit is {}", connections, wanted,
             limit.rlim_max);
  }
}

}  // namespace orbbuf
