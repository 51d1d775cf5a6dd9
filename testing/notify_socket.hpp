// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "common/unique_fd.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// The service manager's end of sd_notify(3): a real datagram socket.
class NotifySocket {
 public:
  NotifySocket();

  /// For $NOTIFY_SOCKET.
  std::string path() const { return folder_ / "notify"; }

  /// The next message, waiting for it at most `limit`.
  std::optional<std::string> next(std::chrono::milliseconds limit = std::chrono::seconds(60));
  /// The messages up to the first that begins with `beginning`, that one included. Without it, if
  /// there is none for `limit`.
  std::vector<std::string> until(const std::string& beginning,
                                 std::chrono::milliseconds limit = std::chrono::seconds(60));

 private:
  TemporaryFolder folder_;
  UniqueFd socket_;
};

}  // namespace orbbuf::test
