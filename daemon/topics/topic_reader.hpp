// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/dds/dds_participant.hpp"
#include "common/dds/raw_topic.hpp"
#include "common/sample.hpp"
#include "common/unique_fd.hpp"

struct dds_builtintopic_endpoint;
struct dds_topic_descriptor;
struct dds_listener;

namespace orbbuf {

/// Reads a topic of ROS 2 on this robot. It waits for publishers. Messages of known types it reads
/// reliably if all publishers are reliable, else at best effort; those of any type as each
/// publisher offers them, also those that were there before, where it keeps them. It logs once when
/// no message has come for `patience`, with the reason, and when messages come again. Thread-bound;
/// all readers of the process are made on one thread, since they share a participant. What this
/// process publishes it does not read.
class TopicReader {
 public:
  static constexpr std::chrono::seconds kPatience{5};

  using Types = std::vector<const dds_topic_descriptor*>;

  /// topic: as ROS 2 has it, `/imu/data`. types: those to read, by idlc; if publishers have
  /// several, the first of them counts; none: messages of any type, as bytes, and the topic may be
  /// `/camera/*`: each one whose name begins so. depth: the messages that wait for take(); what is
  /// older is lost. Throws std::runtime_error.
  TopicReader(const std::string& topic, Types types, int depth,
              std::chrono::nanoseconds patience = kPatience);
  ~TopicReader();
  TopicReader(const TopicReader&) = delete;
  TopicReader& operator=(const TopicReader&) = delete;

  /// To poll: readable when take() may return something.
  int fd() const { return event_.get(); }

  struct Message {
    std::size_t type = 0;                       ///< its place in `types`
    std::shared_ptr<const void> data;           ///< of that type, as idlc declares it
    std::shared_ptr<const TopicMessage> raw{};  ///< without types: in place of the others
  };
  /// The oldest message that waits; nothing: wait for fd() before the next call, at most a second.
  std::optional<Message> take();

  const std::string& topic() const { return topic_; }

 private:
  using Clock = std::chrono::steady_clock;

  struct Publisher {
    std::string type;  // as ROS 2 has it
    bool is_reliable = false;
    std::shared_ptr<const TopicPublisher> writer{};  // without types
  };
  struct RawReader {
    std::unique_ptr<RawTopic> topic{};
    int entity = 0;
  };
  struct Kind {
    std::size_t type = 0;
    bool is_reliable = false;
    bool operator==(const Kind&) const = default;
  };

  void look_for_publishers();
  std::optional<Kind> wanted_kind() const;
  void open(const Kind& kind);
  void add_raw(std::uint64_t handle, const dds_builtintopic_endpoint& found);
  void open(const TopicPublisher& writer);
  std::optional<Message> take_next();
  std::optional<Message> take_raw();
  void note_message();
  void note_silence();
  std::string why_silent() const;

  const std::string topic_;
  const Types types_;
  const int depth_;
  const std::chrono::nanoseconds patience_;
  const std::shared_ptr<const DdsParticipant> participant_;
  const UniqueFd event_;  // Cyclone's threads write to it
  const std::unique_ptr<dds_listener, void (*)(dds_listener*)> listener_;
  const int publications_;                         // a reader of all publishers in the domain
  std::map<std::uint64_t, Publisher> publishers_;  // of the topic, by instance handle
  std::optional<Kind> kind_;                       // of reader_
  int reader_ = 0;
  std::map<std::string, RawReader> raw_readers_;  // by raw_kind(), without types
  std::vector<std::uint64_t> left_;               // publishers, of which messages may still wait
  Clock::time_point last_message_ = Clock::now();
  std::string silence_;  // the last reason that was logged since then
};

}  // namespace orbbuf
