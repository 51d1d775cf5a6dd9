// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/frame.hpp"
#include "common/jpeg.hpp"
#include "common/wire.hpp"

namespace orbbuf::test {

inline constexpr std::int64_t kFrameNs = 40'000'000;  // 25 frames a second

inline EncodedFrame frame_of(Sequence sequence, std::vector<std::uint8_t> jpeg) {
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = static_cast<std::int64_t>(sequence) * kFrameNs;
  frame.exposure_ns = 8'500'000;
  frame.jpeg_crc = wire::crc32(jpeg);
  frame.jpeg = std::move(jpeg);
  return frame;
}

/// A frame of `bytes` bytes that tell its sequence; no JPEG, but nobody looks.
inline EncodedFrame plain_frame(Sequence sequence, std::size_t bytes = 100) {
  std::vector<std::uint8_t> jpeg(bytes);
  for (std::size_t i = 0; i < bytes; ++i) jpeg[i] = static_cast<std::uint8_t>(sequence * 31 + i);
  return frame_of(sequence, std::move(jpeg));
}

inline FramePtr plain_frame_ptr(Sequence sequence, std::size_t bytes = 100) {
  return std::make_shared<const EncodedFrame>(plain_frame(sequence, bytes));
}

/// The same between a JPEG's beginning and end, which is what a pipe looks at; bytes > 4.
inline FramePtr jpeg_like_frame_ptr(Sequence sequence, std::size_t bytes = 100) {
  EncodedFrame frame = plain_frame(sequence, bytes);
  frame.jpeg[0] = frame.jpeg[bytes - 2] = 0xFF;
  frame.jpeg[1] = 0xD8;
  frame.jpeg[bytes - 1] = 0xD9;
  frame.jpeg_crc = wire::crc32(frame.jpeg);
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

/// A plain frame that was made from `whole_bytes` bytes.
inline EncodedFrame reduced_frame(Sequence sequence, std::uint8_t quality = 30,
                                  std::uint32_t whole_bytes = 40'123) {
  EncodedFrame frame = plain_frame(sequence);
  frame.quality = quality;
  frame.whole_bytes = whole_bytes;
  frame.whole_crc = 0x0A1B2C3D;
  return frame;
}

/// A stereo frame of two plain images.
inline EncodedFrame plain_pair(Sequence sequence, std::size_t left_bytes, std::size_t right_bytes) {
  EncodedFrame frame = plain_frame(sequence, left_bytes + right_bytes);
  frame.left_bytes = static_cast<std::uint32_t>(left_bytes);
  return frame;
}

/// Drop records, numbered from `first` on.
inline std::shared_ptr<const wire::Items> drops_ptr(std::uint64_t first,
                                                    const std::vector<DropRecord>& records) {
  return std::make_shared<const wire::Items>(
      wire::Items{wire::kDrops, first, wire::encode_drops(records)});
}

/// A frame that is a real JPEG, of noise, so that it is about as large as its pixels.
inline FramePtr jpeg_frame_ptr(Sequence sequence, int width_px, int height_px) {
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width_px * height_px));
  std::uint32_t state = static_cast<std::uint32_t>(sequence) + 1;
  for (auto& pixel : pixels) {
    state = state * 1664525U + 1013904223U;
    pixel = static_cast<std::uint8_t>(state >> 24U);
  }
  JpegCodec codec;
  auto jpeg = codec.encode(
      {pixels.data(), width_px, height_px, static_cast<std::size_t>(width_px), 1}, 90, false);
  return std::make_shared<const EncodedFrame>(frame_of(sequence, std::move(jpeg).value()));
}

/// The images of two frames as one, with the number and time of the left one.
inline FramePtr stereo_frame_ptr(const FramePtr& left, const FramePtr& right) {
  EncodedFrame frame = *left;
  frame.left_bytes = static_cast<std::uint32_t>(left->jpeg.size());
  frame.jpeg.insert(frame.jpeg.end(), right->jpeg.begin(), right->jpeg.end());
  frame.jpeg_crc = wire::crc32(frame.jpeg);
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

inline std::string as_text(std::span<const std::uint8_t> bytes) {
  return {bytes.begin(), bytes.end()};
}

}  // namespace orbbuf::test
