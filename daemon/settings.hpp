// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "daemon/buffer/make_policy.hpp"
#include "daemon/capture/source_settings.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/image/orb_extractor.hpp"
#include "daemon/net/sender.hpp"
#include "daemon/record/record.hpp"
#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// All of orbbufd.toml. Each module has its own struct, which holds the defaults.
struct Settings {
  std::string log_level = "info";
  std::string robot_id;  ///< `[robot] id`; by default the host's name
  /// `[camera] calibration`: DSO's camera.txt, or Kalibr's as add_imu() joins it; may be empty.
  std::string calibration;
  SourceSettings source;
  std::string publish;  ///< `[source] publish`: for ROS 2 on this robot, `/camera`; empty: not
  JpegSettings jpeg;
  FeatureSettings features;
  BufferSettings buffer;
  LinkSettings link;
  RecordSettings record;
  std::vector<SampleStreamSettings> streams;
  std::vector<std::string> warnings;  ///< what is taken all the same, for main() to log
};

/// Reads `file` (empty: defaults) and applies `overrides` (`table.key=value`). Throws
/// ConfigError.
Settings load_settings(const std::filesystem::path& file, std::span<const std::string> overrides);

/// A unique name for this run of the daemon: UTC time and 64 random bits,
/// `20261121T073000Z-4f3a0b1c2d3e4f50`. Sorts by time.
std::string new_session_id();

}  // namespace orbbuf
