// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

struct ddsi_sertype;

namespace orbbuf {

/// A topic of DDS whose messages are bytes, of whatever type: CDR as it is on the wire, its header
/// of 4 bytes included. It has no key. Cyclone DDS has this in headers that it installs but does
/// not promise to keep.
class RawTopic {
 public:
  /// name, type: as DDS has them, `rt/odom`, `nav_msgs::msg::dds_::Odometry_`. participant: an
  /// entity. Throws std::runtime_error.
  RawTopic(int participant, const std::string& name, const std::string& type);
  /// Readers and writers keep the topic.
  ~RawTopic();
  RawTopic(const RawTopic&) = delete;
  RawTopic& operator=(const RawTopic&) = delete;

  int entity() const { return entity_; }

  /// By a writer of this topic, with that source time, as if it were another one's. An error of
  /// Cyclone's, or 0.
  int write(int writer, std::span<const std::uint8_t> cdr, std::int64_t time_ns) const;

 private:
  const ddsi_sertype* type_ = nullptr;  // the topic's
  int entity_ = 0;
};

struct RawMessage {
  std::vector<std::uint8_t> cdr;
  std::int64_t time_ns = 0;  ///< when it was written, or 0: unknown
  std::uint64_t writer = 0;  ///< its instance handle
};
/// The oldest message that waits in a reader of a RawTopic.
std::optional<RawMessage> take_raw(int reader);

}  // namespace orbbuf
