// SPDX-License-Identifier: Apache-2.0
// The topics of a TurtleBot3: `orbbuf-dds-topic-writer SECONDS READERS [depth] JPEG...`. It waits
// until each of /image_raw/compressed (25 Hz, these files in turn), /imu (20 Hz), /odom (30 Hz),
// /tf (30 Hz, by two publishers), /scan (5 Hz, best effort), with `depth`
// /depth/image_raw/compressedDepth (25 Hz, with the images' stamps) and /tf_static (twice, by two
// publishers, latched) has so many readers, then writes for so long, and stays until it is ended.
// Says `ready`, then `NAME COUNT` of each, then `done`.
#include <dds/dds.h>
#include <topics.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

dds_entity_t require(dds_entity_t entity, const char* attempt) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "%s: %s\n", attempt, dds_strretcode(-entity));
  std::exit(1);
}

struct Writer {
  const char* name;
  dds_entity_t entity;
  std::chrono::nanoseconds period;  // 0: it writes once
  Clock::time_point due{};
  int written = 0;
};

Writer make_writer(dds_entity_t participant, const dds_topic_descriptor_t& type, const char* name,
                   int per_second, bool is_reliable, const char* topic_as = nullptr) {
  const std::string topic_name = "rt/" + std::string(topic_as != nullptr ? topic_as : name);
  const dds_entity_t topic =
      require(dds_create_topic(participant, &type, topic_name.c_str(), nullptr, nullptr), name);
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, is_reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_SECS(1));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, per_second > 0 ? 100 : 1);
  if (per_second == 0) dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  const std::string hash = "typehash=RIHS01_" + std::string(64, name[0] == 's' ? '5' : '7') + ";";
  dds_qset_userdata(qos, hash.data(), hash.size());
  const dds_entity_t writer = require(dds_create_writer(participant, topic, qos, nullptr), name);
  dds_delete_qos(qos);
  return {name, writer, std::chrono::nanoseconds(per_second > 0 ? 1'000'000'000 / per_second : 0)};
}

int readers_of(const Writer& writer) {
  dds_publication_matched_status_t matched{};
  dds_get_publication_matched_status(writer.entity, &matched);
  return static_cast<int>(matched.current_count);
}

/// Messages with values of their own, and of the lengths that a TurtleBot3's have.
class Messages {
 public:
  explicit Messages(std::vector<std::vector<std::uint8_t>> images) : images_(std::move(images)) {}

  void write(const Writer& writer) {
    if (writer.name == std::string("camera")) return write_image(writer.entity);
    if (writer.name == std::string("depth")) return write_depth(writer.entity);
    if (writer.name == std::string("imu")) return write_imu(writer.entity);
    if (writer.name == std::string("odom")) return write_odom(writer.entity);
    if (writer.name == std::string("scan")) return write_scan(writer.entity);
    write_tf(writer.entity);
  }

 private:
  double any() { return values_(random_); }
  static std_msgs_msg_dds__Header_ header_of(std::string& frame) {
    const dds_time_t now = dds_time();
    return {{static_cast<std::int32_t>(now / DDS_NSECS_IN_SEC),
             static_cast<std::uint32_t>(now % DDS_NSECS_IN_SEC)},
            frame.data()};
  }
  static void send(dds_entity_t writer, const void* message) {
    require(dds_write(writer, message), "write");
  }

  void write_image(dds_entity_t writer) {
    sensor_msgs_msg_dds__CompressedImage_ image{};
    image.header = header_of(base_);
    image_stamp_ = image.header.stamp;
    std::string format = "jpeg";
    image.format = format.data();
    auto& data = images_[next_image_++ % images_.size()];
    const auto size = static_cast<std::uint32_t>(data.size());
    image.data = {size, size, data.data(), false};
    send(writer, &image);
  }

  void write_depth(dds_entity_t writer) {
    sensor_msgs_msg_dds__CompressedImage_ image{};
    image.header = {image_stamp_, base_.data()};
    std::string format = "16UC1; compressedDepth png";
    image.format = format.data();
    std::array<std::uint64_t, 2'500> data{};
    for (auto& each : data) each = random_();
    image.data = {sizeof data, sizeof data, reinterpret_cast<std::uint8_t*>(data.data()), false};
    send(writer, &image);
  }

  void write_imu(dds_entity_t writer) {
    sensor_msgs_msg_dds__Imu_ imu{};
    imu.header = header_of(base_);
    imu.angular_velocity = {any(), any(), any()};
    imu.linear_acceleration = {any(), any(), any()};
    send(writer, &imu);
  }

  void write_odom(dds_entity_t writer) {
    nav_msgs_msg_dds__Odometry_ odom{};
    odom.header = header_of(odom_);
    odom.child_frame_id = base_.data();
    odom.pose.pose.position = {any(), any(), any()};
    for (double& each : odom.pose.covariance) each = any();
    odom.twist.twist.linear.x = any();
    send(writer, &odom);
  }

  void write_scan(dds_entity_t writer) {
    sensor_msgs_msg_dds__LaserScan_ scan{};
    scan.header = header_of(base_);
    std::array<float, 360> ranges{};
    for (float& each : ranges) each = static_cast<float>(any());
    scan.ranges = {ranges.size(), ranges.size(), ranges.data(), false};
    scan.intensities = scan.ranges;
    send(writer, &scan);
  }

  void write_tf(dds_entity_t writer) {
    std::array<geometry_msgs_msg_dds__TransformStamped_, 2> transforms{};
    for (auto& each : transforms) {
      each.header = header_of(odom_);
      each.child_frame_id = base_.data();
      each.transform.translation = {any(), any(), any()};
    }
    tf2_msgs_msg_dds__TFMessage_ message{};
    const auto count = static_cast<std::uint32_t>(1 + random_() % transforms.size());
    message.transforms = {count, count, transforms.data(), false};
    send(writer, &message);
  }

  std::vector<std::vector<std::uint8_t>> images_;
  std::size_t next_image_ = 0;
  builtin_interfaces_msg_dds__Time_ image_stamp_{};
  std::mt19937_64 random_{1};
  std::uniform_real_distribution<double> values_{-1, 1};
  std::string odom_ = "odom";
  std::string base_ = "base_footprint";
};

std::vector<std::uint8_t> read_file(const char* path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const dds_entity_t participant =
      require(dds_create_participant(DDS_DOMAIN_DEFAULT, nullptr, nullptr), "join");
  const auto& tf = tf2_msgs_msg_dds__TFMessage__desc;
  std::vector<Writer> writers = {
      make_writer(participant, tf, "tf_static", 0, true),
      make_writer(participant, tf, "tf_static", 0, true),
      make_writer(participant, sensor_msgs_msg_dds__Imu__desc, "imu", 20, true),
      make_writer(participant, nav_msgs_msg_dds__Odometry__desc, "odom", 30, true),
      make_writer(participant, tf, "tf", 30, true),
      make_writer(participant, tf, "tf", 30, true),
      make_writer(participant, sensor_msgs_msg_dds__LaserScan__desc, "scan", 5, false),
      make_writer(participant, sensor_msgs_msg_dds__CompressedImage__desc, "camera", 25, true,
                  "image_raw/compressed")};
  const bool has_depth = std::string(argv[3]) == "depth";
  if (has_depth) {
    writers.push_back(make_writer(participant, sensor_msgs_msg_dds__CompressedImage__desc, "depth",
                                  25, true, "depth/image_raw/compressedDepth"));
  }
  for (const Writer& writer : writers) {
    while (readers_of(writer) < std::atoi(argv[2])) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  std::puts("ready");
  std::fflush(stdout);
  std::vector<std::vector<std::uint8_t>> images;
  for (int i = has_depth ? 4 : 3; i < argc; ++i) images.push_back(read_file(argv[i]));
  Messages messages(std::move(images));
  const Clock::time_point end = Clock::now() + std::chrono::seconds(std::atoi(argv[1]));
  for (Writer& writer : writers) writer.due = Clock::now();
  for (;;) {
    Writer* next = nullptr;
    for (Writer& writer : writers) {
      if (next == nullptr || writer.due < next->due) next = &writer;
    }
    if (next->due > end) break;
    std::this_thread::sleep_until(next->due);
    messages.write(*next);
    ++next->written;
    next->due = next->period.count() > 0 ? next->due + next->period : Clock::time_point::max();
  }
  for (const Writer& writer : writers) std::printf("%s %d\n", writer.name, writer.written);
  std::puts("done");
  std::fflush(stdout);
  for (;;) ::pause();
}
