// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "common/frame.hpp"
#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// Computes the features of a frame from its JPEG. Called on `worker` only. Overwrites the set, so
/// that its storage can be used again. A frame that cannot be decoded has no features.
using FillFeatures = std::function<void(const EncodedFrame&, FeatureSet&)>;

}  // namespace orbbuf
