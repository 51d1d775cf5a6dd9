// SPDX-License-Identifier: Apache-2.0
#include "daemon/topics/topic_reader.hpp"

#include <dds/dds.h>
#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "common/dds/type_hash.hpp"
#include "common/event_fd.hpp"
#include "common/log.hpp"
#include "common/ros_name.hpp"
#include "common/seconds.hpp"
#include "common/system_clock.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kMostKinds = 64;

void wake(dds_entity_t /*reader*/, void* event) {
  ::eventfd_write(static_cast<const UniqueFd*>(event)->get(), 1);
}

std::unique_ptr<dds_listener, void (*)(dds_listener*)> make_listener(const UniqueFd& event) {
  std::unique_ptr<dds_listener, void (*)(dds_listener*)> listener(
      dds_create_listener(const_cast<UniqueFd*>(&event)), &dds_delete_listener);
  dds_lset_data_available(listener.get(), &wake);
  return listener;
}

using Qos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

/// Remote programs say how many messages they keep in one of two ways, or not at all.
std::uint32_t depth_of(const dds_qos_t* qos) {
  std::int32_t most = 1;
  dds_history_kind_t kind = DDS_HISTORY_KEEP_ALL;
  std::int32_t depth = 0;
  if (dds_qget_history(qos, &kind, &depth) && kind == DDS_HISTORY_KEEP_LAST) {
    most = std::max(most, depth);
  }
  if (dds_qget_durability_service(qos, nullptr, &kind, &depth, nullptr, nullptr, nullptr) &&
      kind == DDS_HISTORY_KEEP_LAST) {
    most = std::max(most, depth);
  }
  return static_cast<std::uint32_t>(most);
}

TopicPublisher writer_of(const dds_builtintopic_endpoint_t& found, std::uint64_t key) {
  TopicPublisher writer;
  writer.key = key;
  writer.topic = found.topic_name + 2;  // is_of()
  writer.type = found.type_name;
  void* data = nullptr;
  std::size_t size = 0;
  if (dds_qget_userdata(found.qos, &data, &size) && data != nullptr) {
    if (size <= wire::kMaxTopicTextBytes) writer.user_data.assign(static_cast<char*>(data), size);
    dds_free(data);
  }
  dds_reliability_kind_t reliability = DDS_RELIABILITY_BEST_EFFORT;
  dds_qget_reliability(found.qos, &reliability, nullptr);
  writer.is_reliable = reliability == DDS_RELIABILITY_RELIABLE;
  dds_durability_kind_t durability = DDS_DURABILITY_VOLATILE;
  dds_qget_durability(found.qos, &durability);
  writer.is_latched = durability != DDS_DURABILITY_VOLATILE;
  writer.depth = depth_of(found.qos);
  std::uint32_t count = 0;
  dds_data_representation_id_t* representations = nullptr;
  if (dds_qget_data_representation(found.qos, &count, &representations)) {
    writer.is_xcdr2 = count > 0 && representations[0] == DDS_DATA_REPRESENTATION_XCDR2;
    dds_free(representations);
  }
  return writer;
}

/// Writers of a kind have a reader in common.
std::string raw_kind(const TopicPublisher& writer) {
  return fmt::format("{}: {} as {}{}", writer.topic, ros_type(writer.type),
                     writer.is_reliable ? "reliable" : "best effort",
                     writer.is_latched ? ", transient local" : "");
}

std::string with_slash(std::string topic) { return topic.starts_with('/') ? topic : "/" + topic; }

/// Those of ROS 2 have the prefix `rt`.
bool is_of(std::string_view dds_topic, std::string_view topic) {
  if (!dds_topic.starts_with("rt")) return false;
  dds_topic.remove_prefix(2);
  return topic.ends_with('*') ? dds_topic.starts_with(topic.substr(0, topic.size() - 1))
                              : dds_topic == topic;
}

}  // namespace

TopicReader::TopicReader(const std::string& topic, Types types, int depth,
                         std::chrono::nanoseconds patience)
    : topic_(with_slash(topic)),
      types_(std::move(types)),
      depth_(depth),
      patience_(patience),
      participant_(DdsParticipant::shared()),
      event_(make_event_fd()),
      listener_(make_listener(event_)),
      publications_(
          require_dds(dds_create_reader(participant_->entity(), DDS_BUILTIN_TOPIC_DCPSPUBLICATION,
                                        nullptr, listener_.get()),
                      "look for publishers")) {}

TopicReader::~TopicReader() {
  dds_delete(publications_);
  if (reader_ > 0) dds_delete(reader_);
  for (const auto& [kind, reader] : raw_readers_) dds_delete(reader.entity);
}

std::optional<TopicReader::Message> TopicReader::take() {
  eventfd_t ignored = 0;
  ::eventfd_read(event_.get(), &ignored);
  look_for_publishers();
  auto message = types_.empty() ? take_raw() : take_next();
  if (message) {
    note_message();
  } else {
    note_silence();
  }
  return message;
}

void TopicReader::look_for_publishers() {
  void* samples[1] = {nullptr};
  dds_sample_info_t info;
  dds_instance_handle_t own = 0;
  dds_get_instance_handle(participant_->entity(), &own);
  while (dds_take(publications_, samples, &info, 1, 1) > 0) {
    const auto& found = *static_cast<const dds_builtintopic_endpoint_t*>(samples[0]);
    if (info.instance_state != DDS_IST_ALIVE) {
      if (types_.empty()) {
        left_.push_back(info.instance_handle);
      } else {
        publishers_.erase(info.instance_handle);
      }
    } else if (info.valid_data && found.participant_instance_handle != own &&
               is_of(found.topic_name, topic_)) {
      dds_reliability_kind_t kind = DDS_RELIABILITY_BEST_EFFORT;
      dds_qget_reliability(found.qos, &kind, nullptr);
      publishers_[info.instance_handle] = {ros_type(found.type_name),
                                           kind == DDS_RELIABILITY_RELIABLE};
      if (types_.empty()) add_raw(info.instance_handle, found);
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
  set_type_hash(qos, types_[kind.type]->m_typename);
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

void TopicReader::add_raw(std::uint64_t handle, const dds_builtintopic_endpoint_t& found) {
  constexpr unsigned char kHasKey = 0x02;  // the kind of a writer, in its GUID
  TopicPublisher writer = writer_of(found, handle);
  if (found.key.v[15] == kHasKey || !wire::is_valid(writer)) {
    log_warn(
        "topic {}: a publisher is passed over: its type {} has a key, or no name that ROS 2 allows",
        topic_, ros_type(found.type_name));
    publishers_.erase(handle);
    return;
  }
  try {
    if (!raw_readers_.contains(raw_kind(writer))) open(writer);
  } catch (const std::runtime_error& error) {
    log_error("topic {}: {}", topic_, error.what());
  }
  publishers_[handle].writer = std::make_shared<const TopicPublisher>(std::move(writer));
}

void TopicReader::open(const TopicPublisher& writer) {
  const std::string kind = raw_kind(writer);
  if (raw_readers_.size() == kMostKinds) {
    return log_error("topic {}: {} is not read: there are {} kinds of publishers already", topic_,
                     kind, kMostKinds);
  }
  RawReader reader;
  reader.topic =
      std::make_unique<RawTopic>(participant_->entity(), "rt" + writer.topic, writer.type);
  const Qos qos(dds_create_qos(), &dds_delete_qos);
  dds_qset_reliability(
      qos.get(), writer.is_reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_durability(qos.get(),
                      writer.is_latched ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, depth_);
  const dds_data_representation_id_t both[] = {DDS_DATA_REPRESENTATION_XCDR1,
                                               DDS_DATA_REPRESENTATION_XCDR2};
  dds_qset_data_representation(qos.get(), 2, both);
  dds_qset_userdata(qos.get(), writer.user_data.data(), writer.user_data.size());
  reader.entity = require_dds(
      dds_create_reader(participant_->entity(), reader.topic->entity(), qos.get(), listener_.get()),
      "read the topic " + writer.topic);
  raw_readers_[kind] = std::move(reader);
  log_info("topic {}", kind);
}

/// What comes from a publisher of another kind has another reader. A message may come before the
/// announcement of its publisher, and behind its leave.
std::optional<TopicReader::Message> TopicReader::take_raw() {
  for (const auto& [kind, reader] : raw_readers_) {
    while (auto raw = orbbuf::take_raw(reader.entity)) {
      auto publisher = publishers_.find(raw->writer);
      if (publisher == publishers_.end()) {
        look_for_publishers();
        publisher = publishers_.find(raw->writer);
      }
      if (publisher == publishers_.end() || !publisher->second.writer) continue;
      const auto& writer = publisher->second.writer;
      if (raw_kind(*writer) != kind || raw->cdr.size() < wire::kMinTopicMessageBytes) continue;
      const std::int64_t time_ns = raw->time_ns > 0 ? raw->time_ns : system_time_ns();
      return Message{
          0, nullptr,
          std::make_shared<const TopicMessage>(TopicMessage{writer, time_ns, std::move(raw->cdr)})};
    }
  }
  for (const std::uint64_t handle : std::exchange(left_, {})) publishers_.erase(handle);
  return std::nullopt;
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
  if (why.empty() || why == silence_) return;
  log_warn("topic {}: no message for {} s: {}; waiting", topic_, to_seconds(patience_), why);
  silence_ = std::move(why);
}

std::string TopicReader::why_silent() const {
  std::vector<std::string> types;
  types.reserve(types_.size());
  for (const auto* type : types_) types.push_back(ros_type(type->m_typename));
  if (publishers_.empty()) {
    return fmt::format("no program publishes it in ROS_DOMAIN_ID {} as {}",
                       participant_->domain_id(),
                       types.empty() ? "any type" : fmt::format("{}", fmt::join(types, " or ")));
  }
  if (types_.empty()) return "";  // such as a map, which is published once
  if (!wanted_kind()) {
    return fmt::format("it is published as {}, not as {}", publishers_.begin()->second.type,
                       fmt::join(types, " or "));
  }
  return "its publisher sends nothing";
}

}  // namespace orbbuf
