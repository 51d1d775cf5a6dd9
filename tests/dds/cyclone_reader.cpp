// SPDX-License-Identifier: Apache-2.0
// A ROS 2 reader of Cyclone DDS's: `orbbuf-dds-reader FOLDER reliable|best-effort|latched BASE...`.
// latched: only camera_info, with durability `transient local`.
#include <dds/dds.h>
#include <ros_messages.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "tests/dds/received.hpp"

namespace {

/// One topic of a camera.
struct Topic {
  std::string base;
  dds_entity_t reader = 0;
  void (*keep)(Received&, const std::string& base, const void* message) = nullptr;
};

dds_entity_t require(dds_entity_t entity, const char* attempt) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "%s: %s\n", attempt, dds_strretcode(-entity));
  std::exit(1);
}

void keep_image(Received& received, const std::string& base, const void* message) {
  const auto& image = *static_cast<const sensor_msgs_msg_dds__CompressedImage_*>(message);
  const bool is_jpeg = std::string(image.format) == "jpeg";
  received.keep(base, image.header.stamp.sec, image.header.stamp.nanosec,
                is_jpeg ? ".jpg" : ".unknown", image.data._buffer, image.data._length);
}

void keep_raw(Received& received, const std::string& base, const void* message) {
  const auto& image = *static_cast<const sensor_msgs_msg_dds__Image_*>(message);
  const bool is_gray = std::string(image.encoding) == "mono8" && image.step == image.width;
  received.keep(base, image.header.stamp.sec, image.header.stamp.nanosec,
                is_gray ? ".raw" : ".unknown", image.data._buffer, image.data._length);
}

void keep_info(Received& received, const std::string& base, const void* message) {
  const auto& info = *static_cast<const sensor_msgs_msg_dds__CameraInfo_*>(message);
  std::string text = std::string(info.header.frame_id) + " " + std::to_string(info.width) + "x" +
                     std::to_string(info.height) + " " + info.distortion_model;
  for (const double value : {info.k[0], info.k[4], info.k[2], info.k[5], info.p[3]}) {
    text += " " + std::to_string(value);
  }
  text += "\n";
  received.keep(base, info.header.stamp.sec, info.header.stamp.nanosec, ".info", text.data(),
                text.size());
}

void keep_imu(Received& received, const std::string& base, const void* message) {
  const auto& imu = *static_cast<const sensor_msgs_msg_dds__Imu_*>(message);
  const auto& [wx, wy, wz] = imu.angular_velocity;
  const auto& [ax, ay, az] = imu.linear_acceleration;
  std::string text = imu.header.frame_id;
  for (const double value : {wx, wy, wz, ax, ay, az, imu.orientation_covariance[0]}) {
    text += " " + std::to_string(value);
  }
  text += "\n";
  received.keep(base, imu.header.stamp.sec, imu.header.stamp.nanosec, ".imu", text.data(),
                text.size());
}

class Reader {
 public:
  Reader(const char* folder, std::string mode)
      : received_(folder),
        mode_(std::move(mode)),
        participant_(require(dds_create_participant(DDS_DOMAIN_DEFAULT, nullptr, nullptr), "join")),
        waitset_(require(dds_create_waitset(participant_), "wait")) {}

  void add(const std::string& base) {
    received_.expect(base);
    add_topic(base, "camera_info", sensor_msgs_msg_dds__CameraInfo__desc, keep_info);
    if (mode_ == "latched") return;
    add_topic(base, "image_raw/compressed", sensor_msgs_msg_dds__CompressedImage__desc, keep_image);
    if (mode_ != "reliable") return;
    add_topic(base, "image_raw", sensor_msgs_msg_dds__Image__desc, keep_raw);
    add_topic(base, "imu0", sensor_msgs_msg_dds__Imu__desc, keep_imu);
  }

  [[noreturn]] void run() {
    std::puts("ready");
    std::fflush(stdout);
    for (;;) {
      dds_waitset_wait(waitset_, nullptr, 0, DDS_INFINITY);
      for (const Topic& topic : topics_) take(topic);
    }
  }

 private:
  void add_topic(const std::string& base, const std::string& name,
                 const dds_topic_descriptor_t& type, decltype(Topic::keep) keep) {
    const dds_entity_t topic =
        require(dds_create_topic(participant_, &type, ("rt/" + base + "/" + name).c_str(), nullptr,
                                 nullptr),
                "topic");
    dds_qos_t* qos = dds_create_qos();
    dds_qset_reliability(
        qos, mode_ == "best-effort" ? DDS_RELIABILITY_BEST_EFFORT : DDS_RELIABILITY_RELIABLE,
        DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 2000);
    if (mode_ == "latched") {
      dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    }
    const dds_entity_t reader =
        require(dds_create_reader(participant_, topic, qos, nullptr), "read");
    dds_delete_qos(qos);
    require(dds_waitset_attach(
                waitset_, require(dds_create_readcondition(reader, DDS_ANY_STATE), "condition"), 0),
            "attach");
    topics_.push_back({base, reader, keep});
  }

  void take(const Topic& topic) {
    void* message[1] = {nullptr};
    dds_sample_info_t info[1];
    while (dds_take(topic.reader, message, info, 1, 1) > 0) {
      if (info[0].valid_data) topic.keep(received_, topic.base, message[0]);
      dds_return_loan(topic.reader, message, 1);
      message[0] = nullptr;
    }
  }

  Received received_;
  const std::string mode_;
  const dds_entity_t participant_;
  const dds_entity_t waitset_;
  std::vector<Topic> topics_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  Reader reader(argv[1], argv[2]);
  for (int i = 3; i < argc; ++i) reader.add(argv[i]);
  reader.run();
}
