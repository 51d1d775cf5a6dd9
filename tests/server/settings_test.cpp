// SPDX-License-Identifier: Apache-2.0
#include "server/settings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "testing/source_folder.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;

Settings load(const std::vector<std::string>& overrides, const std::string& file = "") {
  ConfigReader reader(file, overrides);
  return load_settings(reader);
}

TEST(Settings, TheSampleSaysTheDefaults) {
  const std::filesystem::path folder = std::filesystem::path(test::kSourceFolder) / "config";
  Settings expected;
  expected.sinks.files_path = folder / "orbbuf-data";
  EXPECT_EQ(load({}, folder / "orbbuf-server.toml"), expected);
  EXPECT_EQ(load({}), Settings());
}

TEST(Settings, EveryKeyIsRead) {
  const Settings got = load({"log.level=debug",
                             "listen.address=[::1]:80",
                             "listen.insecure=true",
                             "listen.robots=[\"a\", \"b\"]",
                             "listen.max_robots=4",
                             "listen.max_connections=3",
                             "listen.max_connections_per_address=2",
                             "listen.hello_timeout=100 ms",
                             "listen.idle_timeout=2 s",
                             "listen.max_frame=1 MiB",
                             "listen.receive_buffer=0 B",
                             "http.address=0.0.0.0:7723",
                             "status.socket=/run/s",
                             "tls.certificate=/c",
                             "tls.key=/k",
                             "tls.ca=/a",
                             "session.timeout=1 min",
                             "session.drain_timeout=3 s",
                             "files.enabled=false",
                             "files.path=/out",
                             "files.sync=off",
                             "files.keep_size=2 GiB",
                             "files.keep_time=720 h",
                             "mcap.enabled=true",
                             "mcap.split=2 min",
                             "slam.fifo=/run/{robot}",
                             "slam.format=mjpeg",
                             "slam.restart=never",
                             "ros.frame_id=camera",
                             "ros.queue=7",
                             "ros.pace=3.5",
                             "ros.wait_for_subscriber=9 s",
                             "dds.frame_id={robot}/camera"});
  Settings expected;
  expected.log_level = "debug";
  expected.listen = {{"::1", 80},
                     {"/c", "/k", "/a"},
                     true,
                     {"a", "b"},
                     4,
                     3,
                     2,
                     std::chrono::milliseconds(100),
                     std::chrono::seconds(2),
                     1024 * 1024,
                     0};
  expected.http_address = Address{"0.0.0.0", 7723};
  expected.status_socket = "/run/s";
  expected.session_timeout = std::chrono::minutes(1);
  expected.drain_timeout = std::chrono::seconds(3);
  expected.sinks = {false,
                    "/out",
                    Durability::kOff,
                    true,
                    std::chrono::minutes(2),
                    {"", "/run/{robot}", PipeFormat::kMjpeg, Restart::kNever, Resume::kLive},
                    {},
                    {false, "camera", 7, 3.5, std::chrono::seconds(9)},
                    {false, "{robot}/camera"}};
  expected.quota = {2ULL * 1024 * 1024 * 1024, std::chrono::hours(720)};
  EXPECT_EQ(got, expected);
}

TEST(Settings, ARobotHasWhatItsOwnTableSaysAndTheRestFromTheTableOfAll) {
  const SinkSettings sinks =
      load({"slam.command=slam {robot}", "slam.restart=on-failure", "robot.a.slam.resume=backlog",
            "robot.b.slam.fifo=/b", "robot.b.slam.format=mjpeg", "robot.b.slam.restart=never",
            "robot.\"c.1\".slam.command="})
          .sinks;
  SlamSettings expected;
  expected.command = "slam {robot}";
  expected.restart = Restart::kOnFailure;
  EXPECT_EQ(sinks.slam_for("other"), expected);
  expected.resume = Resume::kBacklog;
  EXPECT_EQ(sinks.slam_for("a"), expected);
  EXPECT_EQ(sinks.slam_for("b"),
            (SlamSettings{"", "/b", PipeFormat::kMjpeg, Restart::kNever, Resume::kLive}));
  EXPECT_FALSE(sinks.slam_for("c.1").is_on());
}

TEST(Settings, ABridgeToRosHasToBeBuilt) {
#ifdef ORBBUF_ROS
  EXPECT_TRUE(load({"ros.enabled=true"}).sinks.ros.enabled);
#else
  EXPECT_THROW(load({"ros.enabled=true"}), ConfigError);
#endif
}

TEST(Settings, TopicsOfDdsHaveToBeBuilt) {
#ifdef ORBBUF_DDS
  EXPECT_TRUE(load({"dds.enabled=true", "files.enabled=false"}).sinks.dds.enabled);
#else
  EXPECT_THROW(load({"dds.enabled=true"}), ConfigError);
#endif
}

struct BadValue {
  std::vector<std::string> overrides;
  std::string complaint;
};

class BadSettings : public testing::TestWithParam<BadValue> {};

TEST_P(BadSettings, AreRefusedByName) {
  try {
    load(GetParam().overrides);
    FAIL() << "accepted";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr(GetParam().complaint));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Each, BadSettings,
    testing::Values(
        BadValue{{"log.level=loud"}, "log.level"},
        BadValue{{"listen.address=7722"}, "listen.address"},
        BadValue{{"listen.address=:7722"}, "listen.address"},
        BadValue{{"listen.address=::1:7722"}, "listen.address"},
        BadValue{{"listen.address=localhost:65536"}, "listen.address"},
        BadValue{{"listen.address=0.0.0.0:7722"}, "listen.insecure = true"},
        BadValue{{"listen.address=myserver:7722"}, "listen.insecure = true"},
        BadValue{{"listen.robots=[\"../etc\"]"}, "listen.robots"},
        BadValue{{"listen.max_robots=0"}, "listen.max_robots"},
        BadValue{{"listen.max_connections=0"}, "listen.max_connections"},
        BadValue{{"http.address=7723"}, "http.address"},
        BadValue{{"http.address=0.0.0.0:7723"}, "http.address: 0.0.0.0:7723 can be"},
        BadValue{{"tls.key=/k"}, "tls.certificate"},
        BadValue{{"listen.hello_timeout=0 s"}, "listen.hello_timeout"},
        BadValue{{"listen.idle_timeout=10"}, "listen.idle_timeout"},
        BadValue{{"listen.max_frame=2 GiB"}, "listen.max_frame"},
        BadValue{{"listen.receive_buffer=-1 B"}, "listen.receive_buffer"},
        BadValue{{"session.timeout=never"}, "session.timeout"},
        BadValue{{"files.enabled=yes"}, "files.enabled"}, BadValue{{"files.path=''"}, "files.path"},
        BadValue{{"files.sync=2 s"}, "files.sync"}, BadValue{{"files.enabled=false"}, "a sink"},
        BadValue{{"files.keep_size=1024"}, "files.keep_size"},
        BadValue{{"files.keep_time=-1 h"}, "files.keep_time"},
        BadValue{{"files.enabled=false", "slam.command=cat", "robot.a.slam.command="},
                 "robot.a.slam.command"},
        BadValue{{"files.enabled=false", "slam.command=cat", "slam.restart=never"}, "slam.restart"},
        BadValue{{"slam.fifo=/f", "slam.command=cat"}, "slam.command"},
        BadValue{{"robot.a.slam.fifo=/f", "robot.a.slam.command=cat"}, "robot.a.slam.command"},
        BadValue{{"files.enabled=false", "slam.command=cat", "slam.resume=backlog"}, "slam.resume"},
        BadValue{{"ros.queue=0"}, "ros.queue"}, BadValue{{"ros.pace=1"}, "ros.pace"},
        BadValue{{"dds.pace=1"}, "dds.pace"},
        BadValue{{"ros.wait_for_subscriber=-1 s"}, "ros.wait_for_subscriber"},
        BadValue{{"slam.format=png"}, "slam.format"},
        BadValue{{"slam.restart=yes"}, "slam.restart"},
        BadValue{{"slam.resume=later"}, "slam.resume"}, BadValue{{"slam.fifa=/f"}, "slam.fifa"},
        BadValue{{"robot.a.slum.fifo=/f"}, "robot.a.slum.fifo"},
        BadValue{{"robot.\"-a\".slam.fifo=/f"}, "not a robot id"}));

}  // namespace
}  // namespace orbbuf
