// SPDX-License-Identifier: Apache-2.0
// Frames over Cyclone DDS: send|receive best-effort|DEPTH|all. DEPTH and all are reliable, with
// KEEP_LAST and KEEP_ALL.
#include <dds/dds.h>
#include <frame.h>

#include <string>

#include "bench/rivals/peers/messages.hpp"

namespace {

dds_entity_t require(dds_entity_t entity, const char* attempt) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "%s: %s\n", attempt, dds_strretcode(-entity));
  std::exit(EXIT_FAILURE);
}

dds_qos_t* quality(const std::string& history, bool is_patient) {
  dds_qos_t* qos = dds_create_qos();
  if (history == "best-effort") {
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    return qos;
  }
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, is_patient ? DDS_INFINITY : DDS_MSECS(100));
  if (history == "all") {
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
  } else {
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, std::stoi(history));
  }
  return qos;
}

[[noreturn]] void send(dds_entity_t writer) {
  for (;;) {
    orbbuf::bench::Message message = orbbuf::bench::next_message();
    rivals_Frame frame{};
    frame.data._buffer = message.data();
    frame.data._length = frame.data._maximum = static_cast<std::uint32_t>(message.size());
    const dds_return_t written = dds_write(writer, &frame);
    if (written != DDS_RETCODE_TIMEOUT) require(written, "write");
  }
}

[[noreturn]] void receive(dds_entity_t participant, dds_entity_t reader) {
  const dds_entity_t waitset = require(dds_create_waitset(participant), "waitset");
  require(dds_waitset_attach(
              waitset, require(dds_create_readcondition(reader, DDS_ANY_STATE), "condition"), 0),
          "attach");
  for (;;) {
    dds_waitset_wait(waitset, nullptr, 0, DDS_INFINITY);
    void* frames[1] = {nullptr};
    dds_sample_info_t info[1];
    while (dds_take(reader, frames, info, 1, 1) > 0) {
      const auto& data = static_cast<const rivals_Frame*>(frames[0])->data;
      if (info[0].valid_data) orbbuf::bench::print_arrival(data._buffer, data._length);
      dds_return_loan(reader, frames, 1);
      frames[0] = nullptr;
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const dds_entity_t participant =
      require(dds_create_participant(DDS_DOMAIN_DEFAULT, nullptr, nullptr), "join");
  const dds_entity_t topic = require(
      dds_create_topic(participant, &rivals_Frame_desc, "camera", nullptr, nullptr), "topic");
  dds_qos_t* qos = quality(argv[2], argc > 3);
  if (std::string(argv[1]) == "send")
    send(require(dds_create_writer(participant, topic, qos, nullptr), "writer"));
  receive(participant, require(dds_create_reader(participant, topic, qos, nullptr), "reader"));
}
