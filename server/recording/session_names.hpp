// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/fmt/fmt.h>

#include <string>
#include <string_view>

#include "common/frame.hpp"

/// What things are called in a session's folder (session_files.hpp says what they are).
namespace orbbuf::session_names {

inline constexpr const char* kImages = "images";
inline constexpr const char* kRightImages = "images_right";
inline constexpr const char* kTimes = "times.txt";
inline constexpr const char* kCamera = "camera.txt";
inline constexpr const char* kDrops = "drops.csv";
inline constexpr const char* kEnd = "end.csv";
inline constexpr const char* kSegment = "segment.csv";
inline constexpr const char* kChecksums = "checksums.sfv";
inline constexpr const char* kQualities = "quality.csv";
inline constexpr const char* kOrphans = "orphans";
inline constexpr const char* kIncoming = "incoming.tmp";
inline constexpr const char* kLate = "late";
inline constexpr const char* kLateList = "late.csv";
inline constexpr const char* kSpool = "spool.csv";

inline std::string image(Sequence sequence) { return fmt::format("{:06}.jpg", sequence); }

/// The MCAP file of a session.
inline std::string recording(const std::string& session_id) { return session_id + ".mcap"; }

/// Of an image in the folder: `images/000123.jpg`, `images_right/000123.jpg`.
inline std::string left_image(Sequence sequence) {
  return fmt::format("{}/{}", kImages, image(sequence));
}
inline std::string right_image(Sequence sequence) {
  return fmt::format("{}/{}", kRightImages, image(sequence));
}

/// The same of a late frame, until it is merged: `late/images/000123.jpg`.
inline std::string late_image(std::string_view image) { return fmt::format("{}/{}", kLate, image); }

}  // namespace orbbuf::session_names
