// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/calibration/camera_info.hpp"
#include "common/drop_record.hpp"
#include "common/frame.hpp"
#include "common/sample.hpp"

/// The messages of Foxglove's schemas that recordings and live viewers get, as protobuf writes
/// them, and the drop record and samples as JSON.
namespace orbbuf::foxglove {

/// A schema's name and its FileDescriptorSet, whole with what it imports.
struct Schema {
  std::string_view name;
  std::vector<std::uint8_t> descriptors;
};
Schema compressed_image_schema();
Schema camera_calibration_schema();

/// foxglove.CompressedImage.
std::vector<std::uint8_t> compressed_image(std::int64_t time_ns, std::string_view frame_id,
                                           std::span<const std::uint8_t> jpeg);

/// foxglove.CameraCalibration.
std::vector<std::uint8_t> camera_calibration(std::int64_t time_ns, std::string_view frame_id,
                                             const CameraInfo& camera);

/// orbbuf.Quality, and its JSON schema: absent is what is not known, and of a whole frame the last
/// two.
std::string quality_json(const EncodedFrame& frame);
inline constexpr std::string_view kQualitySchemaName = "orbbuf.Quality";
inline constexpr std::string_view kQualitySchema =
    R"({"title":"orbbuf.Quality","type":"object","properties":{)"
    R"("timestamp":{"type":"object","title":"time","properties":{)"
    R"("sec":{"type":"integer"},"nsec":{"type":"integer"}}},)"
    R"("sequence":{"type":"integer"},"quality":{"type":"integer"},)"
    R"("whole_bytes":{"type":"integer"},"whole_crc":{"type":"integer"}}})";

/// orbbuf.Imu, and its JSON schema: the fields of sensor_msgs/Imu that a sample has.
std::string imu_json(const Sample& sample, std::string_view frame_id);
inline constexpr std::string_view kImuSchemaName = "orbbuf.Imu";
inline constexpr std::string_view kImuSchema =
    R"({"title":"orbbuf.Imu","type":"object","properties":{)"
    R"("timestamp":{"type":"object","title":"time","properties":{)"
    R"("sec":{"type":"integer"},"nsec":{"type":"integer"}}},)"
    R"("frame_id":{"type":"string"},)"
    R"("angular_velocity":{"type":"object","properties":{)"
    R"("x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}},)"
    R"("linear_acceleration":{"type":"object","properties":{)"
    R"("x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}}}})";

/// orbbuf.Drop, and its JSON schema.
std::string drop_json(const DropRecord& record);
inline constexpr std::string_view kDropSchemaName = "orbbuf.Drop";
inline constexpr std::string_view kDropSchema =
    R"({"title":"orbbuf.Drop","type":"object","properties":{)"
    R"("timestamp":{"type":"object","title":"time","properties":{)"
    R"("sec":{"type":"integer"},"nsec":{"type":"integer"}}},)"
    R"("sequence":{"type":"integer"},)"
    R"("reason":{"type":"string","enum":["policy","busy","failed","shutdown",)"
    R"("refused","unknown","lost"]},)"
    R"("similarity":{"type":"integer"}}})";

}  // namespace orbbuf::foxglove
