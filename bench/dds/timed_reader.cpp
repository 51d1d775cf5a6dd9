// SPDX-License-Identifier: Apache-2.0
// A reliable ROS 2 reader that says when each message came: `orbbuf-dds-timed-reader TOPIC
// raw|compressed|imu [MS]`, TOPIC as ROS 2 writes it, without a first slash. A line for each: its
// stamp, and seconds from there and from the server's write to its arrival. With MS it takes one
// message in that time and has no room for more than 4, so that the writer has to keep them.
#include <dds/dds.h>
#include <ros_messages.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>
#include <thread>

namespace {

using std::chrono::milliseconds;
using std::chrono::system_clock;

dds_entity_t require(dds_entity_t entity, const char* attempt) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "%s: %s\n", attempt, dds_strretcode(-entity));
  std::exit(1);
}

const dds_topic_descriptor_t& type_of(std::string_view kind) {
  if (kind == "raw") return sensor_msgs_msg_dds__Image__desc;
  if (kind == "imu") return sensor_msgs_msg_dds__Imu__desc;
  return sensor_msgs_msg_dds__CompressedImage__desc;
}

dds_entity_t make_reader(dds_entity_t participant, const char* topic_name,
                         const dds_topic_descriptor_t& type, bool is_slow) {
  const std::string name = "rt/" + std::string(topic_name);
  const dds_entity_t topic =
      require(dds_create_topic(participant, &type, name.c_str(), nullptr, nullptr), "topic");
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_history(qos, is_slow ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST, 2000);
  if (is_slow) dds_qset_resource_limits(qos, 4, 1, 4);
  const dds_entity_t reader = require(dds_create_reader(participant, topic, qos, nullptr), "read");
  dds_delete_qos(qos);
  return reader;
}

/// All types begin with it.
void say(const std_msgs_msg_dds__Header_& header, dds_time_t written_ns) {
  const std::chrono::duration<double> now = system_clock::now().time_since_epoch();
  const double stamp = header.stamp.sec + header.stamp.nanosec * 1e-9;
  const double written = static_cast<double>(written_ns) / DDS_NSECS_IN_SEC;
  std::printf("%d.%09u %.6f %.6f\n", header.stamp.sec, header.stamp.nanosec, now.count() - stamp,
              now.count() - written);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const milliseconds pause(argc > 3 ? std::atoi(argv[3]) : 0);
  const dds_entity_t participant =
      require(dds_create_participant(DDS_DOMAIN_DEFAULT, nullptr, nullptr), "join");
  const dds_entity_t reader =
      make_reader(participant, argv[1], type_of(argv[2]), pause.count() > 0);
  const dds_entity_t waitset = require(dds_create_waitset(participant), "wait");
  require(dds_waitset_attach(
              waitset, require(dds_create_readcondition(reader, DDS_ANY_STATE), "condition"), 0),
          "attach");
  std::puts("ready");
  std::fflush(stdout);
  for (;;) {
    dds_waitset_wait(waitset, nullptr, 0, DDS_INFINITY);
    void* message = nullptr;
    dds_sample_info_t info;
    if (dds_take(reader, &message, &info, 1, 1) <= 0) continue;
    if (info.valid_data) {
      say(*static_cast<const std_msgs_msg_dds__Header_*>(message), info.source_timestamp);
    }
    dds_return_loan(reader, &message, 1);
    std::this_thread::sleep_for(pause);
  }
}
