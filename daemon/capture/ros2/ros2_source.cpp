// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/ros2/ros2_source.hpp"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include "common/event_fd.hpp"
#include "common/log.hpp"
#include "common/watched_thread.hpp"
#include "daemon/capture/camera_unpack.hpp"
#include "daemon/topics/header_time.hpp"

namespace orbbuf {
namespace {

using CompressedImage = sensor_msgs_msg_dds__CompressedImage_;
using Image = sensor_msgs_msg_dds__Image_;

constexpr int kDepth = 32;  // a second of a camera
constexpr std::uint32_t kMaxTopicSidePx = 65535;

struct Encoding {
  std::string_view name;
  CameraFormat format;
  std::size_t bytes_per_pixel;
};
constexpr std::array<Encoding, 9> kEncodings = {{{"mono8", CameraFormat::kGrey, 1},
                                                 {"8UC1", CameraFormat::kGrey, 1},
                                                 {"bgr8", CameraFormat::kBgr24, 3},
                                                 {"8UC3", CameraFormat::kBgr24, 3},
                                                 {"rgb8", CameraFormat::kRgb24, 3},
                                                 {"yuv422", CameraFormat::kUyvy, 2},
                                                 {"uyvy", CameraFormat::kUyvy, 2},
                                                 {"yuv422_yuy2", CameraFormat::kYuyv, 2},
                                                 {"yuyv", CameraFormat::kYuyv, 2}}};

std::span<const std::uint8_t> bytes_of(const dds_sequence_octet& data) {
  return {data._buffer, data._length};
}

RawFrame frame_of_jpeg(const CompressedImage& image, std::shared_ptr<const void> lease) {
  const auto data = bytes_of(image.data);
  if (data.size() < 2 || data[0] != 0xFF || data[1] != 0xD8) {
    return frame_with_defect(fmt::format("the compressed image is not a JPEG; its format is \"{}\"",
                                         printable(image.format)));
  }
  RawFrame frame;
  frame.format = PixelFormat::kJpeg;
  frame.data = data;
  frame.lease = std::move(lease);
  return frame;
}

RawFrame frame_of_pixels(const Image& image, bool color) {
  const auto* const encoding =
      std::ranges::find(kEncodings, std::string_view(image.encoding), &Encoding::name);
  if (encoding == kEncodings.end()) {
    return frame_with_defect(fmt::format(
        "cannot read images with the encoding \"{}\"; use mono8, bgr8, rgb8 or yuv422, or the "
        "topic of the compressed images",
        printable(image.encoding)));
  }
  const bool has_size = image.width >= 1 && image.width <= kMaxTopicSidePx && image.height >= 1 &&
                        image.height <= kMaxTopicSidePx &&
                        image.step >= image.width * encoding->bytes_per_pixel;
  if (!has_size) {
    return frame_with_defect(
        fmt::format("the image of {}x{} px has rows of {} bytes, which cannot be", image.width,
                    image.height, image.step));
  }
  const CameraMode mode{.format = encoding->format,
                        .width_px = static_cast<int>(image.width),
                        .height_px = static_cast<int>(image.height),
                        .stride_bytes = image.step,
                        .color = color};
  return unpack(mode, bytes_of(image.data));
}

}  // namespace

Ros2Source::Ros2Source(const std::string& topic, bool color)
    : is_color_(color),
      stop_event_(make_event_fd()),
      reader_(topic,
              {&sensor_msgs_msg_dds__CompressedImage__desc, &sensor_msgs_msg_dds__Image__desc},
              kDepth),
      stamps_(fmt::format("topic {}", reader_.topic()), kFateOfImages) {}

Ros2Source::~Ros2Source() {
  log_info("topic {}: {} images, {} with stamps that do not fit", reader_.topic(), frames_,
           stamps_.misfits());
}

std::optional<RawFrame> Ros2Source::next(std::stop_token stop) {
  const std::stop_callback wake(stop, [this] { ::eventfd_write(stop_event_.get(), 1); });
  while (!stop.stop_requested()) {
    beat();
    if (const auto message = reader_.take()) {
      ++frames_;
      return frame_of(*message);
    }
    std::array<pollfd, 2> events = {{{stop_event_.get(), POLLIN, 0}, {reader_.fd(), POLLIN, 0}}};
    ::poll(events.data(), events.size(),
           static_cast<int>(std::chrono::milliseconds(kBeatInterval).count()));
  }
  return std::nullopt;
}

RawFrame Ros2Source::frame_of(const TopicReader::Message& message) {
  RawFrame frame;
  std::int64_t time_ns = 0;
  if (message.type == 0) {
    const auto& image = *static_cast<const CompressedImage*>(message.data.get());
    frame = frame_of_jpeg(image, message.data);
    time_ns = time_ns_of(image.header);
  } else {
    const auto& image = *static_cast<const Image*>(message.data.get());
    frame = frame_of_pixels(image, is_color_);
    time_ns = time_ns_of(image.header);
  }
  if (!frame.defect.empty())
    frame.defect = fmt::format("topic {}: {}", reader_.topic(), frame.defect);
  const auto now = read_clocks();
  clock_.follow(now);
  time_ns = stamps_.time_of(time_ns, clock_.utc_ns(now.monotonic_ns));
  frame.capture_time_ns = frame.monotonic_ns = time_ns;
  frame.clock_step_ns = stamps_.jumped_ns();
  return frame;
}

std::string Ros2Source::description() const {
  return fmt::format("images of the ROS 2 topic {}", reader_.topic());
}

}  // namespace orbbuf
