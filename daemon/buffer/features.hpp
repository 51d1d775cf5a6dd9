// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf {

/// One ORB descriptor: 256 bits, compared by Hamming distance.
using Descriptor = std::array<std::uint64_t, 4>;

/// The place of a feature, right and down from the image's upper left corner. The width of every
/// image is kWidth, independent of its size in pixels.
struct ImagePoint {
  static constexpr int kWidth = 1024;

  std::int16_t x = 0;
  std::int16_t y = 0;

  bool operator==(const ImagePoint&) const = default;
};

/// The ORB features of one image; may be empty (a blank wall). 36 bytes a feature.
struct FeatureSet {
  std::vector<Descriptor> descriptors;
  std::vector<ImagePoint> positions = {};  ///< one for each descriptor

  void add(const Descriptor& descriptor, ImagePoint position) {
    descriptors.push_back(descriptor);
    positions.push_back(position);
  }
  /// Keeps the storage.
  void clear() {
    descriptors.clear();
    positions.clear();
  }
};

/// Computes the features of a frame from its JPEG. Called on `worker` only. Overwrites the set, so
/// that its storage can be used again. A frame that cannot be decoded has no features.
using FillFeatures = std::function<void(const EncodedFrame&, FeatureSet&)>;

}  // namespace orbbuf
