// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <poll.h>

#include <chrono>
#include <memory>
#include <string>

#include "testing/captured_log.hpp"
#include "testing/robot_client.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/running_server.hpp"

namespace orbbuf::test {

/// A whole server with `settings_`, its log, and the folder that it writes into.
class ListenerTest : public testing::Test {
 protected:
  /// The test may be held up for longer than a server waits. Each frame is acknowledged at once, so
  /// that a test can count the acks.
  ListenerTest() {
    settings_.sinks.files_path = folder_ / "data";
    settings_.sinks.files_sync = FilesSync::kSecond;
    settings_.listen.hello_timeout = settings_.listen.idle_timeout = std::chrono::minutes(10);
  }

  void start() { server_ = std::make_unique<RunningServer>(settings_); }
  RobotClient connect() {
    if (!server_) start();
    return RobotClient(server_->port());
  }
  std::size_t frames_kept(const std::string& session) const {
    return read_lines(folder_ / "data" / session / "times.txt").size();
  }
  static bool has_answer(const RobotClient& robot, int milliseconds) {
    pollfd events{robot.fd(), POLLIN, 0};
    return ::poll(&events, 1, milliseconds) > 0;
  }

  TemporaryFolder folder_;
  CapturedLog log_;
  Settings settings_;
  std::unique_ptr<RunningServer> server_;
};

}  // namespace orbbuf::test
