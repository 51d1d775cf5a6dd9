// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "common/as_bytes.hpp"
#include "server/foxglove/messages.hpp"

namespace orbbuf::mcap {
namespace {

enum SchemaId : std::uint16_t {
  kImageSchema = 1,
  kCalibrationSchema,
  kDropSchema,
  kQualitySchema,
  kImuSchema,
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
  kFirstStream,  // of wire::kFirstOther; the others follow
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

}  // namespace

Result<Recording> Recording::create(const std::filesystem::path& path, const SessionInfo& info) {
  auto file = File::create(path, fmt::format("orbbuf-server {}", ORBBUF_VERSION));
  if (!file) return std::move(file).error();
  return Recording(std::move(file).value(), info);
}

Recording::Recording(File file, const SessionInfo& info)
    : file_(std::move(file)),
      robot_id_(info.robot_id),
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
    put(channel, foxglove::compressed_image(time_ns, frame_id(channel), jpeg));
    if (!camera) return;
    put(channel + 1, foxglove::camera_calibration(time_ns, frame_id(channel), *camera));
  };
  put_side(is_stereo ? kLeftImage : kImage, frame.left(), cameras_.left);
  if (is_stereo) put_side(kRightImage, frame.right(), cameras_.right);
  if (frame.quality > 0 || frame.is_reduced()) {
    put(kQuality, as_bytes(foxglove::quality_json(frame)));
  }
  return is_written;
}

Result<bool> Recording::add(const DropRecord& range) {
  bool is_written = false;
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
  const auto samples = wire::parse_samples(items.payload);
  if (items.stream < wire::kFirstOther || !samples) return is_written;
  for (std::uint64_t number = items.first; const Sample& sample : samples.value()) {
    if (sample.message) continue;
    auto added = add(items.stream, number++, sample);
    if (!added) return added;
    is_written = is_written || added.value();
  }
  return is_written;
}

Result<bool> Recording::add(wire::StreamId stream, std::uint64_t number, const Sample& sample) {
  const auto channel = static_cast<std::uint16_t>(kFirstStream + stream - wire::kFirstOther);
  const std::string frame_id = robot_id_ + name_of(channel);
  return add(channel, number, sample.time_ns, as_bytes(foxglove::imu_json(sample, frame_id)));
}

/// What stands behind the robot's id in a channel's topic: the stream's name, or that of its kind.
std::string Recording::name_of(std::uint16_t channel) const {
  const ChannelKind& kind = kind_of(channel);
  if (channel < kFirstStream) return fmt::format("{}{}", kind.frame, kind.topic);
  const auto id = static_cast<wire::StreamId>(channel - kFirstStream + wire::kFirstOther);
  const auto stream = std::ranges::find(streams_, id, &wire::StreamDeclaration::id);
  return stream == streams_.end() ? fmt::format("/{}", id) : "/" + stream->name;
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
    if (!file_.has_schema(kind.schema)) {
      with_schema(kind.schema, [&](const Schema& schema) { file_.add(schema); });
    }
    const std::string topic = fmt::format("/{}{}", robot_id_, name_of(channel));
    file_.add({channel, kind.schema, topic, kind.schema >= kDropSchema ? "json" : "protobuf"});
  }
  return file_.add({channel, static_cast<std::uint32_t>(sequence),
                    static_cast<std::uint64_t>(std::max<std::int64_t>(time_ns, 0))},
                   data);
}

/// Of the camera.
std::string Recording::frame_id(std::uint16_t channel) const {
  return fmt::format("{}{}", robot_id_, kind_of(channel).frame);
}

}  // namespace orbbuf::mcap
