// SPDX-License-Identifier: Apache-2.0
// In place of orb_extractor.cpp in a build without OpenCV's features2d (ORBBUF_ORB is off). The
// settings refuse the only policy that extracts features.
#include "daemon/image/orb_extractor.hpp"

namespace orbbuf {

struct OrbExtractor::State {};

OrbExtractor::OrbExtractor(const FeatureSettings& /*settings*/) {}
OrbExtractor::~OrbExtractor() = default;
bool OrbExtractor::is_built() { return false; }
void OrbExtractor::extract(const EncodedFrame& /*frame*/, FeatureSet& features) {
  features.clear();
}

}  // namespace orbbuf
