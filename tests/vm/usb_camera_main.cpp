// SPDX-License-Identifier: Apache-2.0
// A USB camera that is a program: plugged in while it runs, unplugged when it is killed. It
// captures a pattern that moves, no two images alike, and keeps every JPEG that it gave away
// entirely. Usage: orbbuf-usb-camera FOLDER [broken], broken: it gives but the first half of each
// JPEG
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <string>

#include "common/jpeg.hpp"
#include "tests/vm/usb_ip.hpp"
#include "tests/vm/uvc_descriptors.hpp"

namespace orbbuf::vm {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kInterval = std::chrono::nanoseconds(std::chrono::seconds(1)) / kUvcRate;

/// The settings that driver and camera agree on: UVC 1.0, table 4-47.
class Probe {
 public:
  Probe() { fill(); }
  void set(const Bytes& wanted) {
    std::copy_n(wanted.begin(), std::min(wanted.size(), bytes_.size()), bytes_.begin());
    fill();
  }
  const Bytes& bytes() const { return bytes_; }
  bool is_jpeg() const { return bytes_[2] == kMotionJpeg; }
  UvcSize size() const { return kUvcSizes.at(bytes_[3] == 2 ? 1 : 0); }

 private:
  void fill() {
    if (bytes_[2] == 0) bytes_[2] = kUncompressed;
    if (bytes_[3] == 0) bytes_[3] = 1;
    put(4, kUvcInterval);
    put(18, 2U * size().width_px * size().height_px);  // of an image
    put(22, 16384);                                    // of a transfer
  }
  void put(std::size_t at, std::uint32_t value) { std::memcpy(&bytes_[at], &value, sizeof(value)); }

  Bytes bytes_ = Bytes(26);
};

class Camera {
 public:
  Camera(std::string folder, bool is_broken) : folder_(std::move(folder)), is_broken_(is_broken) {}
  [[noreturn]] void run();

 private:
  void answer_control(const UsbRequest& request);
  Bytes descriptor(std::uint8_t kind, std::uint8_t index) const;
  void capture();
  Bytes draw() const;
  void stream();
  void keep() const;

  std::string folder_;
  bool is_broken_;
  UsbIpPort port_;
  Probe probe_;
  JpegCodec codec_;
  Clock::time_point due_ = Clock::now();
  unsigned count_ = 0;
  Bytes image_;           // being given away
  std::size_t sent_ = 0;  // of its bytes
};

void Camera::run() {
  for (;;) {
    const bool is_busy = port_.is_asked() && !image_.empty();
    const auto until_due = port_.is_asked() ? due_ - Clock::now() : kInterval;
    if (const auto request = port_.next_control(is_busy ? Clock::duration() : until_due)) {
      answer_control(*request);
    } else if (port_.is_asked()) {
      if (image_.empty() && Clock::now() >= due_) capture();
      if (!image_.empty()) stream();
    }
  }
}

void Camera::answer_control(const UsbRequest& request) {
  constexpr int kGet = 0x80, kClassGet = 0xA1, kClassSet = 0x21, kSetCurrent = 1;
  constexpr int kGetDescriptor = 6, kGetStatus = 0, kGetConfiguration = 8;
  constexpr int kGetLength = 0x85, kGetInfo = 0x86;
  const auto kind = request.setup[0];
  const auto what = request.setup[1];
  const bool is_probe = request.setup[4] == 1 && (request.setup[3] == 1 || request.setup[3] == 2);
  if (kind == kClassSet && what == kSetCurrent && is_probe) {
    probe_.set(request.data);
    image_.clear();
  }
  Bytes answer;
  if (kind == kGet && what == kGetDescriptor) {
    answer = descriptor(request.setup[3], request.setup[2]);
    if (answer.empty()) return port_.answer(request, {}, -EPIPE);
  } else if (kind == kGet && what == kGetStatus) {
    answer = {0, 0};
  } else if (kind == kGet && what == kGetConfiguration) {
    answer = {1};
  } else if (kind == kClassGet && is_probe) {
    answer = what == kGetLength ? Bytes{26, 0} : what == kGetInfo ? Bytes{3} : probe_.bytes();
  } else if (kind == kClassGet) {
    answer.resize(request.length);
  }
  port_.answer(request, answer, 0);
}

Bytes Camera::descriptor(std::uint8_t kind, std::uint8_t index) const {
  switch (kind) {
    case 1:
      return device_descriptor();
    case 2:
      return configuration_descriptor();
    case 3:
      return string_descriptor(index);
    default:
      return {};
  }
}

/// The next image, and when the one after it is due: late ones are left out.
void Camera::capture() {
  due_ = std::max(due_ + kInterval, Clock::now());
  ++count_;
  sent_ = 0;
  const auto [width, height] = probe_.size();
  const Bytes gray = draw();
  if (!probe_.is_jpeg()) {
    image_.assign(2 * gray.size(), 128);
    for (std::size_t i = 0; i < gray.size(); ++i) image_[2 * i] = gray[i];
    return;
  }
  image_ = codec_.encode({gray.data(), width, height, std::size_t{width}, 1}, 70, false).value();
  if (is_broken_) image_.resize(image_.size() / 2);
}

Bytes Camera::draw() const {
  const auto [width, height] = probe_.size();
  Bytes gray;
  gray.reserve(std::size_t{width} * height);
  for (unsigned y = 0; y < height; ++y) {
    for (unsigned x = 0; x < width; ++x) {
      gray.push_back(static_cast<std::uint8_t>((x + 4 * count_) ^ (y + count_ / 64)));
    }
  }
  return gray;
}

/// One transfer: two bytes of header, then as much of the image as there is room for.
void Camera::stream() {
  const auto size = std::min(port_.asked_bytes() - 2, image_.size() - sent_);
  const bool is_last = sent_ + size == image_.size();
  Bytes payload(2 + size);
  payload[0] = 2;  // bytes of header
  payload[1] = static_cast<std::uint8_t>(0x80 | (is_last ? 2 : 0) | (count_ & 1));
  std::copy_n(image_.begin() + static_cast<std::ptrdiff_t>(sent_), size, payload.begin() + 2);
  port_.answer_oldest(payload);
  sent_ += size;
  if (!is_last) return;
  if (probe_.is_jpeg()) keep();
  image_.clear();
}

void Camera::keep() const {
  std::array<char, 16> name{};
  std::snprintf(name.data(), name.size(), "/%06u.jpg", count_);
  std::ofstream(folder_ + name.data(), std::ios::binary)
      .write(reinterpret_cast<const char*>(image_.data()),
             static_cast<std::streamsize>(image_.size()));
}

}  // namespace
}  // namespace orbbuf::vm

int main(int argc, char** argv) {
  try {
    if (argc < 2) throw std::runtime_error("usage: orbbuf-usb-camera FOLDER [broken]");
    orbbuf::vm::Camera(argv[1], argc > 2).run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return EXIT_FAILURE;
  }
}
