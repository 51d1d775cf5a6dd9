// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/resource.h>

#include <csignal>

namespace orbbuf::test {

/// A limit of this process for as long as it lives. RLIMIT_FSIZE stands for a full disk: the write
/// that crosses it is short, as on a disk with a little room left, and the next one fails. Needs
/// neither root nor a mount.
class ResourceLimit {
 public:
  ResourceLimit(__rlimit_resource_t which, rlim_t value) : which_(which) {
    std::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(which_, &before_);
    const rlimit limit{value, before_.rlim_max};
    ::setrlimit(which_, &limit);
  }
  ~ResourceLimit() { ::setrlimit(which_, &before_); }
  ResourceLimit(const ResourceLimit&) = delete;
  ResourceLimit& operator=(const ResourceLimit&) = delete;

 private:
  __rlimit_resource_t which_;
  rlimit before_{};
};

}  // namespace orbbuf::test
