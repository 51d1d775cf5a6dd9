// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/ros2.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <vector>

#include "common/cdr.hpp"

namespace orbbuf::mcap::ros2 {
namespace {

struct Definition {
  std::string_view type;
  std::string_view fields;
};

/// Those of a mobile robot's usual topics. Their fields, from the public definitions.
constexpr Definition kDefinitions[] = {
    {"builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec\n"},
    {"builtin_interfaces/msg/Duration", "int32 sec\nuint32 nanosec\n"},
    {"std_msgs/msg/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"},
    {"std_msgs/msg/String", "string data\n"},
    {"geometry_msgs/msg/Point", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/msg/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/msg/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"},
    {"geometry_msgs/msg/Pose",
     "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"},
    {"geometry_msgs/msg/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"},
    {"geometry_msgs/msg/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n"},
    {"geometry_msgs/msg/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"},
    {"geometry_msgs/msg/TwistStamped", "std_msgs/Header header\ngeometry_msgs/Twist twist\n"},
    {"geometry_msgs/msg/TwistWithCovariance",
     "geometry_msgs/Twist twist\nfloat64[36] covariance\n"},
    {"geometry_msgs/msg/Transform",
     "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"},
    {"geometry_msgs/msg/TransformStamped",
     "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"},
    {"tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"},
    {"nav_msgs/msg/Odometry",
     "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
     "geometry_msgs/TwistWithCovariance twist\n"},
    {"nav_msgs/msg/Path", "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n"},
    {"nav_msgs/msg/MapMetaData",
     "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n"
     "geometry_msgs/Pose origin\n"},
    {"nav_msgs/msg/OccupancyGrid",
     "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n"},
    {"sensor_msgs/msg/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n"},
    {"sensor_msgs/msg/RegionOfInterest",
     "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"},
    {"sensor_msgs/msg/CameraInfo",
     "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\n"
     "float64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
     "sensor_msgs/RegionOfInterest roi\n"},
    {"sensor_msgs/msg/Imu",
     "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
     "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
     "float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
     "float64[9] linear_acceleration_covariance\n"},
    {"sensor_msgs/msg/JointState",
     "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
     "float64[] effort\n"},
    {"sensor_msgs/msg/LaserScan",
     "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n"
     "float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
     "float32[] ranges\nfloat32[] intensities\n"},
    {"sensor_msgs/msg/PointField", "string name\nuint32 offset\nuint8 datatype\nuint32 count\n"},
    {"sensor_msgs/msg/PointCloud2",
     "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
     "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"},
};

std::string_view fields_of(std::string_view type) {
  const auto* const known = std::ranges::find(kDefinitions, type, &Definition::type);
  return known == std::end(kDefinitions) ? std::string_view() : known->fields;
}

/// A message that begins with a std_msgs/Header.
Cdr with_header(std::int64_t time_ns, std::string_view frame_id) {
  constexpr std::int64_t kNsPerSecond = 1'000'000'000;
  const std::int64_t time = std::max<std::int64_t>(time_ns, 0);
  Cdr out;
  out.put(static_cast<std::int32_t>(time / kNsPerSecond));
  out.put(static_cast<std::uint32_t>(time % kNsPerSecond));
  out.put(frame_id);
  return out;
}

}  // namespace

Bytes compressed_image(std::int64_t time_ns, std::string_view frame_id,
                       std::span<const std::uint8_t> jpeg) {
  Cdr out = with_header(time_ns, frame_id);
  out.put(std::string_view("jpeg"));
  out.put(jpeg);
  return out.take();
}

Bytes camera_info(std::int64_t time_ns, std::string_view frame_id, const CameraInfo& camera) {
  Cdr out = with_header(time_ns, frame_id);
  out.put(camera.height_px);
  out.put(camera.width_px);
  out.put(std::string_view(camera.distortion_model));
  out.put(static_cast<std::uint32_t>(camera.distortion.size()));
  out.put(std::span<const double>(camera.distortion));
  out.put(std::span<const double>(camera.k));
  out.put(std::span<const double>(camera.r));
  out.put(std::span<const double>(camera.p));
  for (int i = 0; i < 6; ++i) out.put(std::uint32_t{0});  // binning, region of interest
  out.put(std::uint8_t{0});
  return out.take();
}

Bytes imu(const Sample& sample, std::string_view frame_id) {
  constexpr std::array<double, 9> kUnknown{};
  constexpr std::array<double, 13> kNoOrientation{0, 0, 0, 1, -1};
  Cdr out = with_header(sample.time_ns, frame_id);
  out.put(std::span<const double>(kNoOrientation));
  out.put(std::span<const double>(sample.angular_velocity));
  out.put(std::span<const double>(kUnknown));
  out.put(std::span<const double>(sample.linear_acceleration));
  out.put(std::span<const double>(kUnknown));
  return out.take();
}

std::string definition_of(std::string_view type) {
  std::string text(fields_of(type));
  std::vector<std::string> parts{std::string(type)};
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::string_view rest = fields_of(parts[i]); !rest.empty();) {
      const std::string_view field = rest.substr(0, rest.find_first_of(" ["));
      rest.remove_prefix(rest.find('\n') + 1);
      const auto slash = field.find('/');
      if (slash == std::string_view::npos) continue;
      auto part = fmt::format("{}/msg{}", field.substr(0, slash), field.substr(slash));
      if (std::ranges::find(parts, part) != parts.end()) continue;
      text += fmt::format("{:=<80}\nMSG: {}\n{}", "", field, fields_of(part));
      parts.push_back(std::move(part));
    }
  }
  return text;
}

}  // namespace orbbuf::mcap::ros2
