// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "daemon/settings.hpp"

namespace orbbuf {

/// What `orbbufd --probe` prints: captures from the source of `settings` for 2 s from the first
/// frame, then measures how long encoding and feature extraction of the last frames take on this
/// machine, and suggests settings. With streams it takes 6 s: the samples that come meanwhile, and
/// the time between both clocks, if the camera is turned. Needs no server. Throws
/// std::runtime_error if a source cannot be opened, or that of the frames delivers fewer than two
/// within 7 s (11 s).
std::string probe(const Settings& settings);

/// What was measured, per frame.
struct ProbeResult {
  double fps = 0;  ///< by the capture times
  int width_px = 0;
  int height_px = 0;
  double encode_ms = 0;
  double features_ms = 0;
  double jpeg_bytes = 0;
};

/// The part of orbbufd.toml that captures from the same source and fits what was measured: the true
/// size and rate, and, if features take over half of a frame's time, fewer pixels for them.
std::string suggest(const Settings& settings, const ProbeResult& result);

}  // namespace orbbuf
