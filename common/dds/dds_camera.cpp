// SPDX-License-Identifier: Apache-2.0
#include "common/dds/dds_camera.hpp"

#include <dds/dds.h>
#include <fmt/core.h>
#include <ros_messages.h>  // made of ros_messages.idl by idlc

#include <algorithm>
#include <memory>
#include <string_view>
#include <utility>

#include "common/dds/type_hash.hpp"

namespace orbbuf {
namespace {

using Qos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

constexpr dds_duration_t kLongestWrite = DDS_MSECS(100);
constexpr std::int32_t kRawDepth = 16;
constexpr std::int32_t kSampleDepth = 60'000;
constexpr std::size_t kTopicBytes = std::size_t{64} << 20U;
constexpr std::size_t kMostWriters = 256;
constexpr std::int64_t kNsPerSecond = 1'000'000'000;

/// What ROS 2's default readers ask for: with XCDR1, whatever Cyclone would choose. KEEP_LAST: with
/// KEEP_ALL a slow reader would delay all others.
Qos topic_qos(std::int32_t depth) {
  Qos qos(dds_create_qos(), &dds_delete_qos);
  const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &xcdr1);
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, kLongestWrite);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, depth);
  return qos;
}

dds_entity_t make_writer(const DdsParticipant& participant, dds_entity_t publisher,
                         const dds_topic_descriptor_t& type, const std::string& name,
                         std::int32_t depth, bool is_latched) {
  const Qos qos = topic_qos(depth);
  if (is_latched) {
    dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, 1, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  const dds_entity_t topic =
      require_dds(dds_create_topic(participant.entity(), &type, name.c_str(), nullptr, nullptr),
                  "make the topic " + name);
  dds_qset_writer_data_lifecycle(qos.get(), false);
  set_type_hash(qos.get(), type.m_typename);
  const dds_entity_t writer = dds_create_writer(publisher, topic, qos.get(), nullptr);
  dds_delete(topic);  // the writer keeps it
  return require_dds(writer, "write to the topic " + name);
}

/// Nothing of a message is changed by writing it; C has no const sequences.
dds_sequence_octet bytes_of(std::span<const std::uint8_t> data) {
  const auto size = static_cast<std::uint32_t>(data.size());
  return {size, size, const_cast<std::uint8_t*>(data.data()), false};
}

/// ROS 2 counts seconds from 1970 on in 31 bits.
std_msgs_msg_dds__Header_ header_of(std::int64_t time_ns, const std::string& frame_id) {
  constexpr std::int64_t kLatest = 0x7FFF'FFFFLL * kNsPerSecond;
  const std::int64_t time = std::clamp<std::int64_t>(time_ns, 0, kLatest);
  return {{static_cast<std::int32_t>(time / kNsPerSecond),
           static_cast<std::uint32_t>(time % kNsPerSecond)},
          const_cast<char*>(frame_id.c_str())};
}

sensor_msgs_msg_dds__CameraInfo_ message_of(const CameraInfo& camera,
                                            const std_msgs_msg_dds__Header_& header) {
  sensor_msgs_msg_dds__CameraInfo_ info{};
  info.header = header;
  info.height = camera.height_px;
  info.width = camera.width_px;
  info.distortion_model = const_cast<char*>(camera.distortion_model.c_str());
  const auto size = static_cast<std::uint32_t>(camera.distortion.size());
  info.d = {size, size, const_cast<double*>(camera.distortion.data()), false};
  std::ranges::copy(camera.k, info.k);
  std::ranges::copy(camera.r, info.r);
  std::ranges::copy(camera.p, info.p);
  return info;
}

std::optional<Error> write_message(dds_entity_t writer, const void* message) {
  const dds_return_t status = dds_write(writer, message);
  if (status != DDS_RETCODE_OK) return Error{dds_strretcode(-status)};
  return std::nullopt;
}

}  // namespace

DdsCamera::DdsCamera(const DdsParticipant& participant, const std::string& base,
                     std::string frame_id, std::int32_t depth)
    : frame_id_(std::move(frame_id)),
      publisher_(require_dds(dds_create_publisher(participant.entity(), nullptr, nullptr),
                             "make a publisher")) {
  const auto writer = [&](const dds_topic_descriptor_t& type, std::string_view name,
                          std::int32_t kept, bool is_latched) {
    return make_writer(participant, publisher_, type, fmt::format("rt/{}/{}", base, name), kept,
                       is_latched);
  };
  try {
    compressed_ =
        writer(sensor_msgs_msg_dds__CompressedImage__desc, "image_raw/compressed", depth, false);
    raw_ = writer(sensor_msgs_msg_dds__Image__desc, "image_raw", std::min(depth, kRawDepth), false);
    info_ = writer(sensor_msgs_msg_dds__CameraInfo__desc, "camera_info", depth, true);
  } catch (...) {
    dds_delete(publisher_);
    throw;
  }
}

DdsCamera::~DdsCamera() { dds_delete(publisher_); }

std::optional<Error> DdsCamera::publish(std::int64_t time_ns, std::span<const std::uint8_t> jpeg,
                                        const CameraInfo* camera) {
  sensor_msgs_msg_dds__CompressedImage_ image{};
  image.header = header_of(time_ns, frame_id_);
  std::string format = "jpeg";
  image.format = format.data();
  image.data = bytes_of(jpeg);
  if (camera != nullptr) {
    const auto info = message_of(*camera, image.header);
    if (auto error = write_message(info_, &info)) return error;
  }
  return write_message(compressed_, &image);
}

std::optional<Error> DdsCamera::publish_raw(std::int64_t time_ns, const GrayImage& gray) {
  sensor_msgs_msg_dds__Image_ image{};
  image.header = header_of(time_ns, frame_id_);
  image.height = static_cast<std::uint32_t>(gray.height_px);
  image.width = static_cast<std::uint32_t>(gray.width_px);
  std::string encoding = "mono8";
  image.encoding = encoding.data();
  image.step = image.width;
  image.data = bytes_of(gray.pixels);
  return write_message(raw_, &image);
}

bool DdsCamera::has_raw_reader() const {
  dds_publication_matched_status_t matched{};
  return dds_get_publication_matched_status(raw_, &matched) == DDS_RETCODE_OK &&
         matched.current_count > 0;
}

DdsCameras::DdsCameras(const DdsParticipant& participant, std::string base, std::string frame_id,
                       std::string_view calibration, std::string name, std::int32_t depth)
    : participant_(participant),
      base_(std::move(base)),
      frame_id_(std::move(frame_id)),
      name_(std::move(name)),
      depth_(depth),
      info_(calibrated_cameras(calibration, name_ + ": published")),
      codec_(name_) {}

void DdsCameras::open(bool is_stereo) {
  if (left_ && is_stereo == (right_ != nullptr)) return;
  right_.reset();
  left_.reset();
  left_ = std::make_unique<DdsCamera>(participant_, is_stereo ? base_ + "/left" : base_, frame_id_,
                                      depth_);
  if (!is_stereo) return;
  right_ = std::make_unique<DdsCamera>(participant_, base_ + "/right", frame_id_, depth_);
  warn_without_right_camera(info_, name_);
}

std::optional<Error> DdsCameras::publish(const EncodedFrame& frame) {
  open(frame.is_stereo());
  auto error = publish(*left_, frame.capture_time_ns, frame.left(), info_.left);
  if (!error && right_) {
    error = publish(*right_, frame.capture_time_ns, frame.right(), info_.right);
  }
  return error;
}

std::optional<Error> DdsCameras::publish(DdsCamera& camera, std::int64_t time_ns,
                                         std::span<const std::uint8_t> jpeg,
                                         const std::optional<CameraInfo>& info) {
  if (auto error = camera.publish(time_ns, jpeg, info ? &*info : nullptr)) return error;
  if (!camera.has_raw_reader()) return std::nullopt;
  const auto image = codec_.decode_gray(jpeg, 1);
  if (!image) return image.error();
  return camera.publish_raw(time_ns, image.value());
}

DdsImu::DdsImu(const DdsParticipant& participant, const std::string& topic, std::string frame_id)
    : frame_id_(std::move(frame_id)),
      publisher_(require_dds(dds_create_publisher(participant.entity(), nullptr, nullptr),
                             "make a publisher")) {
  try {
    writer_ = make_writer(participant, publisher_, sensor_msgs_msg_dds__Imu__desc, "rt/" + topic,
                          kSampleDepth, false);
  } catch (...) {
    dds_delete(publisher_);
    throw;
  }
}

DdsImu::~DdsImu() { dds_delete(publisher_); }

std::optional<Error> DdsImu::publish(const Sample& sample) {
  sensor_msgs_msg_dds__Imu_ imu{};
  imu.header = header_of(sample.time_ns, frame_id_);
  imu.orientation.w = 1;
  imu.orientation_covariance[0] = -1;
  const auto& [x, y, z] = sample.angular_velocity;
  imu.angular_velocity = {x, y, z};
  const auto& [ax, ay, az] = sample.linear_acceleration;
  imu.linear_acceleration = {ax, ay, az};
  return write_message(writer_, &imu);
}

DdsTopics::DdsTopics(const DdsParticipant& participant, std::string base)
    : participant_(participant), base_(std::move(base)) {}

DdsTopics::~DdsTopics() {
  for (const Writer& writer : writers_) dds_delete(writer.entity);
}

std::optional<Error> DdsTopics::publish(const TopicMessage& message) {
  const Writer& writer = writer_for(message);
  const int status = writer.topic->write(writer.entity, message.cdr, message.time_ns);
  if (status != DDS_RETCODE_OK) return Error{dds_strretcode(-status)};
  return std::nullopt;
}

const DdsTopics::Writer& DdsTopics::writer_for(const TopicMessage& message) {
  TopicPublisher of = *message.publisher;
  if (!of.is_latched) of.key = 0;
  const auto known = std::ranges::find(writers_, of, &Writer::of);
  if (known != writers_.end()) {
    std::rotate(known, known + 1, writers_.end());
    return writers_.back();
  }
  if (writers_.size() == kMostWriters) {
    dds_delete(writers_.front().entity);
    writers_.erase(writers_.begin());
  }
  const std::string name = fmt::format("rt/{}{}", base_, of.topic);
  auto topic = std::make_unique<RawTopic>(participant_.entity(), name, of.type);
  const auto room =
      static_cast<std::int32_t>(kTopicBytes / std::max<std::size_t>(message.cdr.size(), 1));
  const Qos qos = topic_qos(std::clamp(room, kRawDepth, kSampleDepth));
  const dds_data_representation_id_t representation =
      of.is_xcdr2 ? DDS_DATA_REPRESENTATION_XCDR2 : DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &representation);
  if (!of.is_reliable) {
    dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, kLongestWrite);
  }
  if (of.is_latched) {
    const auto depth =
        static_cast<std::int32_t>(std::min<std::uint32_t>(of.depth, DdsCamera::kDepth));
    dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, depth, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  dds_qset_userdata(qos.get(), of.user_data.data(), of.user_data.size());
  dds_qset_writer_data_lifecycle(qos.get(), false);
  const dds_entity_t writer =
      require_dds(dds_create_writer(participant_.entity(), topic->entity(), qos.get(), nullptr),
                  "write to the topic " + name);
  writers_.push_back({std::move(of), std::move(topic), writer, Clock::now() + kDiscovery});
  return writers_.back();
}

}  // namespace orbbuf
