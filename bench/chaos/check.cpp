// SPDX-License-Identifier: Apache-2.0
#include "bench/chaos/check.hpp"

#include <fmt/core.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>

namespace orbbuf::chaos {
namespace {

namespace fs = std::filesystem;
using Frame = std::uint64_t;

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> lines(const fs::path& file) {
  std::vector<std::string> all;
  std::istringstream in(read(file));
  for (std::string line; std::getline(in, line);) all.push_back(line);
  return all;
}

std::vector<fs::path> sorted_files(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code absent;
  for (const auto& entry : fs::directory_iterator(folder, absent)) files.push_back(entry.path());
  std::ranges::sort(files);
  return files;
}

/// Of a list, without the head.
std::vector<std::string> records(const fs::path& file) {
  std::vector<std::string> all = lines(file);
  if (!all.empty()) all.erase(all.begin());
  return all;
}

/// As quality.csv has them.
std::string size_and_crc(const std::string& jpeg) {
  const auto* const bytes = reinterpret_cast<const Bytef*>(jpeg.data());
  return fmt::format("{},{:08X}", jpeg.size(), ::crc32_z(0, bytes, jpeg.size()));
}

/// The stats of a robot, as a stats line or the closing line has them.
struct Stats {
  std::uint64_t captured = 0, skipped = 0, failed = 0, dropped = 0, acknowledged = 0, waiting = 0,
                in_flight = 0;
  bool is_closing = false;

  bool adds_up() const {
    return captured == skipped + failed + dropped + acknowledged + waiting + in_flight;
  }
};

/// From a line that has one: "captured 9 skipped 0 ..." or "captured 9 = skipped 0 + ...".
bool parse(const std::string& line, Stats& stats) {
  const std::size_t begin = line.find("] captured ");
  const std::size_t closing = line.find("session ended: captured ");
  stats.is_closing = closing != std::string::npos;
  if (begin == std::string::npos && !stats.is_closing) return false;
  std::string words = line.substr(stats.is_closing ? closing + 15 : begin + 2);
  std::ranges::replace_if(
      words, [](char c) { return c == '=' || c == '+'; }, ' ');
  return std::sscanf(words.c_str(),
                     "captured %lu skipped %lu failed %lu dropped %lu acknowledged %lu waiting %lu "
                     "in flight %lu",
                     &stats.captured, &stats.skipped, &stats.failed, &stats.dropped,
                     &stats.acknowledged, &stats.waiting, &stats.in_flight) == 7;
}

/// Of each reduced frame, what quality.csv says of the JPEG that was captured: "BYTES,CRC".
std::map<Frame, std::string> read_reduced(const fs::path& file) {
  std::map<Frame, std::string> reduced;
  for (const std::string& line : records(file)) {
    const std::string whole = line.substr(line.find(',', line.find(',') + 1) + 1);
    if (!whole.starts_with("0,")) reduced[std::stoull(line)] = whole;
  }
  return reduced;
}

/// Frames that a robot may not have on its disk yet: if it is killed those of the last 2 s, if its
/// power is cut those of the last 3 s (docs/promises.md), and half a second for a busy disk.
constexpr Frame kAtRiskOfKill = 100;
constexpr Frame kAtRiskOfPowerCut = 140;

/// The check of one session; each question is a function.
class SessionCheck {
 public:
  SessionCheck(const Session& session, const std::vector<std::string>& source, CheckResult& result)
      : session_(session), source_(source), result_(result) {}

  void run() {
    read_log();
    read_late();
    read_delivered();
    read_dropped();
    compare_images();
    session_.was_killed ? check_killed() : check_ended();
    result_.captured += captured_;
    result_.delivered += delivered_.size();
    result_.late += late_;
    result_.dropped += dropped_.size();
  }

 private:
  void problem(std::uint64_t& count, const std::string& text) {
    ++count;
    result_.problems.push_back(session_.name + ": " + text);
  }

  void read_log() {
    for (const std::string& line : lines(session_.log)) {
      Stats stats;
      if (!parse(line, stats)) continue;
      if (!stats.adds_up()) problem(result_.unexplained, "does not add up: " + line);
      if (stats.captured < last_.captured || stats.acknowledged < last_.acknowledged) {
        problem(result_.unexplained, "counts backwards: " + line);
      }
      last_ = stats;
    }
    captured_ = last_.captured;
  }

  void read_delivered() {
    for (const std::string& line : lines(session_.files / "times.txt")) {
      const Frame frame = std::stoull(line);
      if (!delivered_.empty() && frame < *delivered_.rbegin()) {
        problem(result_.unexplained, "out of order in times.txt: " + line);
      }
      if (!delivered_.insert(frame).second) problem(result_.repeated, "delivered again: " + line);
    }
  }

  void read_late() {
    for (const std::string& line : lines(session_.files / "session.txt")) {
      if (line.starts_with("late ")) late_ = std::stoull(line.substr(5));
    }
  }

  void read_dropped() {
    for (const std::string& line : records(session_.files / "drops.csv")) {
      const Frame frame = std::stoull(line);
      if (!dropped_.insert(frame).second) problem(result_.repeated, "dropped again: " + line);
      if (delivered_.contains(frame)) problem(result_.repeated, "delivered, dropped: " + line);
      const bool was_encoded =
          line.find(",busy,") == std::string::npos && line.find(",failed,") == std::string::npos;
      if (session_.has_spool && was_encoded) not_late_.insert(frame);
    }
  }

  /// images/ has what times.txt has, byte for byte as it was captured; or reduced from just that.
  void compare_images() {
    std::set<Frame> images;
    const auto reduced = read_reduced(session_.files / "quality.csv");
    for (const fs::path& file : sorted_files(session_.files / "images")) {
      const Frame frame = std::stoull(file.filename().string());
      images.insert(frame);
      if (!source_.empty()) {
        const std::string& captured = source_[frame % source_.size()];
        const auto whole = reduced.find(frame);
        const bool is_reduced = whole != reduced.end() && whole->second == size_and_crc(captured);
        result_.reduced += is_reduced ? 1 : 0;
        if (!is_reduced && read(file) != captured) {
          problem(result_.unexplained, "not what was captured: " + file.filename().string());
        }
      }
      if (delivered_.contains(frame)) continue;
      // Robot and server killed in one: no program finished or removed the very last.
      const bool is_unfinished = session_.was_killed && frame == *images.rbegin() &&
                                 (delivered_.empty() || frame > *delivered_.rbegin());
      if (!is_unfinished || unfinished_++ > 0) {
        problem(result_.unexplained, "an image without a line: " + file.filename().string());
      }
    }
    for (const Frame frame : delivered_) {
      if (!images.contains(frame)) {
        problem(result_.unexplained, "a line without an image: " + std::to_string(frame));
      }
    }
  }

  bool is_recorded(Frame frame) const {
    return delivered_.contains(frame) || dropped_.contains(frame);
  }

  void check_ended() {
    if (!last_.is_closing) problem(result_.unexplained, "no closing stats");
    for (Frame frame = 0; frame < captured_; ++frame) {
      if (!is_recorded(frame)) problem(result_.lost, "frame " + std::to_string(frame));
    }
    if (frames_seen() > captured_) problem(result_.unexplained, "frames that were never captured");
    for (const Frame frame : not_late_) {
      problem(result_.lost, fmt::format("frame {} was dropped and never came", frame));
    }
    if (last_.acknowledged + late_ != delivered_.size() || last_.waiting != 0 ||
        last_.in_flight != 0 ||
        last_.skipped + last_.failed + last_.dropped != dropped_.size() + late_) {
      problem(result_.unexplained, "the closing stats are not the server's record");
    }
  }

  /// What became of a frame that is not delivered is in the drop record, by what the robot's next
  /// start has told, but for the last frames, which no disk had yet.
  void check_killed() {
    captured_ = std::max(captured_, frames_seen());
    const Frame at_risk = session_.lost_power ? kAtRiskOfPowerCut : kAtRiskOfKill;
    for (Frame frame = 0; frame < captured_; ++frame) {
      if (is_recorded(frame) && !not_late_.contains(frame)) continue;
      if (frame + at_risk >= captured_) {
        ++result_.died_with_robot;
      } else {
        problem(result_.lost, fmt::format("frame {} is nowhere, or never came", frame));
      }
    }
  }

  Frame frames_seen() const {
    Frame seen = 0;
    for (const auto* frames : {&delivered_, &dropped_}) {
      if (!frames->empty()) seen = std::max(seen, *frames->rbegin() + 1);
    }
    return seen;
  }

  const Session& session_;
  const std::vector<std::string>& source_;
  CheckResult& result_;
  Stats last_;
  Frame captured_ = 0;
  std::uint64_t late_ = 0;  // frames of those delivered
  std::set<Frame> delivered_;
  std::set<Frame> dropped_;
  std::set<Frame> not_late_;  // of these, the ones that the spool should have had
  int unfinished_ = 0;
};

}  // namespace

CheckResult check(const std::vector<Session>& sessions, const fs::path& source) {
  std::vector<std::string> captured;
  for (const fs::path& file : sorted_files(source)) captured.push_back(read(file));
  CheckResult result;
  for (const Session& session : sessions) SessionCheck(session, captured, result).run();
  return result;
}

}  // namespace orbbuf::chaos
