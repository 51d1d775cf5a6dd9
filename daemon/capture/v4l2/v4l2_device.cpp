// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/v4l2/v4l2_device.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include "common/log.hpp"
#include "daemon/capture/camera_stream.hpp"

namespace orbbuf {
namespace {

/// What the system's text for `error` of an open device does not say.
std::string_view hint_at(int error) {
  switch (error) {
    case EBUSY:
      return "; another program uses the camera";
    case ENODEV:
      return "; the camera is unplugged";
    default:
      return "";
  }
}

std::string_view hint_at_opening(int error) {
  if (error == EACCES) return "; add the user to group video";
  return error == ENODEV ? "" : hint_at(error);
}

/// A string of the driver's, which need not end within its array. A USB device chooses its own
/// name: it must not break the log's lines.
template <std::size_t Size>
std::string text_of(const __u8 (&bytes)[Size]) {
  return printable({bytes, std::find(bytes, bytes + Size, 0)});
}

std::string fourcc_text(__u32 fourcc) {
  std::string text;
  for (int shift = 0; shift < 32; shift += 8) text += static_cast<char>(fourcc >> shift & 0x7F);
  return text;
}

double rate_of(const v4l2_fract& interval) {
  return interval.numerator == 0 ? 0.0
                                 : static_cast<double>(interval.denominator) / interval.numerator;
}

std::vector<double> rates_of(const V4l2Device& device, __u32 fourcc, __u32 width, __u32 height) {
  std::vector<double> rates;
  v4l2_frmivalenum entry{};
  entry.pixel_format = fourcc;
  entry.width = width;
  entry.height = height;
  for (; device.call(VIDIOC_ENUM_FRAMEINTERVALS, &entry) == 0; ++entry.index) {
    const bool is_list = entry.type == V4L2_FRMIVAL_TYPE_DISCRETE;
    rates.push_back(rate_of(is_list ? entry.discrete : entry.stepwise.min));
    if (!is_list) break;
  }
  std::ranges::sort(rates, std::greater());
  return rates;
}

std::vector<CameraSize> sizes_of(const V4l2Device& device, __u32 fourcc) {
  std::vector<CameraSize> sizes;
  v4l2_frmsizeenum entry{};
  entry.pixel_format = fourcc;
  for (; device.call(VIDIOC_ENUM_FRAMESIZES, &entry) == 0; ++entry.index) {
    const bool is_list = entry.type == V4L2_FRMSIZE_TYPE_DISCRETE;
    v4l2_frmsize_stepwise range = entry.stepwise;
    if (is_list) {
      range.min_width = range.max_width = entry.discrete.width;
      range.min_height = range.max_height = entry.discrete.height;
    }
    sizes.push_back({static_cast<int>(range.min_width), static_cast<int>(range.min_height),
                     static_cast<int>(range.max_width), static_cast<int>(range.max_height),
                     rates_of(device, fourcc, range.max_width, range.max_height)});
    if (!is_list) break;
  }
  return sizes;
}

}  // namespace

V4l2Device::V4l2Device(std::string path) : path_(std::move(path)) {
  fd_ = UniqueFd(::open(path_.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
  if (!fd_) {
    const int error = errno;
    const auto nodes = video_nodes();
    const auto text =
        fmt::format("cannot open camera {}: {}{}; {}", path_,
                    std::generic_category().message(error), hint_at_opening(error),
                    nodes.empty() ? "this machine has no /dev/video*"
                                  : fmt::format("this machine has {}", fmt::join(nodes, ", ")));
    if (error == ENOENT || error == ENODEV || error == ENXIO) throw CameraGone(text);
    throw std::runtime_error(text);
  }
  v4l2_capability capability{};
  const int error = call(VIDIOC_QUERYCAP, &capability);
  if (error == ENOTTY || error == EINVAL) {
    throw NoCamera(fmt::format("camera {}: not a V4L2 device", path_));
  }
  if (error != 0) fail("query its capabilities", error);
  name_ = text_of(capability.card);
  bus_ = text_of(capability.bus_info);
  const bool has_own = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0;
  const auto can = has_own ? capability.device_caps : capability.capabilities;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0 || (can & V4L2_CAP_STREAMING) == 0) {
    throw NoCamera(fmt::format("camera {}: this node of {} does not capture images{}", path_, name_,
                               (can & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0
                                   ? " except multi-planar ones, which orbbufd does not read"
                                   : ""));
  }
}

std::vector<CameraOffer> V4l2Device::offers() const {
  std::vector<CameraOffer> offers;
  v4l2_fmtdesc entry{};
  entry.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (; call(VIDIOC_ENUM_FMT, &entry) == 0; ++entry.index) {
    offers.push_back({fourcc_text(entry.pixelformat), sizes_of(*this, entry.pixelformat)});
  }
  return offers;
}

int V4l2Device::call(unsigned long request, void* argument) const {
  int status = 0;
  do {
    status = ::ioctl(fd_.get(), request, argument);
  } while (status < 0 && errno == EINTR);
  return status < 0 ? errno : 0;
}

void V4l2Device::must(std::string_view attempt, unsigned long request, void* argument) const {
  if (const int error = call(request, argument); error != 0) fail(attempt, error);
}

void V4l2Device::fail(std::string_view attempt, int error, std::string_view hint) const {
  const auto text = fmt::format("camera {}: cannot {}: {}{}{}", path_, attempt, driver_error(error),
                                hint_at(error), hint);
  if (error == ENODEV) throw CameraGone(text);
  throw std::runtime_error(text);
}

/// The node's `device` is an interface of the USB device.
std::string usb_reset_command(const std::filesystem::path& node, const std::filesystem::path& sys) {
  namespace fs = std::filesystem;
  std::error_code failed;
  const fs::path name = fs::weakly_canonical(node, failed).filename();
  const fs::path port =
      fs::canonical(sys / "class/video4linux" / name / "device", failed).parent_path();
  const fs::path file = port / "authorized";
  if (failed || !fs::exists(file, failed)) return "";
  return fmt::format("for i in 0 1; do echo $i | sudo tee {}; done", file.string());
}

std::vector<std::string> video_nodes() {
  std::vector<std::string> nodes;
  std::error_code ignored;  // a folder that is not there holds nothing
  for (const auto& entry : std::filesystem::directory_iterator("/dev", ignored)) {
    const auto name = entry.path().filename().string();
    if (name.starts_with("video") && name.find_first_not_of("0123456789", 5) == std::string::npos) {
      nodes.push_back(entry.path().string());
    }
  }
  std::ranges::sort(nodes, {},
                    [](const std::string& node) { return std::pair(node.size(), node); });
  return nodes;
}

}  // namespace orbbuf
