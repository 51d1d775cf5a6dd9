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

/// The ORB features of one image; may be empty (a blank wall).
struct FeatureSet {
  std::vector<Descriptor> descriptors;
};

/// Computes the features of a frame from its JPEG. Called on `worker` only. A frame that cannot be
/// decoded has no features.
using ExtractFeatures = std::function<FeatureSet(const EncodedFrame&)>;

}  // namespace orbbuf
