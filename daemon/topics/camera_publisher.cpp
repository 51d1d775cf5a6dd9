// SPDX-License-Identifier: Apache-2.0
#include "daemon/topics/camera_publisher.hpp"

#include <exception>
#include <optional>
#include <utility>

#include "common/error.hpp"

namespace orbbuf {
namespace {

constexpr std::int32_t kDepth = 10;  // as ROS 2's own by default

}  // namespace

CameraPublisher::CameraPublisher(const std::string& name, const std::string& calibration)
    : name_(name),
      participant_(DdsParticipant::shared()),
      cameras_(*participant_, name.substr(1), name.substr(1), calibration, name, kDepth) {
  cameras_.open();
  thread_ = std::jthread([this] { run(); });
}

CameraPublisher::~CameraPublisher() { mailbox_.close(); }

void CameraPublisher::publish(FramePtr frame) {
  if (!mailbox_.put(std::move(frame))) return;
  ++missed_;
  if (missed_log_.lets_through()) {
    log_warn("{}: {} frames so far were not published on this robot, which is too slow", name_,
             missed_);
  }
}

void CameraPublisher::run() {
  name_this_thread("publish");
  while (const auto frame = mailbox_.take()) {
    std::optional<Error> error;
    try {
      error = cameras_.publish(**frame);
    } catch (const std::exception& thrown) {
      error = Error{thrown.what()};
    }
    if (error && failure_log_.lets_through()) {
      log_warn("{}: cannot publish a frame on this robot: {}", name_, error->text);
    }
  }
}

}  // namespace orbbuf
