// SPDX-License-Identifier: Apache-2.0
#include "daemon/settings.hpp"

#include <fmt/chrono.h>
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <random>
#include <set>

#include "common/calibration/calibration.hpp"
#include "common/calibration/kalibr.hpp"
#include "common/config.hpp"
#include "common/file_io.hpp"
#include "common/log.hpp"
#include "common/ros_name.hpp"
#include "common/wire.hpp"
#include "daemon/capture/camera_formats.hpp"

namespace orbbuf {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr auto kSourceFormats = [] {
  std::array<std::string_view, kCameraFormats.size() + 1> formats = {"auto"};
  std::copy(kCameraFormats.begin(), kCameraFormats.end(), formats.begin() + 1);
  return formats;
}();
constexpr std::array<std::string_view, 2> kStereo = {"none", "side-by-side"};
constexpr int kLeastQuality = 20;  // docs/evaluation.md has what SLAM makes of less
constexpr std::int64_t kMaxInteger = std::numeric_limits<std::int64_t>::max();

std::string host_name() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0 || !wire::is_valid_id(name.data())) {
    return "robot";
  }
  return name.data();
}

/// Of the file that `key` names; empty if there is none.
std::string read_text(ConfigReader& config, const std::string& key) {
  const auto path = config.path(key, {});
  if (path.empty()) return {};
  const auto content = read_file(path);
  if (!content) config.fail(key, content.error().text);
  return {content.value().begin(), content.value().end()};
}

/// The text of a camera.txt, of the file that is named if it is but one line, or Kalibr's.
std::string read_calibration(ConfigReader& config) {
  const std::string key = "camera.calibration";
  std::string text = config.text(key, "");
  if (!text.empty() && text.find('\n') == text.npos) text = read_text(config, key);
  if (text.empty()) return text;
  const bool is_chain = is_kalibr(text);
  if (const auto read = parse_any_calibration(text); !read) {
    config.fail(
        key, fmt::format("read as {}: {}", is_chain ? "Kalibr's camchain.yaml" : "DSO's camera.txt",
                         read.error().text));
  }
  if (!is_chain) return text;
  auto rewritten = rewrite_kalibr(text);
  if (!rewritten) config.fail(key, rewritten.error().text);
  return std::move(rewritten).value();
}

/// Adds the imu.yaml of a sensor, if `key` names one, below the calibration of the cameras.
void read_imu(ConfigReader& config, const std::string& key, const std::string& name,
              std::string& calibration) {
  const auto imu_yaml = read_text(config, key);
  if (imu_yaml.empty()) return;
  if (!is_kalibr(calibration)) {
    config.fail(key, "needs Kalibr's camchain.yaml in camera.calibration");
  }
  const auto joined = add_imu(calibration, name, imu_yaml);
  if (!joined) config.fail(key, joined.error().text);
  calibration = joined.value();
  if (const auto read = parse_any_calibration(calibration); !read) {
    config.fail(key, read.error().text);
  }
}

/// What a calibration lacks that is no error.
std::vector<std::string> calibration_warnings(const std::string& calibration) {
  std::vector<std::string> warnings;
  const auto read = parse_any_calibration(calibration);
  if (!read) return warnings;
  if (!read.value().unread.empty()) {
    warnings.push_back(fmt::format(
        "camera.calibration: {}; the server keeps the file as it is, and makes no camera.txt, "
        "sensor.yaml or camera_info of it",
        read.value().unread));
  }
  for (const std::string& remark : read.value().remarks) {
    warnings.push_back("camera.calibration: " + remark);
  }
  return warnings;
}

void read_robot(ConfigReader& config, Settings& settings) {
  settings.robot_id = config.text("robot.id", "");
  if (settings.robot_id.empty()) settings.robot_id = host_name();
  if (!wire::is_valid_id(settings.robot_id)) {
    config.fail("robot.id",
                fmt::format("expected 1 to {} characters of A-Z a-z 0-9 . _ -, the first "
                            "a letter, a digit or _, got \"{}\"",
                            wire::kMaxIdBytes, settings.robot_id));
  }
  settings.calibration = read_calibration(config);
}

void read_source(ConfigReader& config, SourceSettings& source) {
  config.read("source.kind", source.kind, kSourceKinds);
  config.read("source.path", source.path);
  const bool is_file = source.kind == "folder" || source.kind == "video";
  if (is_file && source.path.empty()) {
    config.fail("source.path", "required for source.kind = \"" + source.kind + "\"");
  }
  config.read("source.topic", source.topic);
  if (source.kind == "ros2" && source.topic.empty()) {
    config.fail("source.topic", "required for source.kind = \"ros2\"");
  }
  config.read("source.device", source.device);
  config.read("source.camera", source.camera);
  config.read("source.format", source.format, kSourceFormats);
  source.controls = config.numbers("source.controls");
  if (const auto crop = config.text("source.crop", ""); !crop.empty()) {
    source.crop = parse_crop(crop);
    if (!source.crop) {
      config.fail("source.crop", "expected WIDTHxHEIGHT+LEFT+TOP, got \"" + crop + "\"");
    }
    if (source.kind != "v4l2" && source.kind != "libcamera") {
      config.fail("source.crop", "valid only for cameras (source.kind v4l2, libcamera)");
    }
  }
  config.read("source.fps", source.fps, 0.01, 1000);
  config.read("source.realtime", source.realtime);
  config.read("source.loop", source.loop);
  config.read("source.width", source.width_px, 64, 4096);
  config.read("source.height", source.height_px, 64, 4096);
  config.read("source.frames", source.frames, 1, kMaxInteger);
  config.read("source.seed", source.seed, 0, kMaxInteger);
}

void read_stereo(ConfigReader& config, SourceSettings& source) {
  config.read("source.path_right", source.path_right);
  config.read("source.device_right", source.device_right);
  config.read("source.topic_right", source.topic_right);
  source.is_side_by_side = config.choice("source.stereo", "none", kStereo) == "side-by-side";
  const auto require = [&](const char* key, bool is_set, std::string_view kind) {
    if (!is_set) return;
    if (source.kind != kind)
      config.fail(key, fmt::format("valid only for source.kind = \"{}\"", kind));
    if (source.is_side_by_side)
      config.fail(key, "cannot be combined with source.stereo = \"side-by-side\"");
  };
  require("source.path_right", !source.path_right.empty(), "folder");
  require("source.device_right", !source.device_right.empty(), "v4l2");
  require("source.topic_right", !source.topic_right.empty(), "ros2");
  if (!source.device_right.empty() && source.device_right == source.device) {
    config.fail("source.device_right", "must not be the same camera as source.device");
  }
  if (!source.topic_right.empty() && source.topic_right == source.topic) {
    config.fail("source.topic_right", "must not be the same topic as source.topic");
  }
  const bool has_width = source.kind == "generated" || source.kind == "v4l2";
  if (source.is_side_by_side && has_width && source.width_px % 2 != 0) {
    config.fail("source.width", "must be even with source.stereo = \"side-by-side\"");
  }
}

void read_publish(ConfigReader& config, Settings& settings) {
  const std::string key = "source.publish";
  config.read(key, settings.publish);
  if (settings.publish.empty()) return;
  if (!is_ros_topic(settings.publish)) {
    config.fail(key, fmt::format(R"(expected a name of ROS 2 such as "/camera", got "{}")",
                                 settings.publish));
  }
  if (settings.source.kind == "ros2") {
    config.fail(key, "cannot be combined with source.kind = \"ros2\", whose images are a topic");
  }
#ifndef ORBBUF_DAEMON_DDS
  config.fail(key, "orbbufd was built without DDS (cmake -DORBBUF_WITH_DDS=ON)");
#endif
}

void read_images(ConfigReader& config, Settings& settings) {
  JpegSettings& jpeg = settings.jpeg;
  config.read("jpeg.quality", jpeg.quality, 1, 100);
  config.read("jpeg.color", jpeg.color);
  settings.source.color = jpeg.color;
  FeatureSettings& features = settings.features;
  config.read("features.count", features.count, 10, 10000);
  config.read("features.levels", features.levels, 1, 16);
  config.read("features.pixels", features.pixels, 10'000, 100'000'000);
}

/// In the folder that systemd gives the service; a run by hand keeps none.
std::filesystem::path default_drop_log() {
  const char* const state = std::getenv("STATE_DIRECTORY");
  return state == nullptr ? std::filesystem::path() : std::filesystem::path(state) / "drops";
}

void read_buffer(ConfigReader& config, BufferSettings& buffer) {
  config.read("buffer.policy", buffer.policy, kPolicies);
  if (buffer.policy == "orbbuf" && !OrbExtractor::is_built()) {
    config.fail("buffer.policy",
                "orbbufd was built without OpenCV's features2d, which the policy "
                "orbbuf needs; build it with ORBBUF_ORB");
  }
  config.read_bytes("buffer.memory", buffer.memory_bytes, 1 << 20, 1LL << 40);
  config.read("buffer.capacity", buffer.capacity, 3, 100000);
  config.read("buffer.seed", buffer.seed, 0, kMaxInteger);
}

void read_plan(ConfigReader& config, int quality, PlanSettings& plan) {
  plan.quality = quality;
  plan.least_quality = static_cast<int>(
      config.integer("jpeg.least_quality", std::min(kLeastQuality, quality), 1, 100));
  if (plan.least_quality > quality) {
    config.fail("jpeg.least_quality",
                fmt::format("must not be more than jpeg.quality, {}", quality));
  }
  config.read("link.live_again", plan.live_again, milliseconds(50), hours(1));
  config.read("link.largest_step", plan.largest_step, milliseconds(1), hours(1));
}

void read_interfaces(ConfigReader& config, LinkSettings& link) {
  constexpr std::size_t kMost = 8;
  link.interfaces = config.texts("link.interfaces");
  const std::set<std::string> different(link.interfaces.begin(), link.interfaces.end());
  if (different.size() != link.interfaces.size()) {
    config.fail("link.interfaces", "names an interface twice");
  }
  if (different.contains("")) config.fail("link.interfaces", "the name of an interface is empty");
  if (different.size() > kMost) {
    config.fail("link.interfaces", "more than " + std::to_string(kMost) + " interfaces");
  }
  config.read("link.return_after", link.return_after, milliseconds(0), hours(24));
}

void read_servers(ConfigReader& config, std::vector<Address>& servers) {
  constexpr std::size_t kMost = 8;
  const auto texts = config.one_or_more_texts("link.server", {to_string(servers.front())});
  servers.clear();
  for (const std::string& text : texts) {
    const auto server = parse_address(text);
    if (!server) config.fail("link.server", server.error().text);
    if (server.value().port == 0) config.fail("link.server", "port must not be 0");
    if (std::ranges::find(servers, server.value()) != servers.end()) {
      config.fail("link.server", "names a server twice: " + text);
    }
    servers.push_back(server.value());
  }
  if (servers.empty()) config.fail("link.server", "names no server");
  if (servers.size() > kMost) {
    config.fail("link.server", "more than " + std::to_string(kMost) + " servers");
  }
}

void read_link(ConfigReader& config, std::chrono::nanoseconds live_again, LinkSettings& link) {
  read_servers(config, link.servers);
  read_interfaces(config, link);
  if (config.text("link.attempt_interval", "auto") == "auto") {
    link.attempt_interval = std::clamp<std::chrono::nanoseconds>(live_again / 5, milliseconds(20),
                                                                 link.attempt_interval);
  } else {
    config.read("link.attempt_interval", link.attempt_interval, milliseconds(20), hours(1));
  }
  config.read("link.connect_timeout", link.connect_timeout, milliseconds(10), hours(1));
  config.read("link.stall_timeout", link.stall_timeout, milliseconds(100), hours(1));
  config.read("link.ack_timeout", link.ack_timeout, seconds(1), hours(24));
  config.read("link.drain_timeout", link.drain_timeout, milliseconds(0), hours(24));
  config.read_bytes("link.unsent", link.unsent_bytes, 1024, 1 << 30);
  load_tls(config, link.tls);
}

/// Frames and drop records are in one folder.
void read_record(ConfigReader& config, RecordSettings& record) {
  const auto frames = config.path("spool.path", {});
  config.read_bytes("spool.size", record.size_bytes, RecordSettings::kMinBytes, 1LL << 50);
  config.read_bytes("spool.rate", record.rate_bytes_per_s, 0, 1LL << 40);
  const bool is_default = config.text("buffer.drop_log", "auto") == "auto";
  const auto drops = is_default ? default_drop_log() : config.path("buffer.drop_log", {});
  record.keeps_frames = !frames.empty();
  record.path = record.keeps_frames ? frames : drops;
  if (!record.keeps_frames) record.size_bytes = RecordSettings::kBytesWithoutFrames;
  const auto real = [](const auto& path) { return std::filesystem::weakly_canonical(path / ""); };
  if (record.keeps_frames && !is_default && !drops.empty() && real(drops) != real(frames)) {
    config.fail("buffer.drop_log",
                "must be \"auto\" or the same as spool.path, which has the drop "
                "records as well");
  }
}

void read_streams(ConfigReader& config, Settings& settings) {
  auto& streams = settings.streams;
  constexpr std::array<std::string_view, 6> kKinds = {"euroc", "socket",    "iio",
                                                      "ros2",  "generated", "topic"};
  constexpr std::array<std::string_view, 3> kTopicPolicies = {"all", "latest", "frames"};
  constexpr std::size_t kMost = wire::kMostStreams - wire::kFirstOther;
  for (const auto& [name, key] : config.tables("stream")) {
    SampleStreamSettings stream;
    stream.name = name;
    stream.kind = config.choice(key + ".kind", kKinds.front(), kKinds);
    const bool is_of_topic = stream.kind == "topic";
    const auto codec = is_of_topic ? wire::kTopicCodec : wire::kSampleCodec;
    if (!wire::is_sample_stream({wire::kFirstOther, name, std::string(codec)})) {
      config.fail(key, fmt::format("expected a name {}of A-Z a-z 0-9 . _ -",
                                   is_of_topic ? "" : "that begins with \"imu\", "));
    }
    if (is_of_topic) {
      const auto policy = config.choice(key + ".policy", kTopicPolicies.front(), kTopicPolicies);
      stream.policy = policy == "latest"   ? TopicPolicy::kLatest
                      : policy == "frames" ? TopicPolicy::kFrames
                                           : TopicPolicy::kAll;
      stream.frame_time = std::chrono::nanoseconds(std::llround(1e9 / settings.source.fps));
      config.read(key + ".rate", stream.rate, 0.0, 10'000.0);
    }
    stream.path = config.path(key + ".path", {});
    stream.devices = config.one_or_more_texts(key + ".device", {});
    stream.topic = config.text(key + ".topic", "");
    const auto require = [&config, prefix = key](const char* where, bool is_missing) {
      if (is_missing) config.fail(prefix + where, "required: where the samples come from");
    };
    if (stream.kind == "iio") {
      require(".device", stream.devices.empty());
    } else if (stream.kind == "ros2" || is_of_topic) {
      require(".topic", stream.topic.empty());
    } else if (stream.kind == "generated") {
      if (settings.source.kind != "generated" || settings.source.loop) {
        config.fail(key + ".kind", "needs source.kind = \"generated\" without source.loop");
      }
    } else {
      require(".path", stream.path.empty());
    }
    read_imu(config, key + ".calibration", name, settings.calibration);
    config.read_bytes(key + ".memory", stream.memory_bytes, 1 << 16, 1LL << 40);
    streams.push_back(std::move(stream));
  }
  if (streams.size() > kMost) config.fail("stream", fmt::format("more than {} streams", kMost));
  if (settings.calibration.size() > wire::kMaxCalibrationBytes) {
    config.fail("camera.calibration", "must be at most 16 KiB, with those of the streams");
  }
}

}  // namespace

Settings load_settings(const std::filesystem::path& file, std::span<const std::string> overrides) {
  ConfigReader config(file, overrides);
  Settings settings;
  config.read("log.level", settings.log_level, kLogLevels);
  read_robot(config, settings);
  read_source(config, settings.source);
  read_stereo(config, settings.source);
  read_publish(config, settings);
  read_images(config, settings);
  read_buffer(config, settings.buffer);
  read_plan(config, settings.jpeg.quality, settings.buffer.plan);
  read_link(config, settings.buffer.plan.live_again, settings.link);
  read_record(config, settings.record);
  read_streams(config, settings);
  settings.warnings = calibration_warnings(settings.calibration);
  config.reject_unknown();
  return settings;
}

std::string new_session_id() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::random_device random;
  // 64 bits: a clock that is wrong may show the same second at each start.
  const auto high = random(), low = random();
  return fmt::format("{:%Y%m%dT%H%M%SZ}-{:08x}{:08x}", fmt::gmtime(now), high, low);
}

}  // namespace orbbuf
