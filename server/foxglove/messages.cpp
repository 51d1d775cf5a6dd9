// SPDX-License-Identifier: Apache-2.0
#include "server/foxglove/messages.hpp"

#include <fmt/core.h>

#include <bit>
#include <cstddef>
#include <initializer_list>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/decimal.hpp"

namespace orbbuf::foxglove {
namespace {

/// A protobuf message in the making, field after field
/// (https://protobuf.dev/programming-guides/encoding).
class Message {
 public:
  void put_varint(std::uint32_t field, std::uint64_t value) {
    put_tag(field, kVarint);
    put_raw(value);
  }
  void put_fixed32(std::uint32_t field, std::uint32_t value) {
    put_tag(field, kFixed32);
    put_little_endian(value);
  }
  void put_bytes(std::uint32_t field, std::span<const std::uint8_t> bytes) {
    put_tag(field, kLengthDelimited);
    put_raw(bytes.size());
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  void put_text(std::uint32_t field, std::string_view text) { put_bytes(field, as_bytes(text)); }
  void put_message(std::uint32_t field, const Message& message) {
    put_bytes(field, message.bytes_);
  }
  void put_doubles(std::uint32_t field, std::span<const double> values) {
    put_tag(field, kLengthDelimited);
    put_raw(values.size() * sizeof(double));
    for (const double value : values) put_little_endian(std::bit_cast<std::uint64_t>(value));
  }

  std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  enum WireType : std::uint8_t { kVarint = 0, kLengthDelimited = 2, kFixed32 = 5 };

  void put_tag(std::uint32_t field, WireType type) { put_raw(field << 3U | type); }
  void put_raw(std::uint64_t value) {
    constexpr std::uint64_t kMore = 0x80;
    for (; value >= kMore; value >>= 7U) {
      bytes_.push_back(static_cast<std::uint8_t>(value | kMore));
    }
    bytes_.push_back(static_cast<std::uint8_t>(value));
  }
  template <class T>
  void put_little_endian(T value) {
    for (std::size_t i = 0; i < sizeof value; ++i) {
      bytes_.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    }
  }

  std::vector<std::uint8_t> bytes_;
};

/// FieldDescriptorProto's types and labels.
enum class Type : std::uint8_t {
  kDouble = 1,
  kInt64 = 3,
  kInt32 = 5,
  kFixed32 = 7,
  kString = 9,
  kMessage = 11,
  kBytes = 12,
};
enum class Label : std::uint8_t { kOptional = 1, kRepeated = 3 };

struct Field {
  std::string_view name;
  std::uint32_t number;
  Type type;
  Label label = Label::kOptional;
};

constexpr std::string_view kTimestampFile = "google/protobuf/timestamp.proto";

/// A FileDescriptorProto of one message. The only message among fields is a Timestamp.
Message file(std::string_view path, std::string_view package, std::string_view name,
             std::initializer_list<Field> fields) {
  Message message;
  message.put_text(1, name);
  for (const Field& field : fields) {
    Message descriptor;
    descriptor.put_text(1, field.name);
    descriptor.put_varint(3, field.number);
    descriptor.put_varint(4, static_cast<std::uint64_t>(field.label));
    descriptor.put_varint(5, static_cast<std::uint64_t>(field.type));
    if (field.type == Type::kMessage) descriptor.put_text(6, ".google.protobuf.Timestamp");
    message.put_message(2, descriptor);
  }
  Message file;
  file.put_text(1, path);
  file.put_text(2, package);
  if (path != kTimestampFile) file.put_text(3, kTimestampFile);
  file.put_message(4, message);
  file.put_text(12, "proto3");
  return file;
}

/// A FileDescriptorSet, what is imported first.
std::vector<std::uint8_t> with_timestamp(const Message& importing) {
  Message set;
  set.put_message(1, file(kTimestampFile, "google.protobuf", "Timestamp",
                          {{"seconds", 1, Type::kInt64}, {"nanos", 2, Type::kInt32}}));
  set.put_message(1, importing);
  return set.take();
}

Message timestamp(std::int64_t time_ns) {
  const auto [seconds, nanos] = split_seconds(time_ns);  // nanos count forwards, also before 1970
  Message message;
  message.put_varint(1, static_cast<std::uint64_t>(seconds));
  message.put_varint(2, static_cast<std::uint64_t>(nanos));
  return message;
}

/// ROS's name of a distortion model as Foxglove has it.
std::string_view model_of(const CameraInfo& camera) {
  if (camera.distortion_model == "equidistant") return "kannala_brandt";
  return camera.distortion_model;
}

}  // namespace

Schema compressed_image_schema() {
  return {"foxglove.CompressedImage",
          with_timestamp(file("foxglove/CompressedImage.proto", "foxglove", "CompressedImage",
                              {{"timestamp", 1, Type::kMessage},
                               {"data", 2, Type::kBytes},
                               {"format", 3, Type::kString},
                               {"frame_id", 4, Type::kString}}))};
}

Schema camera_calibration_schema() {
  return {"foxglove.CameraCalibration",
          with_timestamp(file("foxglove/CameraCalibration.proto", "foxglove", "CameraCalibration",
                              {{"timestamp", 1, Type::kMessage},
                               {"width", 2, Type::kFixed32},
                               {"height", 3, Type::kFixed32},
                               {"distortion_model", 4, Type::kString},
                               {"D", 5, Type::kDouble, Label::kRepeated},
                               {"K", 6, Type::kDouble, Label::kRepeated},
                               {"R", 7, Type::kDouble, Label::kRepeated},
                               {"P", 8, Type::kDouble, Label::kRepeated},
                               {"frame_id", 9, Type::kString}}))};
}

std::vector<std::uint8_t> compressed_image(std::int64_t time_ns, std::string_view frame_id,
                                           std::span<const std::uint8_t> jpeg) {
  Message message;
  message.put_message(1, timestamp(time_ns));
  message.put_bytes(2, jpeg);
  message.put_text(3, "jpeg");
  message.put_text(4, frame_id);
  return message.take();
}

std::vector<std::uint8_t> camera_calibration(std::int64_t time_ns, std::string_view frame_id,
                                             const CameraInfo& camera) {
  Message message;
  message.put_message(1, timestamp(time_ns));
  message.put_fixed32(2, camera.width_px);
  message.put_fixed32(3, camera.height_px);
  message.put_text(4, model_of(camera));
  message.put_doubles(5, camera.distortion);
  message.put_doubles(6, camera.k);
  message.put_doubles(7, camera.r);
  message.put_doubles(8, camera.p);
  message.put_text(9, frame_id);
  return message.take();
}

std::string quality_json(const EncodedFrame& frame) {
  const auto [sec, nsec] = split_seconds(frame.capture_time_ns);
  std::string json = fmt::format(R"({{"timestamp":{{"sec":{},"nsec":{}}},"sequence":{})", sec, nsec,
                                 frame.sequence);
  if (frame.quality > 0) json += fmt::format(R"(,"quality":{})", frame.quality);
  if (frame.is_reduced()) {
    json += fmt::format(R"(,"whole_bytes":{},"whole_crc":{})", frame.whole_bytes, frame.whole_crc);
  }
  return json + '}';
}

std::string imu_json(const Sample& sample, std::string_view frame_id) {
  const auto [sec, nsec] = split_seconds(sample.time_ns);
  const auto& [x, y, z] = sample.angular_velocity;
  const auto& [ax, ay, az] = sample.linear_acceleration;
  return fmt::format(R"({{"timestamp":{{"sec":{},"nsec":{}}},"frame_id":"{}",)"
                     R"("angular_velocity":{{"x":{},"y":{},"z":{}}},)"
                     R"("linear_acceleration":{{"x":{},"y":{},"z":{}}}}})",
                     sec, nsec, frame_id, x, y, z, ax, ay, az);
}

std::string drop_json(const DropRecord& record) {
  const auto [sec, nsec] = split_seconds(record.capture_time_ns);
  const std::string similarity = record.similarity == kUnknownSimilarity
                                     ? ""
                                     : fmt::format(R"(,"similarity":{})", record.similarity);
  return fmt::format(R"({{"timestamp":{{"sec":{},"nsec":{}}},"sequence":{},"reason":"{}"{}}})", sec,
                     nsec, record.sequence, to_string(record.reason), similarity);
}

}  // namespace orbbuf::foxglove
