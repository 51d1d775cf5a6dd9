// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/core.h>

#include <string>

#include "common/frame.hpp"
#include "common/sample.hpp"

/// What things are called in a session's folder (session_store.hpp says what they are).
namespace orbbuf::session_names {

inline constexpr const char* kImages = "images";
inline constexpr const char* kRightImages = "images_right";
inline constexpr const char* kTimes = "times.txt";
inline constexpr const char* kDrops = "drops.csv";
inline constexpr const char* kChecksums = "checksums.sfv";
inline constexpr const char* kQualities = "quality.csv";
inline constexpr const char* kSession = "session.txt";
inline constexpr const char* kOrphans = "orphans";
inline constexpr const char* kIncoming = "incoming.tmp";
inline constexpr const char* kIncomingRight = "incoming_right.tmp";

/// Of a stream of samples, or of the messages of a topic.
inline std::string samples(const wire::StreamDeclaration& stream) {
  return stream.codec == wire::kTopicCodec ? "topics/" + stream.name + ".csv"
                                           : stream.name + "/data.csv";
}

inline std::string image(Sequence sequence) { return fmt::format("{:06}.jpg", sequence); }

/// Of an image in the folder: `images/000123.jpg`, `images_right/000123.jpg`.
inline std::string left_image(Sequence sequence) {
  return fmt::format("{}/{}", kImages, image(sequence));
}
inline std::string right_image(Sequence sequence) {
  return fmt::format("{}/{}", kRightImages, image(sequence));
}

}  // namespace orbbuf::session_names
