// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf::load {

/// What the robots capture: a few JPEGs of seeded noise, which every robot shows in turn, so that
/// what lies on the server's disk can be compared byte for byte. Immutable.
class Content {
 public:
  Content(std::uint64_t seed, std::size_t bytes);

  /// Captured just now. Robots begin at different images.
  FramePtr frame(std::size_t robot, Sequence sequence) const;
  /// How many of frames 0 to `captured` - 1 a session's folder on the server has: a line in
  /// times.txt, once, and the image as it was captured. Throws std::runtime_error if it has others.
  std::uint64_t count_delivered(const std::filesystem::path& session, std::size_t robot,
                                std::uint64_t captured) const;

 private:
  struct Image {
    std::vector<std::uint8_t> bytes;
    std::uint32_t crc;
  };
  const Image& image(std::size_t robot, Sequence sequence) const;
  bool is_on_disk(const std::filesystem::path& file, const Image& image) const;

  std::vector<Image> images_;
};

}  // namespace orbbuf::load
