// SPDX-License-Identifier: Apache-2.0
#include "daemon/settings.hpp"

#include <gtest/gtest.h>

#include <cstdlib>

#include "common/config.hpp"
#include "common/wire.hpp"
#include "testing/source_folder.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

const std::filesystem::path kSample = test::kSourceFolder + std::string("/config/orbbufd.toml");

Settings with(const std::vector<std::string>& overrides) { return load_settings({}, overrides); }

std::string why(const std::vector<std::string>& overrides) {
  try {
    with(overrides);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Settings, SampleFileHoldsEveryKeyWithItsDefault) {
  const Settings sample = load_settings(kSample, {});
  const Settings fallback = with({});
  EXPECT_EQ(sample.log_level, fallback.log_level);
  EXPECT_EQ(sample.robot_id, fallback.robot_id);
  EXPECT_EQ(sample.calibration, fallback.calibration);
  EXPECT_EQ(sample.source.kind, fallback.source.kind);
  EXPECT_EQ(sample.source.path, fallback.source.path);
  EXPECT_EQ(sample.source.path_right, fallback.source.path_right);
  EXPECT_EQ(sample.source.topic, fallback.source.topic);
  EXPECT_EQ(sample.source.topic_right, fallback.source.topic_right);
  EXPECT_EQ(sample.source.device, fallback.source.device);
  EXPECT_EQ(sample.source.device_right, fallback.source.device_right);
  EXPECT_EQ(sample.source.is_side_by_side, fallback.source.is_side_by_side);
  EXPECT_EQ(sample.source.format, fallback.source.format);
  EXPECT_EQ(sample.source.controls, fallback.source.controls);
  EXPECT_EQ(sample.source.fps, fallback.source.fps);
  EXPECT_EQ(sample.source.realtime, fallback.source.realtime);
  EXPECT_EQ(sample.source.loop, fallback.source.loop);
  EXPECT_EQ(sample.source.seed, fallback.source.seed);
  EXPECT_EQ(sample.source.width_px, fallback.source.width_px);
  EXPECT_EQ(sample.source.height_px, fallback.source.height_px);
  EXPECT_EQ(sample.source.frames, fallback.source.frames);
  EXPECT_EQ(sample.jpeg.quality, fallback.jpeg.quality);
  EXPECT_EQ(sample.jpeg.color, fallback.jpeg.color);
  EXPECT_EQ(sample.features.count, fallback.features.count);
  EXPECT_EQ(sample.features.levels, fallback.features.levels);
  EXPECT_EQ(sample.features.pixels, fallback.features.pixels);
  EXPECT_EQ(sample.buffer.capacity, fallback.buffer.capacity);
  EXPECT_EQ(sample.buffer.policy, fallback.buffer.policy);
  EXPECT_EQ(sample.buffer.seed, fallback.buffer.seed);
  EXPECT_EQ(sample.link.servers, fallback.link.servers);
  EXPECT_EQ(sample.link.interfaces, fallback.link.interfaces);
  EXPECT_EQ(sample.buffer.plan.least_quality, fallback.buffer.plan.least_quality);
  EXPECT_EQ(sample.link.return_after, fallback.link.return_after);
  EXPECT_EQ(sample.link.attempt_interval, fallback.link.attempt_interval);
  EXPECT_EQ(sample.link.connect_timeout, fallback.link.connect_timeout);
  EXPECT_EQ(sample.link.stall_timeout, fallback.link.stall_timeout);
  EXPECT_EQ(sample.link.ack_timeout, fallback.link.ack_timeout);
  EXPECT_EQ(sample.link.drain_timeout, fallback.link.drain_timeout);
  EXPECT_EQ(sample.link.unsent_bytes, fallback.link.unsent_bytes);
  EXPECT_EQ(sample.link.tls, fallback.link.tls);
  EXPECT_EQ(sample.record.path, fallback.record.path);
  EXPECT_EQ(sample.record.size_bytes, fallback.record.size_bytes);
  EXPECT_EQ(sample.record.rate_bytes_per_s, fallback.record.rate_bytes_per_s);
}

TEST(Settings, DropLogIsInTheServicesStateFolder) {
  EXPECT_EQ(with({}).record.path, "");
  ::setenv("STATE_DIRECTORY", "/var/lib/robot", 1);
  EXPECT_EQ(with({}).record.path, "/var/lib/robot/drops");
  EXPECT_EQ(with({"buffer.drop_log="}).record.path, "");
  EXPECT_EQ(with({"buffer.drop_log=/tmp/drops"}).record.path, "/tmp/drops");
  ::unsetenv("STATE_DIRECTORY");
}

TEST(Settings, SpoolIsOffUntilItHasAFolder) {
  EXPECT_FALSE(with({}).record.keeps_frames);
  EXPECT_EQ(with({}).record.size_bytes, 256U << 20) << "of samples and accounts";
  EXPECT_EQ(with({"spool.path=/tmp/spool"}).record.size_bytes, 8ULL << 30);
  EXPECT_EQ(with({}).record.rate_bytes_per_s, 4U << 20);
  const Settings s = with({"spool.path=/tmp/spool", "spool.size=4 MiB", "spool.rate=0 B"});
  EXPECT_TRUE(s.record.keeps_frames);
  EXPECT_EQ(s.record.path, "/tmp/spool");
  EXPECT_EQ(s.record.size_bytes, RecordSettings::kMinBytes);
  EXPECT_EQ(s.record.rate_bytes_per_s, 0U);
  EXPECT_NE(why({"spool.size=4095 KiB"}).find("spool.size"), std::string::npos);
}

TEST(Settings, DropRecordsAreInTheFolderOfTheSpool) {
  ::setenv("STATE_DIRECTORY", "/var/lib/robot", 1);
  EXPECT_EQ(with({"spool.path=/tmp/spool"}).record.path, "/tmp/spool");
  ::unsetenv("STATE_DIRECTORY");
  EXPECT_NE(why({"spool.path=/tmp/spool", "buffer.drop_log=/tmp/drops"}).find("buffer.drop_log"),
            std::string::npos);
  EXPECT_EQ(with({"spool.path=/tmp/spool", "buffer.drop_log=/tmp/../tmp/spool/"}).record.path,
            "/tmp/spool");
}

TEST(Settings, TheLeastQualityIsNoMoreThanTheQuality) {
  EXPECT_EQ(with({}).buffer.plan.quality, 80);
  EXPECT_EQ(with({}).buffer.plan.least_quality, 20);
  EXPECT_EQ(with({"jpeg.quality=15"}).buffer.plan.least_quality, 15);
  const Settings same = with({"jpeg.quality=60", "jpeg.least_quality=60"});
  EXPECT_EQ(same.buffer.plan.quality, 60);
  EXPECT_EQ(same.buffer.plan.least_quality, 60);
  EXPECT_NE(why({"jpeg.quality=60", "jpeg.least_quality=61"}).find("jpeg.least_quality"),
            std::string::npos);
}

TEST(Settings, AttemptsToConnectSuitTheLateness) {
  const auto interval = [](const std::vector<std::string>& settings) {
    return with(settings).link.attempt_interval;
  };
  EXPECT_EQ(interval({}), std::chrono::milliseconds(100));
  EXPECT_EQ(interval({"link.live_again=10 s"}), std::chrono::milliseconds(100));
  EXPECT_EQ(interval({"link.live_again=250 ms"}), std::chrono::milliseconds(50));
  EXPECT_EQ(interval({"link.live_again=60 ms"}), std::chrono::milliseconds(20));
  EXPECT_EQ(interval({"link.live_again=250 ms", "link.attempt_interval=1 s"}),
            std::chrono::seconds(1));
}

TEST(Settings, EveryValueReachesItsPlace) {
  const Settings s =
      with({"log.level=debug", "robot.id=front", "source.kind=folder", "source.path=/data",
            "source.realtime=false", "source.loop=true", "jpeg.color=true", "features.pixels=50000",
            "buffer.policy=uniform", "link.server=[::1]:9", "link.stall_timeout=250 ms",
            "link.attempt_interval=70 ms", "link.unsent=1 MiB",
            "link.interfaces=[\"wlan0\", \"10.0.0.7\"]", "link.return_after=20 s"});
  EXPECT_EQ(s.log_level, "debug");
  EXPECT_EQ(s.robot_id, "front");
  EXPECT_EQ(s.source.kind, "folder");
  EXPECT_EQ(s.source.path, "/data");
  EXPECT_FALSE(s.source.realtime);
  EXPECT_TRUE(s.source.loop);
  EXPECT_TRUE(s.jpeg.color);
  EXPECT_TRUE(s.source.color);
  EXPECT_EQ(s.features.pixels, 50000);
  EXPECT_EQ(s.buffer.policy, "uniform");
  EXPECT_EQ(s.link.servers, (std::vector<Address>{{"::1", 9}}));
  EXPECT_EQ(s.link.stall_timeout, std::chrono::milliseconds(250));
  EXPECT_EQ(s.link.attempt_interval, std::chrono::milliseconds(70));
  EXPECT_EQ(s.link.unsent_bytes, 1U << 20);
  EXPECT_EQ(s.link.interfaces, (std::vector<std::string>{"wlan0", "10.0.0.7"}));
  EXPECT_EQ(s.link.return_after, std::chrono::seconds(20));
}

TEST(Settings, ACameraNeedsNoPath) {
  EXPECT_EQ(with({"source.kind=ros2", "source.topic=/camera/image"}).source.topic, "/camera/image");
  const Settings s = with({"source.kind=v4l2", "source.device=/dev/video2", "source.format=MJPG",
                           "source.controls.exposure_auto=1"});
  EXPECT_EQ(s.source.device, "/dev/video2");
  EXPECT_EQ(s.source.format, "MJPG");
  EXPECT_EQ(s.source.controls, (std::map<std::string, double>{{"exposure_auto", 1}}));
  const Settings other =
      with({"source.kind=libcamera", "source.camera=1", "source.controls.analogue_gain=2.5"});
  EXPECT_EQ(other.source.camera, "1");
  EXPECT_EQ(other.source.controls, (std::map<std::string, double>{{"analogue_gain", 2.5}}));
}

void names(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

TEST(Settings, ServersAreOneOrSeveral) {
  const std::vector<Address> two{{"a", 7722}, {"::1", 9}};
  EXPECT_EQ(with({R"(link.server=["a:7722", "[::1]:9"])"}).link.servers, two);
  EXPECT_EQ(with({R"(link.server=["a:7722"])"}).link.servers, (std::vector{two.front()}));
  const test::TemporaryFolder folder;
  test::write_file(folder / "c.toml", "[link]\nserver = ['a:7722', '[::1]:9']\n");
  EXPECT_EQ(load_settings(folder / "c.toml", {}).link.servers, two);
  names(why({"link.server=[]"}), "link.server: names no server");
  names(why({"link.server=3"}), "link.server: expected a string or an array of strings");
  names(why({R"(link.server=["a:1", "b"])"}), "link.server: expected HOST:PORT");
  names(why({R"(link.server=["a:1", "b:0"])"}), "link.server: port must not be 0");
  names(why({R"(link.server=["a:1", "b:1", "a:1"])"}), "link.server: names a server twice: a:1");
  names(why({R"(link.server=["a:1","a:2","a:3","a:4","a:5","a:6","a:7","a:8","a:9"])"}),
        "link.server: more than 8 servers");
}

TEST(Settings, InterfacesAreDifferentAndHaveNames) {
  names(why({"link.interfaces=[\"wlan0\", \"wlan0\"]"}),
        "link.interfaces: names an interface twice");
  names(why({"link.interfaces=[\"wlan0\", \"\"]"}),
        "link.interfaces: the name of an interface is empty");
  names(why({R"(link.interfaces=["a", "b", "c", "d", "e", "f", "g", "h", "i"])"}),
        "link.interfaces: more than 8 interfaces");
}

TEST(Settings, StereoIsTwoFoldersTwoCamerasOrSideBySide) {
  EXPECT_EQ(
      with({"source.kind=folder", "source.path=/l", "source.path_right=/r"}).source.path_right,
      "/r");
  EXPECT_EQ(with({"source.kind=v4l2", "source.device_right=/dev/video2"}).source.device_right,
            "/dev/video2");
  EXPECT_TRUE(with({"source.kind=v4l2", "source.stereo=side-by-side"}).source.is_side_by_side);
  names(why({"source.path_right=/r"}),
        "source.path_right: valid only for source.kind = \"folder\"");
  names(why({"source.device_right=/dev/video2"}), "valid only for source.kind = \"v4l2\"");
  names(why({"source.kind=v4l2", "source.device_right=/dev/video0"}),
        "source.device_right: must not be the same camera as source.device");
  names(why({"source.kind=v4l2", "source.device_right=/dev/video2", "source.stereo=side-by-side"}),
        "source.device_right: cannot be combined with source.stereo = \"side-by-side\"");
  names(why({"source.topic_right=/r"}), "valid only for source.kind = \"ros2\"");
  names(why({"source.kind=ros2", "source.topic=/l", "source.topic_right=/l"}),
        "source.topic_right: must not be the same topic as source.topic");
  names(why({"source.stereo=side-by-side", "source.width=641"}), "source.width: must be even");
  names(why({"source.stereo=both"}), "source.stereo: ");
}

TEST(Settings, TheRobotsOwnNodesMayGetTheFrames) {
  EXPECT_EQ(with({}).publish, "");
  names(why({"source.publish=camera"}), "source.publish: expected a name of ROS 2");
  names(why({"source.kind=ros2", "source.topic=/a", "source.publish=/camera"}),
        "source.publish: cannot be combined with source.kind = \"ros2\"");
#ifdef ORBBUF_DAEMON_DDS
  EXPECT_EQ(with({"source.publish=/front/camera"}).publish, "/front/camera");
#else
  names(why({"source.publish=/camera"}), "source.publish: orbbufd was built without DDS");
#endif
}

TEST(Settings, WhatCannotBeIsRefusedByName) {
  names(why({"robot.id=../etc"}), "robot.id: ");
  names(why({"source.kind=folder"}), "source.path: required for source.kind = \"folder\"");
  names(why({"stream.imu0.kind=ros2"}), "stream.imu0.topic: required");
  EXPECT_EQ(with({"stream.imu0.kind=ros2", "stream.imu0.topic=/imu"}).streams.at(0).topic, "/imu");
  names(why({"source.kind=ros2"}), "source.topic: required for source.kind = \"ros2\"");
  names(why({"source.kind=kinect"}), "source.kind: ");
  names(why({"source.format=YUV"}), "one of auto, GREY, NV12, YUV420, YUYV, UYVY, BGR24");
  names(why({"features.pixels=3"}), "features.pixels");
  names(why({"buffer.capacity=2"}), "buffer.capacity: ");
  names(why({"buffer.policy=best"}), "drop-youngest");
  names(why({"link.server=nowhere"}), "link.server: expected HOST:PORT");
  names(why({"link.server=nowhere:0"}), "link.server: port must not be 0");
  names(why({"camera.calibration=1 2 3"}), "camera.calibration: ");
  names(why({"camera.calibration=\"1\\n2\\n\""}),
        "camera.calibration: read as DSO's camera.txt: 2 lines");
  names(why({"bufer.capacity=9"}), "buffer.capacity");
}

TEST(Settings, AStreamOfSamplesSaysWhereTheyComeFrom) {
  const auto streams = with({"stream.imu0.path=imu.csv", "stream.imu1.kind=iio",
                             "stream.imu1.device=[\"gyro\", \"accel\"]", "stream.imu2.kind=socket",
                             "stream.imu2.path=/run/imu"})
                           .streams;
  ASSERT_EQ(streams.size(), 3U);
  EXPECT_EQ(streams[0].kind, "euroc");
  EXPECT_EQ(streams[1].devices, (std::vector<std::string>{"gyro", "accel"}));
  EXPECT_EQ(streams[2].path, "/run/imu");
  names(why({"stream.imu0.kind=socket"}), "stream.imu0.path: required");
  names(why({"stream.imu0.kind=iio", "stream.imu0.path=/dev/null"}),
        "stream.imu0.device: required");
  names(why({"stream.gyro.path=imu.csv"}), "begins with \"imu\"");
  const auto topics =
      with({"stream.odom.kind=topic", "stream.odom.topic=/odom", "stream.scan.kind=topic",
            "stream.scan.topic=/scan", "stream.scan.policy=latest", "stream.scan.rate=2.5",
            "stream.tof.kind=topic", "stream.tof.topic=/depth", "stream.tof.policy=frames",
            "source.fps=20"})
          .streams;
  ASSERT_EQ(topics.size(), 3U);
  EXPECT_EQ(topics[0].topic, "/odom");
  EXPECT_EQ(topics[0].policy, TopicPolicy::kAll);
  EXPECT_EQ(topics[1].policy, TopicPolicy::kLatest);
  EXPECT_EQ(topics[1].rate, 2.5);
  EXPECT_EQ(topics[2].policy, TopicPolicy::kFrames);
  EXPECT_EQ(topics[2].frame_time, std::chrono::milliseconds(50));
  names(why({"stream.odom.kind=topic"}), "stream.odom.topic: required");
  names(why({"stream.odom.kind=topic", "stream.odom.topic=/odom", "stream.odom.policy=plan"}),
        "stream.odom.policy");
  names(why({"stream.imu0.path=imu.csv", "stream.imu0.policy=latest"}), "stream.imu0.policy");
}

TEST(Settings, CalibrationOfFourLinesIsKeptAsItIs) {
  const test::TemporaryFolder folder;
  const std::string calibration = "Pinhole 1 2 3 4 0\n640 480\nnone\n640 480\n";
  test::write_file(folder / "c.toml", "[camera]\ncalibration = '''\n" + calibration + "'''\n");
  EXPECT_EQ(load_settings(folder / "c.toml", {}).calibration, calibration);
}

const std::string kChain =
    "cam0:\n  camera_model: pinhole\n  intrinsics: [9, 9, 5, 5]\n  resolution: [10, 10]\n";
const std::string kNoise =
    "gyroscope_noise_density: 0.1\ngyroscope_random_walk: 0.2\naccelerometer_noise_density: 0.3\n"
    "accelerometer_random_walk: 0.4\n";

TEST(Settings, ACalibrationOfKalibrHasItsSensorsBehindIt) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "chain.yaml", "%YAML:1.0\n" + kChain);
  test::write_file(folder / "imu.yaml", "# MPU 6050\n---\n" + kNoise + "update_rate: 200.0");
  test::write_file(folder / "c.toml",
                   "[camera]\ncalibration = 'chain.yaml'\n"
                   "[stream.imu0]\npath = 'a'\ncalibration = 'imu.yaml'\n"
                   "[stream.imu_b]\npath = 'b'\ncalibration = 'imu.yaml'\n");
  const std::string noise =
      "  gyroscope_noise_density: 0.1\n  gyroscope_random_walk: 0.2\n"
      "  accelerometer_noise_density: 0.3\n  accelerometer_random_walk: 0.4\n"
      "  update_rate: 200.0\n";
  const Settings settings = load_settings(folder / "c.toml", {});
  EXPECT_EQ(settings.calibration,
            "%YAML 1.0\n---\n" + kChain + "imu0:\n" + noise + "imu_b:\n" + noise);
  ASSERT_EQ(settings.warnings.size(), 1U);
  names(settings.warnings[0], "cam0 has neither T_cam_imu nor T_imu_cam");
  names(why({"stream.imu0.path=a", "stream.imu0.calibration=" + (folder / "imu.yaml").string()}),
        "needs Kalibr's camchain.yaml");
}

TEST(Settings, ACalibrationThatCannotBeReadIsRefusedAndAnotherModelIsAWarning) {
  const test::TemporaryFolder folder;
  const auto chain = [&](const std::string& text) {
    test::write_file(folder / "chain.yaml", text);
    return "camera.calibration=" + (folder / "chain.yaml").string();
  };
  const auto imu = [&](const std::string& text) {
    test::write_file(folder / "imu.yaml", text);
    return "stream.imu0.calibration=" + (folder / "imu.yaml").string();
  };
  names(why({chain("cam0: [1\n")}),
        "camera.calibration: read as Kalibr's camchain.yaml: yaml-cpp: error at line ");
  names(why({chain("left: {resolution: [10, 10]}\n")}), "camchain.yaml: cam0: missing");
  names(why({chain("cam0: {camera_model: pinhole, resolution: [10]}\n")}), "cam0.resolution: ");
  names(why({chain("Pinhole 1 2 3\n640 480\ncrop\n640 480\n")}),
        "camera.calibration: read as DSO's camera.txt: line 1: ");
  EXPECT_TRUE(with({chain(kChain)}).warnings.empty());
  names(why({chain(kChain), "stream.imu0.path=a", imu("update_rate: 200\n")}),
        "stream.imu0.calibration: imu0.gyroscope_noise_density: expected a number above 0");
  names(why({chain(kChain), "stream.imu0.path=a", imu("imu0: [\n")}),
        "stream.imu0.calibration: yaml-cpp: error");
  const Settings sphere = with({chain(
      "cam0: {camera_model: ds, intrinsics: [0.5, 0.5, 9, 9, 5, 5], resolution: [10, 10]}\n")});
  ASSERT_EQ(sphere.warnings.size(), 1U);
  names(sphere.warnings[0], "camera.calibration: cam0.camera_model: ds; expected pinhole");
  EXPECT_NE(sphere.calibration.find("intrinsics: [0.5, 0.5, 9, 9, 5, 5]"), std::string::npos);
}

TEST(Settings, SessionIdsAreValid) {
  const std::string a = new_session_id();
  EXPECT_TRUE(wire::is_valid_id(a)) << a;
  EXPECT_EQ(a.size(), std::string("20261121T073000Z-4f3a0b1c2d3e4f50").size());
}

}  // namespace
}  // namespace orbbuf
