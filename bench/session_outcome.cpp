// SPDX-License-Identifier: Apache-2.0
#include "bench/session_outcome.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "daemon/buffer/similarity.hpp"
#include "daemon/image/orb_extractor.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::bench {
namespace {

std::ifstream open(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  return file;
}

double to_seconds(std::int64_t time_ns) { return static_cast<double>(time_ns) / 1e9; }

/// Of a stereo session; of a mono one there is nothing to check.
void check_right_images(const std::filesystem::path& folder,
                        const std::vector<FrameOutcome>& frames) {
  if (!exists(folder / "images_right")) return;
  for (const FrameOutcome& frame : frames) {
    const auto image = folder / "images_right" / fmt::format("{:06}.jpg", frame.sequence);
    if (exists(image) == frame.is_delivered) continue;
    throw std::runtime_error(image.string() +
                             (frame.is_delivered ? " is missing" : " is too much"));
  }
}

void compare_neighbours(const std::filesystem::path& folder, std::vector<FrameOutcome>& frames) {
  OrbExtractor extractor{FeatureSettings{}};
  FeatureSet previous;
  bool has_previous = false;
  for (FrameOutcome& frame : frames) {
    if (!frame.is_delivered) continue;
    std::ifstream image = open(folder / "images" / fmt::format("{:06}.jpg", frame.sequence));
    EncodedFrame encoded;
    encoded.jpeg.assign(std::istreambuf_iterator<char>(image), {});
    FeatureSet features;
    extractor.extract(encoded, features);
    if (has_previous) frame.similarity = similarity(previous, features);
    previous = std::move(features);
    has_previous = true;
  }
}

}  // namespace

std::size_t SessionOutcome::delivered() const {
  return static_cast<std::size_t>(
      std::count_if(frames.begin(), frames.end(), [](const auto& f) { return f.is_delivered; }));
}

std::size_t SessionOutcome::dropped() const { return frames.size() - delivered(); }

std::size_t SessionOutcome::longest_gap() const {
  std::size_t longest = 0;
  const FrameOutcome* last = nullptr;
  for (const FrameOutcome& frame : frames) {
    if (!frame.is_delivered) continue;
    if (last) longest = std::max<std::size_t>(longest, frame.sequence - last->sequence - 1);
    last = &frame;
  }
  return longest;
}

int SessionOutcome::smallest_similarity() const {
  int smallest = -1;
  for (const FrameOutcome& frame : frames) {
    if (frame.similarity >= 0 && (smallest < 0 || frame.similarity < smallest)) {
      smallest = frame.similarity;
    }
  }
  return smallest;
}

SessionOutcome read_session(const std::string& label, const std::filesystem::path& folder) {
  const auto recorded = orbbuf::read_session(folder);
  if (!recorded) throw std::runtime_error(recorded.error().text);
  const RecordedSession& session = recorded.value();
  if (!session.problems.empty()) {
    throw std::runtime_error(folder.string() + ": " + session.problems.front());
  }
  SessionOutcome outcome{label, {}};
  for (const RecordedFrame& frame : session.frames) {
    outcome.frames.push_back({frame.sequence, to_seconds(frame.capture_time_ns), true, -1});
  }
  for (const DropRecord& drop : session.drops) {
    for (Sequence i = drop.sequence; i < drop.end(); ++i) {
      outcome.frames.push_back({i, to_seconds(drop.capture_time_of(i)), false, -1});
    }
  }
  std::sort(outcome.frames.begin(), outcome.frames.end(),
            [](const auto& a, const auto& b) { return a.sequence < b.sequence; });
  for (const double begin_s = outcome.frames.empty() ? 0 : outcome.frames.front().capture_time_s;
       FrameOutcome & frame : outcome.frames) {
    frame.capture_time_s -= begin_s;
  }
  check_right_images(folder, outcome.frames);
  compare_neighbours(folder, outcome.frames);
  return outcome;
}

}  // namespace orbbuf::bench
