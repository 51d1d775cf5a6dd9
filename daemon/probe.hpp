// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "daemon/settings.hpp"

namespace orbbuf {

/// What `orbbufd --probe` prints: captures from the source of `settings` for 2 s from the first
/// frame, then measures how long encoding and feature extraction of the last frames take on this
/// machine, takes samples of each stream for 2 s, and suggests settings. Needs no server. Throws
/// std::runtime_error if the source cannot be opened or delivers fewer than two frames within 7 s.
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
