// SPDX-License-Identifier: Apache-2.0
// What comes by a TurtleBot3's topics behind a prefix:
// `orbbuf-dds-topic-tap PREFIX|'' volatile|latched [DEPTH MS]`. A line `NAME SOURCE_TIME BYTES
// CRC_32 MS` for each message, as it was on DDS and with its age, and `publisher NAME TYPE
// reliable|best-effort latched|volatile USER_DATA` for each publisher. Of /image_raw/compressed:
// `camera STAMP JPEG_BYTES CRC_32 MS`, of /depth/image_raw/compressedDepth `depth` and the same;
// what is said behind an image came behind it. volatile: /tf_static only as it comes; latched: only
// what its publishers have kept. DEPTH, MS: as a ROS 2 node of one thread, with queues of that
// depth (of /tf ten times it, as tf2 has), that works so long at each image.
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <topics.h>
#include <zlib.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

dds_entity_t require(dds_entity_t entity, const char* attempt) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "%s: %s\n", attempt, dds_strretcode(-entity));
  std::exit(1);
}

struct Topic {
  std::string name;
  dds_entity_t reader;
};

Topic make_reader(dds_entity_t participant, const dds_topic_descriptor_t& type,
                  const std::string& topic_name, const std::string& name, int depth,
                  bool is_reliable, bool is_latched) {
  const dds_entity_t topic = require(
      dds_create_topic(participant, &type, topic_name.c_str(), nullptr, nullptr), name.c_str());
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, is_reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_SECS(1));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, depth);
  if (is_latched) dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  const dds_entity_t reader =
      require(dds_create_reader(participant, topic, qos, nullptr), name.c_str());
  dds_delete_qos(qos);
  return {name, reader};
}

std::string line_of(const std::string& name, std::int64_t time_ns, const void* data,
                    std::size_t size) {
  char text[128];
  std::snprintf(text, sizeof text, " %lld %zu %08lx %.2f\n", static_cast<long long>(time_ns), size,
                crc32(0, static_cast<const Bytef*>(data), static_cast<uInt>(size)),
                static_cast<double>(dds_time() - time_ns) / DDS_NSECS_IN_MSEC);
  return name + text;
}

/// So many of those that wait.
std::string take_messages(const Topic& topic, int most) {
  std::string lines;
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info{};
  while (most-- > 0 && dds_takecdr(topic.reader, &data, 1, &info, DDS_ANY_STATE) > 0) {
    if (info.valid_data) {
      std::vector<unsigned char> bytes(ddsi_serdata_size(data));
      ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
      lines += line_of(topic.name, info.source_timestamp, bytes.data(), bytes.size());
    }
    ddsi_serdata_unref(data);
  }
  return lines;
}

std::string take_images(const Topic& topic, int most) {
  std::string lines;
  void* message = nullptr;
  dds_sample_info_t info{};
  while (most-- > 0 && dds_take(topic.reader, &message, &info, 1, 1) > 0) {
    if (info.valid_data) {
      const auto& image = *static_cast<const sensor_msgs_msg_dds__CompressedImage_*>(message);
      const auto& [sec, nanosec] = image.header.stamp;
      lines += line_of(topic.name, sec * DDS_NSECS_IN_SEC + nanosec, image.data._buffer,
                       image.data._length);
    }
    dds_return_loan(topic.reader, &message, 1);
    message = nullptr;
  }
  return lines;
}

void say_publishers(dds_entity_t publications, const std::string& prefix) {
  void* sample = nullptr;
  dds_sample_info_t info{};
  while (dds_take(publications, &sample, &info, 1, 1) > 0) {
    const auto& found = *static_cast<const dds_builtintopic_endpoint_t*>(sample);
    if (info.valid_data && info.instance_state == DDS_IST_ALIVE) {
      dds_reliability_kind_t reliability = DDS_RELIABILITY_BEST_EFFORT;
      dds_durability_kind_t durability = DDS_DURABILITY_VOLATILE;
      void* data = nullptr;
      std::size_t size = 0;
      dds_qget_reliability(found.qos, &reliability, nullptr);
      dds_qget_durability(found.qos, &durability);
      dds_qget_userdata(found.qos, &data, &size);
      const std::string start = "rt" + prefix + "/";
      std::string name = found.topic_name;
      if (name.starts_with(start)) name.erase(0, start.size());
      std::printf("publisher %s %s %s %s %.*s\n", name.c_str(), found.type_name,
                  reliability == DDS_RELIABILITY_RELIABLE ? "reliable" : "best-effort",
                  durability == DDS_DURABILITY_VOLATILE ? "volatile" : "latched",
                  static_cast<int>(size), size > 0 ? static_cast<const char*>(data) : "");
      dds_free(data);
    }
    dds_return_loan(publications, &sample, 1);
    sample = nullptr;
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const std::string prefix = argv[1];
  const dds_entity_t participant =
      require(dds_create_participant(DDS_DOMAIN_DEFAULT, nullptr, nullptr), "join");
  const dds_entity_t publications = require(
      dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, nullptr, nullptr), "look");
  const auto& tf = tf2_msgs_msg_dds__TFMessage__desc;
  const bool is_latched = std::string(argv[2]) == "latched";
  const int depth = argc > 3 ? std::atoi(argv[3]) : 10'000;
  const std::chrono::milliseconds work(argc > 4 ? std::atoi(argv[4]) : 0);
  const int most = work.count() > 0 ? 1 : depth;
  std::vector<Topic> topics;
  const auto read = [&](const dds_topic_descriptor_t& type, const std::string& name,
                        bool is_reliable) {
    topics.push_back(make_reader(participant, type, "rt" + prefix + "/" + name, name,
                                 name == "tf" ? 10 * depth : depth, is_reliable, is_latched));
  };
  read(tf, "tf_static", true);
  std::vector<Topic> cameras;
  if (!is_latched) {
    read(tf, "tf", true);
    read(nav_msgs_msg_dds__Odometry__desc, "odom", true);
    read(sensor_msgs_msg_dds__Imu__desc, "imu", true);
    read(sensor_msgs_msg_dds__LaserScan__desc, "scan", false);
    for (const auto& [name, topic] : {std::pair("depth", "/depth/image_raw/compressedDepth"),
                                      std::pair("camera", "/image_raw/compressed")}) {
      cameras.push_back(make_reader(participant, sensor_msgs_msg_dds__CompressedImage__desc,
                                    "rt" + prefix + topic, name, depth, true, false));
    }
  }
  const dds_entity_t waitset = require(dds_create_waitset(participant), "wait");
  const auto attach = [waitset](dds_entity_t reader) {
    require(dds_waitset_attach(
                waitset, require(dds_create_readcondition(reader, DDS_ANY_STATE), "condition"), 0),
            "attach");
  };
  attach(publications);
  for (const Topic& topic : topics) attach(topic.reader);
  for (const Topic& camera : cameras) attach(camera.reader);
  std::puts("ready");
  for (;;) {
    say_publishers(publications, prefix);
    std::string images;
    for (const Topic& camera : cameras) images += take_images(camera, most);
    for (const Topic& topic : topics) std::fputs(take_messages(topic, most).c_str(), stdout);
    std::fputs(images.c_str(), stdout);
    std::fflush(stdout);
    if (!images.empty()) std::this_thread::sleep_for(work);
    dds_waitset_wait(waitset, nullptr, 0, DDS_INFINITY);
  }
}
