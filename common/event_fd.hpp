// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/eventfd.h>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// To wake a thread that polls it: eventfd_write() makes it readable. Throws std::system_error.
inline UniqueFd make_event_fd() {
  UniqueFd event(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (!event) throw_system_error("cannot create an eventfd");
  return event;
}

}  // namespace orbbuf
