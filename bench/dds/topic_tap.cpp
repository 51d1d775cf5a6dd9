// SPDX-License-Identifier: Apache-2.0
// What comes by /odom, /tf, /scan and /tf_static behind a prefix:
// `orbbuf-dds-topic-tap PREFIX|'' volatile|latched`. A line `NAME SOURCE_TIME BYTES CRC_32` for
// each message, as it was on DDS, and `publisher NAME TYPE reliable|best-effort latched|volatile
// USER_DATA` for each publisher. volatile: /tf_static only as it comes; latched: only what its
// publishers have kept.
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <topics.h>
#include <zlib.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
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
                  const std::string& prefix, const std::string& name, bool is_reliable,
                  bool is_latched) {
  const std::string topic_name = "rt" + prefix + "/" + name;
  const dds_entity_t topic = require(
      dds_create_topic(participant, &type, topic_name.c_str(), nullptr, nullptr), name.c_str());
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, is_reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_SECS(1));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10'000);
  if (is_latched) dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  const dds_entity_t reader =
      require(dds_create_reader(participant, topic, qos, nullptr), name.c_str());
  dds_delete_qos(qos);
  return {name, reader};
}

void say_messages(const Topic& topic) {
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info{};
  while (dds_takecdr(topic.reader, &data, 1, &info, DDS_ANY_STATE) > 0) {
    if (info.valid_data) {
      std::vector<unsigned char> bytes(ddsi_serdata_size(data));
      ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
      const auto crc = crc32(0, bytes.data(), static_cast<uInt>(bytes.size()));
      std::printf("%s %lld %zu %08lx\n", topic.name.c_str(),
                  static_cast<long long>(info.source_timestamp), bytes.size(), crc);
    }
    ddsi_serdata_unref(data);
  }
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
  std::vector<Topic> topics = {make_reader(participant, tf, prefix, "tf_static", true, is_latched)};
  if (!is_latched) {
    topics.push_back(make_reader(participant, tf, prefix, "tf", true, false));
    topics.push_back(
        make_reader(participant, nav_msgs_msg_dds__Odometry__desc, prefix, "odom", true, false));
    topics.push_back(make_reader(participant, sensor_msgs_msg_dds__LaserScan__desc, prefix, "scan",
                                 false, false));
  }
  const dds_entity_t waitset = require(dds_create_waitset(participant), "wait");
  const auto attach = [waitset](dds_entity_t reader) {
    require(dds_waitset_attach(
                waitset, require(dds_create_readcondition(reader, DDS_ANY_STATE), "condition"), 0),
            "attach");
  };
  attach(publications);
  for (const Topic& topic : topics) attach(topic.reader);
  std::puts("ready");
  for (;;) {
    say_publishers(publications, prefix);
    for (const Topic& topic : topics) say_messages(topic);
    std::fflush(stdout);
    dds_waitset_wait(waitset, nullptr, 0, DDS_INFINITY);
  }
}
