// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "testing/captured_log.hpp"
#include "testing/robot_client.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/running_server.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// Bad peers, one after the other, while a good robot streams at the same time.
class HostilePeers : public testing::Test {
 protected:
  static constexpr int kPeers = 1000;

  HostilePeers() {
    settings_.sinks.files_path = folder_.path();
    settings_.sinks.files_sync = Durability::kOff;  // each frame waits for its acknowledgement
    server_.emplace(settings_);
  }

  /// A short but complete life of a robot, as bytes.
  static Bytes valid_stream() {
    Bytes stream = wire::encode(wire::Hello{6, 6, "bad", "s", "test", "calibration", {}});
    const auto add = [&](const auto& bytes) {
      stream.insert(stream.end(), bytes.begin(), bytes.end());
    };
    for (Sequence i = 0; i < 3; ++i) {
      const auto frame = test::plain_frame(i, 300);
      add(wire::encode_frame_head(frame));
      add(frame.jpeg);
    }
    add(wire::encode(*test::drops_ptr(0, {{3, 0, DropReason::kPolicy}})));
    wire::Account account;
    account.session_id = "s";
    account.captured = 4;
    add(wire::encode(wire::Items{wire::kAccounts, 0, wire::encode_account(account)}));
    const auto late = wire::encode_late_record("s", test::plain_frame(3, 300));
    const auto late_bytes = static_cast<std::uint32_t>(late.size());
    add(wire::encode(wire::Items{wire::kLate, 0, wire::encode_late_part({0, late_bytes, late})}));
    add(wire::encode(wire::Report{{4, 0, 0, 1, 3, 0, 0}}));
    add(wire::encode(wire::Bye{{4, 1}}));
    return stream;
  }

  int random(int below) { return std::uniform_int_distribution(0, below - 1)(random_); }

  /// Runs all peers, each with its own bytes, and checks that the good robot lost nothing.
  template <class MakeBytes>
  void expect_no_harm(MakeBytes make_bytes) {
    const test::RobotClient good(server_->port());
    ASSERT_TRUE(good.hello("good", "s"));
    for (Sequence i = 0; i < kPeers; ++i) {
      test::RobotClient bad(server_->port());
      bad.send(make_bytes());
      bad.close(random(2) == 0);
      good.send_frame(test::plain_frame(i, 1000));
      ASSERT_TRUE(good.acked(i + 1));
    }
    EXPECT_EQ(test::read_lines(folder_ / "good/s/times.txt").size(), std::size_t{kPeers});
  }

  test::TemporaryFolder folder_;
  test::CapturedLog log_;
  Settings settings_;
  std::optional<test::RunningServer> server_;
  std::minstd_rand random_{1};
};

TEST_F(HostilePeers, RandomBytesDoNoHarm) {
  expect_no_harm([this] {
    Bytes bytes(static_cast<std::size_t>(random(2000)));
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random(256));
    return bytes;
  });
}

TEST_F(HostilePeers, MutatedStreamsDoNoHarm) {
  const Bytes valid = valid_stream();
  expect_no_harm([&] {
    Bytes bytes = valid;
    const auto size = static_cast<int>(bytes.size());
    for (int i = random(4); i >= 0; --i) {
      bytes[static_cast<std::size_t>(random(size))] ^= static_cast<std::uint8_t>(1 << random(8));
    }
    if (random(3) == 0) bytes.resize(static_cast<std::size_t>(random(size)));
    return bytes;
  });
}

}  // namespace
}  // namespace orbbuf
