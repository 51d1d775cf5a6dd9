// SPDX-License-Identifier: Apache-2.0
#include "bench/load/content.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <random>
#include <stdexcept>

#include "common/wire.hpp"

namespace orbbuf::load {
namespace {

constexpr std::size_t kImages = 16;
constexpr std::uint16_t kWidth = 640;
constexpr std::uint16_t kHeight = 480;

}  // namespace

Content::Content(std::uint64_t seed, std::size_t bytes) {
  std::mt19937_64 random(seed);
  for (std::size_t i = 0; i < kImages; ++i) {
    Image image{std::vector<std::uint8_t>(bytes), 0};
    std::ranges::generate(image.bytes, [&] { return static_cast<std::uint8_t>(random()); });
    image.crc = wire::crc32(image.bytes);
    images_.push_back(std::move(image));
  }
}

const Content::Image& Content::image(std::size_t robot, Sequence sequence) const {
  return images_[(robot + sequence) % images_.size()];
}

FramePtr Content::frame(std::size_t robot, Sequence sequence) const {
  const Image& shown = image(robot, sequence);
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
  frame.width_px = kWidth;
  frame.height_px = kHeight;
  frame.jpeg_crc = shown.crc;
  frame.jpeg = shown.bytes;
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

bool Content::is_on_disk(const std::filesystem::path& file, const Image& image) const {
  std::ifstream in(file, std::ios::binary);
  std::vector<char> bytes(image.bytes.size() + 1);  // one more than there should be
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return in.gcount() == static_cast<std::streamsize>(image.bytes.size()) &&
         std::equal(image.bytes.begin(), image.bytes.end(), bytes.begin(),
                    [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); });
}

std::uint64_t Content::count_delivered(const std::filesystem::path& session, std::size_t robot,
                                       std::uint64_t captured) const {
  std::ifstream times(session / "times.txt");
  std::uint64_t delivered = 0;
  Sequence next = 0;
  for (std::string line; std::getline(times, line);) {
    const Sequence sequence = std::stoull(line);
    if (sequence < next || sequence >= captured) {
      throw std::runtime_error((session / "times.txt").string() + ": not to be there: " + line);
    }
    next = sequence + 1;
    const auto file = session / "images" / fmt::format("{:06}.jpg", sequence);
    if (is_on_disk(file, image(robot, sequence))) ++delivered;
  }
  return delivered;
}

}  // namespace orbbuf::load
