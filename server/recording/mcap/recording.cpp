// SPDX-License-Identifier: Apache-2.0
#include "server/recording/mcap/recording.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <set>
#include <utility>

#include "common/as_bytes.hpp"
#include "server/recording/backlog.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/mcap/foxglove.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf::mcap {
namespace {

constexpr std::string_view kLibrary = "orbbuf-server";

enum SchemaId : std::uint16_t {
  kImageSchema = 1,
  kCalibrationSchema,
  kDropSchema,
  kQualitySchema,
};
enum ChannelId : std::uint16_t {
  kImage = 1,
  kCalibration,
  kLeftImage,
  kLeftCalibration,
  kRightImage,
  kRightCalibration,
  kDrops,
  kQuality,
};

struct ChannelKind {
  ChannelId id;
  SchemaId schema;
  std::string_view frame;  ///< of reference, behind the robot's id
  std::string_view topic;  ///< behind that
};

constexpr std::array<ChannelKind, 8> kChannels = {
    {{kImage, kImageSchema, "", "/image"},
     {kCalibration, kCalibrationSchema, "", "/calibration"},
     {kLeftImage, kImageSchema, "/left", "/image"},
     {kLeftCalibration, kCalibrationSchema, "/left", "/calibration"},
     {kRightImage, kImageSchema, "/right", "/image"},
     {kRightCalibration, kCalibrationSchema, "/right", "/calibration"},
     {kDrops, kDropSchema, "", "/drops"},
     {kQuality, kQualitySchema, "", "/quality"}}};

bool is_ours(std::uint16_t channel) { return channel >= kImage && channel <= kQuality; }
const ChannelKind& kind_of(std::uint16_t channel) { return kChannels.at(channel - 1U); }

bool is_image(std::uint16_t channel) {
  return channel == kImage || channel == kLeftImage || channel == kRightImage;
}

MessageHead head_of(std::uint16_t channel, std::uint64_t sequence, std::int64_t time_ns) {
  return {channel, static_cast<std::uint32_t>(sequence),
          static_cast<std::uint64_t>(std::max<std::int64_t>(time_ns, 0))};
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
  const auto schema = id == kImageSchema ? foxglove::compressed_image_schema()
                                         : foxglove::camera_calibration_schema();
  put(Schema{id, schema.name, "protobuf", schema.descriptors});
}

template <class Put>
void with_channel(std::uint16_t id, const std::string& robot_id, Put put) {
  const ChannelKind& kind = kind_of(id);
  const std::string topic = fmt::format("/{}{}{}", robot_id, kind.frame, kind.topic);
  put(Channel{id, kind.schema, topic, kind.schema >= kDropSchema ? "json" : "protobuf"});
}

}  // namespace

Recording::Recording(std::filesystem::path path, const SessionInfo& info)
    : robot_id_(info.robot_id),
      cameras_(calibrated_cameras(info.calibration,
                                  fmt::format("{} {}: recorded", info.robot_id, info.session_id))),
      file_(std::move(path), fmt::format("{} {}", kLibrary, ORBBUF_VERSION)) {}

Result<wire::Position> Recording::recover(const std::optional<wire::Position>& files) {
  const auto listed = files ? read_late(file_.path().parent_path()) : LateList{};
  if (!listed) return listed.error();
  const SequenceSet late = numbers_of(listed.value());
  auto error = file_.recover([&](const MessageHead& head) {
    if (!files) return false;
    if (head.channel_id == kDrops) return head.sequence >= files->next_drop;
    return is_image(head.channel_id) && head.sequence >= files->next_sequence &&
           !late.contains(head.sequence);
  });
  if (error) return std::move(*error);
  wire::Position position;
  for (const auto& [channel, sequence] : file_.contents().highest) {
    const std::uint64_t next = std::uint64_t{sequence} + 1;
    if (channel == kDrops) position.next_drop = next;
    if (is_image(channel)) position.next_sequence = std::max(position.next_sequence, next);
  }
  known_ = position;
  return position;
}

std::optional<Error> Recording::take_missed(const std::filesystem::path& folder,
                                            const wire::Position& files) {
  if (files.next_sequence > known_.next_sequence + kMostMissed) {
    spdlog::warn("{}: frames {} to {} are in the files only", file_.path().string(),
                 known_.next_sequence, files.next_sequence - 1);
    return std::nullopt;
  }
  Backlog backlog(folder);
  while (known_.next_sequence < files.next_sequence) {
    const auto frame = backlog.next(known_.next_sequence);
    if (!frame) return frame.error();
    if (!frame.value()) break;
    if (auto error = write(*frame.value())) return error;
    known_.next_sequence = frame.value()->sequence + 1;
  }
  return known_.next_drop < files.next_drop ? take_missed_drops(folder) : std::nullopt;
}

std::optional<Error> Recording::take_missed_drops(const std::filesystem::path& folder) {
  const auto text = read_text(folder / session_names::kDrops);
  if (!text) return text.error();
  wire::Dropped dropped;
  std::string_view lines = text.value();
  lines.remove_prefix(std::min(lines.find('\n') + 1, lines.size()));  // the header
  for (std::size_t end = 0; (end = lines.find('\n')) != lines.npos; lines.remove_prefix(end + 1)) {
    const auto record = drop_from_csv(lines.substr(0, end));
    if (!record) return Error{"read " + (folder / session_names::kDrops).string()};
    dropped.records.push_back(*record);
  }
  return write_drops(dropped);
}

std::optional<Error> Recording::write(const EncodedFrame& frame) {
  return frame.sequence < known_.next_sequence ? std::nullopt : append(frame);
}

Result<SequenceSet> Recording::frames_among(const LateList& late) const {
  std::set<std::uint64_t> times_ns;
  for (const session_lines::Late& frame : late) {
    times_ns.insert(head_of(kImage, frame.sequence, frame.capture_time_ns).time_ns);
  }
  const auto messages = messages_at(file_.path(), file_.contents(), times_ns);
  if (!messages) return messages.error();
  SequenceSet found;
  for (const MessageHead& message : messages.value()) {
    if (is_image(message.channel_id)) found.insert(message.sequence);
  }
  return found;
}

std::optional<Error> Recording::append(const EncodedFrame& frame) {
  const bool is_stereo = frame.is_stereo();
  Batch batch;
  add_image(frame, is_stereo ? kLeftImage : kImage, frame.left(), batch);
  if (is_stereo) add_image(frame, kRightImage, frame.right(), batch);
  const auto calibration = is_stereo ? kLeftCalibration : kCalibration;
  if (cameras_.left) add_calibration(frame, calibration, *cameras_.left, batch);
  if (is_stereo && cameras_.right) {
    add_calibration(frame, kRightCalibration, *cameras_.right, batch);
  }
  if (frame.quality > 0 || frame.is_reduced()) {
    describe(kQuality, batch);
    batch.add(head_of(kQuality, frame.sequence, frame.capture_time_ns),
              as_bytes(foxglove::quality_json(frame)));
  }
  return file_.append(batch);
}

std::optional<Error> Recording::write_drops(const wire::Dropped& dropped) {
  Batch batch;
  describe(kDrops, batch);
  std::uint64_t number = dropped.first_drop;
  for (const DropRecord& record : dropped.records) {
    if (number >= known_.next_drop) {
      batch.add(head_of(kDrops, number, record.capture_time_ns),
                as_bytes(foxglove::drop_json(record)));
    }
    ++number;
  }
  if (batch.messages().empty()) return std::nullopt;
  return file_.append(batch);
}

std::optional<Error> Recording::finish(SessionClosing& closing) {
  File::Described described;
  std::set<std::uint16_t> schemas;
  for (const auto& [channel, highest] : file_.contents().highest) {
    if (!is_ours(channel)) continue;
    schemas.insert(kind_of(channel).schema);
    with_channel(channel, robot_id_,
                 [&](const Channel& record) { put_channel(described.channels, record); });
  }
  for (const std::uint16_t id : schemas) {
    with_schema(id, [&](const Schema& record) { put_schema(described.schemas, record); });
  }
  described.schema_count = static_cast<std::uint16_t>(schemas.size());
  const auto clock_offset = std::to_string(closing.clock_offset_ns.value_or(0));
  if (closing.clock_offset_ns.value_or(0) != 0) {
    described.metadata = {"orbbuf.clock", "offset_ns", clock_offset};
  }
  return file_.finish(described);
}

/// Where the channel has its first message.
void Recording::describe(std::uint16_t channel, Batch& batch) const {
  if (file_.contents().highest.contains(channel)) return;
  with_schema(kind_of(channel).schema, [&](const Schema& record) { batch.add(record); });
  with_channel(channel, robot_id_, [&](const Channel& record) { batch.add(record); });
}

void Recording::add_image(const EncodedFrame& frame, std::uint16_t channel,
                          std::span<const std::uint8_t> jpeg, Batch& batch) const {
  describe(channel, batch);
  const std::string frame_id = fmt::format("{}{}", robot_id_, kind_of(channel).frame);
  batch.add(head_of(channel, frame.sequence, frame.capture_time_ns),
            foxglove::compressed_image(frame.capture_time_ns, frame_id, jpeg));
}

void Recording::add_calibration(const EncodedFrame& frame, std::uint16_t channel,
                                const CameraInfo& camera, Batch& batch) const {
  describe(channel, batch);
  const std::string frame_id = fmt::format("{}{}", robot_id_, kind_of(channel).frame);
  batch.add(head_of(channel, frame.sequence, frame.capture_time_ns),
            foxglove::camera_calibration(frame.capture_time_ns, frame_id, camera));
}

}  // namespace orbbuf::mcap
