// SPDX-License-Identifier: Apache-2.0
#include "bench/session_record.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

#include "daemon/buffer/similarity.hpp"
#include "daemon/image/orb_extractor.hpp"

namespace orbbuf::bench {
namespace {

std::ifstream open(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  return file;
}

void read_delivered(const std::filesystem::path& folder, std::vector<RecordedFrame>& frames) {
  std::ifstream times = open(folder / "times.txt");
  Sequence sequence = 0;
  double time = 0;
  double exposure = 0;
  while (times >> sequence >> time >> exposure) frames.push_back({sequence, time, true, -1});
}

void read_dropped(const std::filesystem::path& folder, std::vector<RecordedFrame>& frames) {
  if (!exists(folder / "drops.csv")) return;
  std::ifstream drops = open(folder / "drops.csv");
  std::string line;
  std::getline(drops, line);  // the header
  while (std::getline(drops, line)) {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line);
    RecordedFrame frame;
    std::string reason;
    if (!(fields >> frame.sequence >> reason >> frame.capture_time_s)) {
      throw std::runtime_error(folder.string() + "/drops.csv: cannot read \"" + line + "\"");
    }
    frames.push_back(frame);
  }
}

/// Of a stereo session; of a mono one there is nothing to check.
void check_right_images(const std::filesystem::path& folder,
                        const std::vector<RecordedFrame>& frames) {
  if (!exists(folder / "images_right")) return;
  for (const RecordedFrame& frame : frames) {
    const auto image = folder / "images_right" / fmt::format("{:06}.jpg", frame.sequence);
    if (exists(image) == frame.is_delivered) continue;
    throw std::runtime_error(image.string() +
                             (frame.is_delivered ? " is missing" : " is too much"));
  }
}

void compare_neighbours(const std::filesystem::path& folder, std::vector<RecordedFrame>& frames) {
  OrbExtractor extractor{FeatureSettings{}};
  FeatureSet previous;
  bool has_previous = false;
  for (RecordedFrame& frame : frames) {
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

std::size_t SessionRecord::delivered() const {
  return static_cast<std::size_t>(
      std::count_if(frames.begin(), frames.end(), [](const auto& f) { return f.is_delivered; }));
}

std::size_t SessionRecord::dropped() const { return frames.size() - delivered(); }

std::size_t SessionRecord::longest_gap() const {
  std::size_t longest = 0;
  const RecordedFrame* last = nullptr;
  for (const RecordedFrame& frame : frames) {
    if (!frame.is_delivered) continue;
    if (last) longest = std::max<std::size_t>(longest, frame.sequence - last->sequence - 1);
    last = &frame;
  }
  return longest;
}

int SessionRecord::smallest_similarity() const {
  int smallest = -1;
  for (const RecordedFrame& frame : frames) {
    if (frame.similarity >= 0 && (smallest < 0 || frame.similarity < smallest)) {
      smallest = frame.similarity;
    }
  }
  return smallest;
}

SessionRecord read_session(const std::string& label, const std::filesystem::path& folder) {
  SessionRecord record{label, {}};
  read_delivered(folder, record.frames);
  read_dropped(folder, record.frames);
  std::sort(record.frames.begin(), record.frames.end(),
            [](const auto& a, const auto& b) { return a.sequence < b.sequence; });
  check_right_images(folder, record.frames);
  compare_neighbours(folder, record.frames);
  return record;
}

}  // namespace orbbuf::bench
