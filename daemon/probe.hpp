// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "daemon/settings.hpp"

namespace orbbuf {

/// What `orbbufd --probe` prints: films for 2 s from the first frame with the source of `settings`,
/// then times the last frames' encoding and features on this machine, and says what it suggests to
/// set. Needs no server. Throws std::runtime_error if the source cannot be opened, or within 7 s
/// gives not even two frames.
std::string probe(const Settings& settings);

/// What was measured, a frame each.
struct ProbeResult {
  double fps = 0;  ///< by the capture times
  int width_px = 0;
  int height_px = 0;
  double encode_ms = 0;
  double features_ms = 0;
  double jpeg_bytes = 0;
};

/// The part of orbbufd.toml that films the same and would suit what was measured: the true size and
/// rate, a buffer of one second, and, where features take over half of a frame's time, fewer pixels
/// for them.
std::string suggest(const Settings& settings, const ProbeResult& result);

}  // namespace orbbuf
