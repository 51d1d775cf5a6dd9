// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/posix/stream_descriptor.hpp>
#include <optional>
#include <string>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// Gives `fd` to `descriptor`, which is not open. An error if the kernel cannot watch it, for
/// example for want of memory; `fd` is closed then, which the constructors of Asio leave open.
inline std::optional<Error> adopt(boost::asio::posix::stream_descriptor& descriptor, UniqueFd fd,
                                  const std::string& what) {
  boost::system::error_code failed;
  descriptor.assign(fd.get(), failed);
  if (failed) return system_error("watch " + what, failed.value());
  static_cast<void>(fd.release());
  return std::nullopt;
}

}  // namespace orbbuf
