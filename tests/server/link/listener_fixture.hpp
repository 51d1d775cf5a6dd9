// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/stat.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>

#include "common/as_bytes.hpp"
#include "common/wire.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_store.hpp"
#include "testing/captured_log.hpp"
#include "testing/robot_client.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/running_server.hpp"

namespace orbbuf::test {

/// A whole server with `settings_`, its log, and the folder that it writes into.
class ListenerTest : public testing::Test {
 protected:
  /// The test may be held up for longer than a server waits. Each frame is acknowledged at once, so
  /// that a test can count the acks.
  ListenerTest() {
    settings_.sinks.files_path = folder_ / "data";
    settings_.sinks.files_sync = Durability::kSecond;
    settings_.listen.address.port = 0;
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
  /// A session of one frame whose files the server cannot read to their end before
  /// finish_reading().
  void make_unreadable(const std::string& session) const {
    const std::filesystem::path folder = folder_ / "data" / session;
    const auto image = as_bytes(kImage);
    const auto store = SessionStore::open(folder, {"", "", ""}, Durability::kSecond);
    ASSERT_FALSE(store.value()->write(frame_of(0, {image.begin(), image.end()}), 0));
    std::filesystem::remove(folder / session_names::left_image(0));
    ASSERT_EQ(::mkfifo((folder / session_names::left_image(0)).c_str(), 0600), 0);
  }
  /// Blocks until the server reads.
  void finish_reading(const std::string& session) const {
    write_file(folder_ / "data" / session / session_names::left_image(0), kImage);
  }
  static bool has_answer(const RobotClient& robot, int milliseconds) {
    pollfd events{robot.fd(), POLLIN, 0};
    return ::poll(&events, 1, milliseconds) > 0;
  }

  static constexpr const char* kImage = "an image";

  TemporaryFolder folder_;
  CapturedLog log_;
  Settings settings_;
  std::unique_ptr<RunningServer> server_;
};

}  // namespace orbbuf::test
