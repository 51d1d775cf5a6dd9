// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/dds/dds_participant.hpp"
#include "common/dds/raw_topic.hpp"
#include "common/error.hpp"

namespace orbbuf {

/// This process as a node of ROS 2, with the writers of its participant, for `ros2 node list` and
/// `ros2 topic info`: publishes what rmw_dds_common does on ros_discovery_info, in the form of the
/// readers there: ROS 2 has IDs of 16 bytes, up to Humble of 24. Thread-bound; it must not outlive
/// the participant.
class DdsNode {
 public:
  /// name: without a slash. look: called by a thread of Cyclone's when tell() is to be called.
  /// Throws std::runtime_error.
  DdsNode(const DdsParticipant& participant, std::string name, std::function<void()> look);
  ~DdsNode();
  DdsNode(const DdsNode&) = delete;
  DdsNode& operator=(const DdsNode&) = delete;

  /// Publishes what is not what was published last, if there is a reader.
  std::optional<Error> tell();
  int writer() const { return writer_; }

 private:
  std::vector<std::uint8_t> message(std::size_t id_bytes) const;

  const DdsParticipant& participant_;
  const std::string name_;
  const std::function<void()> look_;
  const RawTopic topic_;
  int writer_ = 0;
  std::vector<std::uint8_t> told_;
};

}  // namespace orbbuf
