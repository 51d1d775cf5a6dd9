// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include "common/dds/dds_camera.hpp"
#include "common/dds/dds_participant.hpp"
#include "common/frame.hpp"
#include "common/log.hpp"
#include "daemon/mailbox.hpp"

namespace orbbuf {

/// Publishes the frames that orbbufd captures for the nodes of ROS 2 on this robot: the topics of
/// DdsCameras, which keep 10 messages for readers that are slow. A thread of its own, `publish`,
/// writes them. Three frames wait for it at most: neither it nor a reader holds up the caller, and
/// what it is too slow for is counted and logged. Made where TopicReaders are.
class CameraPublisher {
 public:
  /// name: what the topics begin with, `/camera`, and, without the slash, the frame id.
  /// calibration: as parse_calibration() reads it; empty: none. Throws std::runtime_error.
  CameraPublisher(const std::string& name, const std::string& calibration);
  ~CameraPublisher();
  CameraPublisher(const CameraPublisher&) = delete;
  CameraPublisher& operator=(const CameraPublisher&) = delete;

  /// One thread. Never waits.
  void publish(FramePtr frame);

 private:
  void run();

  const std::string name_;
  const std::shared_ptr<const DdsParticipant> participant_;
  DdsCameras cameras_;                              // `publish` only
  LogLimit failure_log_{std::chrono::seconds(10)};  // likewise
  Mailbox<FramePtr> mailbox_{3};
  LogLimit missed_log_{std::chrono::seconds(10)};
  std::uint64_t missed_ = 0;
  std::jthread thread_;
};

}  // namespace orbbuf
