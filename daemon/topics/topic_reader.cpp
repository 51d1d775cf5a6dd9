// SPDX-License-Identifier: Apache-2.0
#include "daemon/topics/topic_reader.hpp"

#include <dds/dds.h>
#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "common/event_fd.hpp"
#include "common/log.hpp"
#include "common/seconds.hpp"

namespace orbbuf {
namespace {

std::shared_ptr<const DdsParticipant> the_participant() {
  static std::weak_ptr<const DdsParticipant> shared;
  auto participant = shared.lock();
  if (!participant) shared = participant = std::make_shared<const DdsParticipant>();
  return participant;
}

void wake(dds_entity_t /*reader*/, void* event) {
  ::eventfd_write(static_cast<const UniqueFd*>(event)->get(), 1);
}

std::unique_ptr<dds_listener, void (*)(dds_listener*)> make_listener(const UniqueFd& event) {
  std::unique_ptr<dds_listener, void (*)(dds_listener*)> listener(
      dds_create_listener(const_cast<UniqueFd*>(&event)), &dds_delete_listener);
  dds_lset_data_available(listener.get(), &wake);
  return listener;
}

/// `sensor_msgs::msg::dds_::Imu_` as ROS 2 has it: `sensor_msgs/msg/Imu`.
std::string ros_type(std::string_view dds_type) {
  constexpr std::string_view kModule = "::dds_::";
  std::string type(dds_type);
  if (const auto at = type.find(kModule); at != std::string::npos && type.ends_with('_')) {
    type.replace(at, kModule.size(), "/");
    type.pop_back();
  }
  if (const auto at = type.find("::"); at != std::string::npos) type.replace(at, 2, "/");
  return type;
}

std::string with_slash(std::string topic) { return topic.starts_with('/') ? topic : "/" + topic; }

}  // namespace

TopicReader::TopicReader(const std::string& topic, std::vector<const dds_topic_descriptor*> types,
                         int depth, std::chrono::nanoseconds patience)
    : topic_(with_slash(topic)),
      types_(std::move(types)),
      depth_(depth),
      patience_(patience),
      participant_(the_participant()),
      event_(make_event_fd()),
      listener_(make_listener(event_)),
      publications_(
          require_dds(dds_create_reader(participant_->entity(), DDS_BUILTIN_TOPIC_DCPSPUBLICATION,
                                        nullptr, listener_.get()),
                      "look for publishers")) {}

TopicReader::~TopicReader() {
  dds_delete(publications_);
  if (reader_ > 0) dds_delete(reader_);
}

std::optional<TopicReader::Message> TopicReader::take() {
  eventfd_t ignored = 0;
  ::eventfd_read(event_.get(), &ignored);
  look_for_publishers();
  auto message = take_next();
  if (message) {
    note_message();
  } else {
    note_silence();
  }
  return message;
}

void TopicReader::look_for_publishers() {
  const std::string name = fmt::format("rt{}", topic_);
  void* samples[1] = {nullptr};
  dds_sample_info_t info;
  while (dds_take(publications_, samples, &info, 1, 1) > 0) {
    const auto& found = *static_cast<const dds_builtintopic_endpoint_t*>(samples[0]);
    if (info.instance_state != DDS_IST_ALIVE) {
      publishers_.erase(info.instance_handle);
    } else if (info.valid_data && found.topic_name == name) {
      dds_reliability_kind_t kind = DDS_RELIABILITY_BEST_EFFORT;
      dds_qget_reliability(found.qos, &kind, nullptr);
      publishers_[info.instance_handle] = {ros_type(found.type_name),
                                           kind == DDS_RELIABILITY_RELIABLE};
    }
    dds_return_loan(publications_, samples, 1);
    samples[0] = nullptr;
  }
  // Of a publisher that has left, messages may still wait in the reader.
  if (const auto wanted = wanted_kind(); wanted && wanted != kind_) open(*wanted);
}

std::optional<TopicReader::Kind> TopicReader::wanted_kind() const {
  for (std::size_t type = 0; type < types_.size(); ++type) {
    std::optional<Kind> kind;
    for (const auto& [handle, publisher] : publishers_) {
      if (publisher.type != ros_type(types_[type]->m_typename)) continue;
      kind = Kind{type, publisher.is_reliable && (!kind || kind->is_reliable)};
    }
    if (kind) return kind;
  }
  return std::nullopt;
}

void TopicReader::open(const Kind& kind) {
  if (reader_ > 0) dds_delete(reader_);
  kind_ = kind;
  const std::string name = fmt::format("rt{}", topic_);
  const dds_entity_t topic =
      dds_create_topic(participant_->entity(), types_[kind.type], name.c_str(), nullptr, nullptr);
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(
      qos, kind.is_reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, depth_);
  reader_ = dds_create_reader(participant_->entity(), topic, qos, listener_.get());
  dds_delete_qos(qos);
  dds_delete(topic);  // the reader keeps it
  if (reader_ < 0) {
    log_error("topic {}: cannot read it: {}", topic_, dds_strretcode(-reader_));
    return;
  }
  log_info("topic {}: {}, {}", topic_, ros_type(types_[kind.type]->m_typename),
           kind.is_reliable ? "reliable" : "best effort");
}

std::optional<TopicReader::Message> TopicReader::take_next() {
  while (reader_ > 0) {
    const dds_topic_descriptor* const type = types_[kind_->type];
    std::shared_ptr<void> data(dds_alloc(type->m_size), [type](void* message) {
      dds_sample_free(message, type, DDS_FREE_ALL);
    });
    void* samples[1] = {data.get()};
    dds_sample_info_t info;
    if (dds_take(reader_, samples, &info, 1, 1) <= 0) break;
    if (info.valid_data) return Message{kind_->type, std::move(data)};
  }
  return std::nullopt;
}

void TopicReader::note_message() {
  const auto now = Clock::now();
  if (!std::exchange(silence_, {}).empty()) {
    log_info("topic {}: messages again after {:.1f} s", topic_, to_seconds(now - last_message_));
  }
  last_message_ = now;
}

void TopicReader::note_silence() {
  if (Clock::now() - last_message_ < patience_) return;
  std::string why = why_silent();
  if (why == silence_) return;
  log_warn("topic {}: no message for {} s: {}; waiting", topic_, to_seconds(patience_), why);
  silence_ = std::move(why);
}

std::string TopicReader::why_silent() const {
  std::vector<std::string> types;
  types.reserve(types_.size());
  for (const auto* type : types_) types.push_back(ros_type(type->m_typename));
  if (publishers_.empty()) {
    return fmt::format("no program publishes it in ROS_DOMAIN_ID {} as {}",
                       participant_->domain_id(), fmt::join(types, " or "));
  }
  if (!wanted_kind()) {
    return fmt::format("it is published as {}, not as {}", publishers_.begin()->second.type,
                       fmt::join(types, " or "));
  }
  return "its publisher sends nothing";
}

}  // namespace orbbuf
