// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/ros_name.hpp"
#include "server/dataset/mcap/ros2.hpp"
#include "server/foxglove/messages.hpp"

namespace orbbuf::mcap {
namespace {

enum SchemaId : std::uint16_t {
  kImageSchema = 1,
  kCalibrationSchema,
  kDropSchema,
  kQualitySchema,
  kImuSchema,
  kFirstRosSchema,
};
enum ChannelId : std::uint16_t {
  kImage = 1,
  kCalibration,  // behind its image, as the other two are
  kLeftImage,
  kLeftCalibration,
  kRightImage,
  kRightCalibration,
  kDrops,
  kQuality,
  kFirstStream,        // of wire::kFirstOther; the others follow
  kFirstTopic = 1024,  // of ROS 2
};

struct ChannelKind {
  SchemaId schema;
  std::string_view frame;  ///< of reference, behind the robot's id
  std::string_view topic;  ///< behind that
};

/// In the order of ChannelId.
constexpr std::array<ChannelKind, 8> kChannels = {{{kImageSchema, "", "/image"},
                                                   {kCalibrationSchema, "", "/calibration"},
                                                   {kImageSchema, "/left", "/image"},
                                                   {kCalibrationSchema, "/left", "/calibration"},
                                                   {kImageSchema, "/right", "/image"},
                                                   {kCalibrationSchema, "/right", "/calibration"},
                                                   {kDropSchema, "", "/drops"},
                                                   {kQualitySchema, "", "/quality"}}};

constexpr ChannelKind kStreamChannel{kImuSchema, "", ""};
constexpr std::size_t kMostTopics = 1000;

std::string_view ros_topic(SchemaId schema) {
  return schema == kImageSchema ? "/image_raw/compressed" : "/camera_info";
}
std::string_view ros_type_of(SchemaId schema) {
  if (schema == kImageSchema) return ros2::kImageType;
  return schema == kImuSchema ? ros2::kImuType : ros2::kInfoType;
}

const ChannelKind& kind_of(std::uint16_t channel) {
  return channel < kFirstStream ? kChannels.at(channel - 1U) : kStreamChannel;
}

template <class Put>
void with_schema(std::uint16_t id, Put put) {
  if (id == kDropSchema) {
    return put(
        Schema{id, foxglove::kDropSchemaName, "jsonschema", as_bytes(foxglove::kDropSchema)});
  }
  if (id == kQualitySchema) {
    return put(
        Schema{id, foxglove::kQualitySchemaName, "jsonschema", as_bytes(foxglove::kQualitySchema)});
  }
  if (id == kImuSchema) {
    return put(Schema{id, foxglove::kImuSchemaName, "jsonschema", as_bytes(foxglove::kImuSchema)});
  }
  const auto schema = id == kImageSchema ? foxglove::compressed_image_schema()
                                         : foxglove::camera_calibration_schema();
  put(Schema{id, schema.name, "protobuf", schema.descriptors});
}

bool has_topics(const SessionInfo& info) {
  return std::ranges::find(info.streams, wire::kTopicCodec, &wire::StreamDeclaration::codec) !=
         info.streams.end();
}

}  // namespace

Result<Recording> Recording::create(const std::filesystem::path& path, const SessionInfo& info) {
  auto file = File::create(path, has_topics(info) ? "ros2" : "",
                           fmt::format("orbbuf-server {}", ORBBUF_VERSION));
  if (!file) return std::move(file).error();
  return Recording(std::move(file).value(), info);
}

Recording::Recording(File file, const SessionInfo& info)
    : file_(std::move(file)),
      is_of_ros_(has_topics(info)),
      robot_id_(is_of_ros_ ? ros_name(info.robot_id) : info.robot_id),
      streams_(info.streams),
      cameras_(calibrated_cameras(info.calibration)) {}

Result<bool> Recording::add(const EncodedFrame& frame) {
  const bool is_stereo = frame.is_stereo();
  const std::int64_t time_ns = frame.capture_time_ns;
  Result<bool> is_written = false;
  const auto put = [&](std::uint16_t channel, std::span<const std::uint8_t> data) {
    auto added = add(channel, frame.sequence, time_ns, data);
    if (is_written && (!added || added.value())) is_written = std::move(added);
  };
  const auto put_side = [&](std::uint16_t channel, std::span<const std::uint8_t> jpeg,
                            const std::optional<CameraInfo>& camera) {
    const std::string id = frame_id(channel);
    put(channel, is_of_ros_ ? ros2::compressed_image(time_ns, id, jpeg)
                            : foxglove::compressed_image(time_ns, id, jpeg));
    if (!camera) return;
    put(channel + 1, is_of_ros_ ? ros2::camera_info(time_ns, id, *camera)
                                : foxglove::camera_calibration(time_ns, id, *camera));
  };
  put_side(is_stereo ? kLeftImage : kImage, frame.left(), cameras_.left);
  if (is_stereo) put_side(kRightImage, frame.right(), cameras_.right);
  if (!is_of_ros_ && (frame.quality > 0 || frame.is_reduced())) {
    put(kQuality, as_bytes(foxglove::quality_json(frame)));
  }
  return is_written;
}

Result<bool> Recording::add(const DropRecord& range) {
  bool is_written = false;
  if (is_of_ros_) return is_written;
  for (Sequence sequence = range.sequence; sequence < range.end(); ++sequence) {
    const DropRecord one{sequence, range.capture_time_of(sequence), range.reason, range.similarity};
    auto added = add(kDrops, sequence, one.capture_time_ns, as_bytes(foxglove::drop_json(one)));
    if (!added) return added;
    is_written = is_written || added.value();
  }
  return is_written;
}

Result<bool> Recording::add(const RecordedItems& items) {
  bool is_written = false;
  const auto samples = wire::parse_samples(streams_, items.stream, items.payload);
  if (!samples) return is_written;
  for (std::uint64_t number = items.first; const Sample& sample : samples.value()) {
    auto added = add(items.stream, number++, sample);
    if (!added) return added;
    is_written = is_written || added.value();
  }
  return is_written;
}

Result<bool> Recording::add(wire::StreamId stream, std::uint64_t number, const Sample& sample) {
  if (sample.message) return add(number, *sample.message, sample.time_ns);
  const auto channel = static_cast<std::uint16_t>(kFirstStream + stream - wire::kFirstOther);
  if (is_of_ros_) return add(channel, number, sample.time_ns, ros2::imu(sample, robot_id_));
  const std::string frame_id = robot_id_ + name_of(channel);
  return add(channel, number, sample.time_ns, as_bytes(foxglove::imu_json(sample, frame_id)));
}

/// Of a topic with many types, more than any robot has, not all.
Result<bool> Recording::add(std::uint64_t number, const TopicMessage& message,
                            std::int64_t time_ns) {
  const std::pair topic(message.publisher->topic, ros_type(message.publisher->type));
  const auto known = std::ranges::find(topics_, topic);
  const auto index = static_cast<std::size_t>(known - topics_.begin());
  if (index == kMostTopics) return false;
  const auto channel = static_cast<std::uint16_t>(kFirstTopic + index);
  if (known == topics_.end()) {
    topics_.push_back(topic);
    file_.add(Channel{channel, ros_schema(topic.second), topic.first, "cdr"});
  }
  return add(channel, number, time_ns, message.cdr);
}

std::uint16_t Recording::ros_schema(std::string_view type) {
  const auto known = std::ranges::find(ros_types_, type);
  const auto id = static_cast<std::uint16_t>(kFirstRosSchema + (known - ros_types_.begin()));
  if (known == ros_types_.end()) {
    const std::string text = ros2::definition_of(type);
    file_.add(Schema{id, type, text.empty() ? "" : "ros2msg", as_bytes(text)});
    ros_types_.emplace_back(type);
  }
  return id;
}

/// What stands behind the robot's id in a channel's topic: the stream's name, or that of its kind.
std::string Recording::name_of(std::uint16_t channel) const {
  const ChannelKind& kind = kind_of(channel);
  if (channel < kFirstStream) {
    return fmt::format("{}{}", kind.frame, is_of_ros_ ? ros_topic(kind.schema) : kind.topic);
  }
  const auto id = static_cast<wire::StreamId>(channel - kFirstStream + wire::kFirstOther);
  const auto stream = std::ranges::find(streams_, id, &wire::StreamDeclaration::id);
  const std::string name = stream == streams_.end() ? std::to_string(id) : stream->name;
  return "/" + (is_of_ros_ ? ros_name(name) : name);
}

std::optional<Error> Recording::finish(std::int64_t clock_offset_ns) {
  const std::string offset = std::to_string(clock_offset_ns);
  std::optional<Metadata> clock;
  if (clock_offset_ns != 0) clock = {"orbbuf.clock", "offset_ns", offset};
  return file_.finish(clock);
}

Result<bool> Recording::add(std::uint16_t channel, Sequence sequence, std::int64_t time_ns,
                            std::span<const std::uint8_t> data) {
  const ChannelKind& kind = kind_of(channel);
  if (!file_.has_channel(channel)) {
    const std::string topic = fmt::format("/{}{}", robot_id_, name_of(channel));
    if (is_of_ros_) {
      file_.add(Channel{channel, ros_schema(ros_type_of(kind.schema)), topic, "cdr"});
    } else {
      if (!file_.has_schema(kind.schema)) {
        with_schema(kind.schema, [&](const Schema& schema) { file_.add(schema); });
      }
      file_.add({channel, kind.schema, topic, kind.schema >= kDropSchema ? "json" : "protobuf"});
    }
  }
  return file_.add({channel, static_cast<std::uint32_t>(sequence),
                    static_cast<std::uint64_t>(std::max<std::int64_t>(time_ns, 0))},
                   data);
}

/// Of the camera.
std::string Recording::frame_id(std::uint16_t channel) const {
  return is_of_ros_ ? robot_id_ : fmt::format("{}{}", robot_id_, kind_of(channel).frame);
}

}  // namespace orbbuf::mcap
