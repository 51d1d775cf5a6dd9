// SPDX-License-Identifier: Apache-2.0
#include "bench/load/content.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <random>
#include <stdexcept>

#include "common/jpeg.hpp"
#include "common/wire.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf::load {
namespace {

constexpr std::size_t kImages = 16;
constexpr std::uint16_t kWidth = 640;
constexpr std::uint16_t kHeight = 480;
constexpr int kBlock = 8;  // pixels each way; a JPEG's
constexpr int kBestQuality = 95;
constexpr int kQualityStep = 5;

/// Blocks of random gray with noise in them.
std::vector<std::uint8_t> noise(std::mt19937_64& random) {
  constexpr int kBlocks = kWidth / kBlock;
  constexpr unsigned kNoise = 32;
  std::vector<std::uint8_t> pixels(std::size_t{kWidth} * kHeight);
  std::array<std::uint8_t, kBlocks> blocks{};
  for (int y = 0; y < kHeight; ++y) {
    if (y % kBlock == 0) {
      std::ranges::generate(blocks, [&] { return static_cast<std::uint8_t>(random() % 224); });
    }
    for (int x = 0; x < kWidth; ++x) {
      pixels[static_cast<std::size_t>(y * kWidth + x)] = static_cast<std::uint8_t>(
          blocks[static_cast<std::size_t>(x / kBlock)] + random() % kNoise);
    }
  }
  return pixels;
}

/// A JPEG in the best quality that `bytes` hold, with zeros behind it; of fewer bytes than any
/// quality needs, all zeros.
std::vector<std::uint8_t> image_of(std::size_t bytes, std::mt19937_64& random) {
  const auto pixels = noise(random);
  const ImageView view{pixels.data(), kWidth, kHeight, kWidth, 1};
  JpegCodec codec;
  std::vector<std::uint8_t> image;
  for (int quality = kBestQuality; quality > 0; quality -= kQualityStep) {
    image = codec.encode(view, quality, false).value();
    if (image.size() <= bytes) break;
  }
  if (image.size() > bytes) image.clear();
  image.resize(bytes);
  return image;
}

}  // namespace

Content::Content(std::uint64_t seed, std::size_t bytes) {
  std::mt19937_64 random(seed);
  for (std::size_t i = 0; i < kImages; ++i) {
    Image image{image_of(bytes, random), 0};
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
    if (is_on_disk(session / session_names::left_image(sequence), image(robot, sequence)))
      ++delivered;
  }
  return delivered;
}

}  // namespace orbbuf::load
