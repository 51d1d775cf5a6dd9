// SPDX-License-Identifier: Apache-2.0
// What became of every frame of one session, from what the robot and the server have left: the
// check of ./dev bench chaos, and beside it the recording. Prints what is wrong, and a line of
// counts.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>
#include <vector>

#include "bench/chaos/check.hpp"
#include "bench/run_program.hpp"
#include "common/command_line.hpp"

namespace {

namespace fs = std::filesystem;
using orbbuf::chaos::CheckResult;

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The messages of an MCAP file without compression, by the specification alone.
class Recording {
 public:
  explicit Recording(const std::string& bytes) : bytes_(bytes) {
    constexpr std::size_t kMagicBytes = 8;
    for (std::size_t at = kMagicBytes; at + kMagicBytes < bytes.size();) at = record(at);
  }
  /// Of the channels whose topics end in that: by their sequence numbers.
  std::multimap<std::uint32_t, std::string> messages(const std::string& topic) const {
    std::multimap<std::uint32_t, std::string> found;
    for (const auto& [channel, name] : topics_) {
      if (!name.ends_with(topic)) continue;
      const auto of_channel = messages_.find(channel);
      if (of_channel != messages_.end()) {
        found.insert(of_channel->second.begin(), of_channel->second.end());
      }
    }
    return found;
  }

 private:
  static constexpr char kChannel = 4;
  static constexpr char kMessage = 5;
  static constexpr char kChunk = 6;

  template <class Number>
  Number number(std::size_t at) const {
    if (at + sizeof(Number) > bytes_.size()) throw std::runtime_error("the recording ends early");
    Number value{};
    std::memcpy(&value, bytes_.data() + at, sizeof value);
    return value;
  }
  std::string text(std::size_t at) const {
    return bytes_.substr(at + 4, number<std::uint32_t>(at));
  }

  /// Returns where the next one begins; a chunk's records follow as if they were the file's.
  std::size_t record(std::size_t at) {
    constexpr std::size_t kHeadBytes = 9;
    constexpr std::size_t kMessageHeadBytes = 22;
    constexpr std::size_t kChunkHeadBytes = 28;
    const char kind = bytes_.at(at);
    const auto size = static_cast<std::size_t>(number<std::uint64_t>(at + 1));
    const std::size_t body = at + kHeadBytes;
    if (kind == kChunk) {
      const std::string compression = text(body + kChunkHeadBytes);
      if (!compression.empty()) throw std::runtime_error("the recording is compressed");
      return body + kChunkHeadBytes + 4 + 8;
    }
    if (kind == kChannel) topics_[number<std::uint16_t>(body)] = text(body + 4);
    if (kind == kMessage) {
      messages_[number<std::uint16_t>(body)].emplace(
          number<std::uint32_t>(body + 2),
          bytes_.substr(body + kMessageHeadBytes, size - kMessageHeadBytes));
    }
    return body + size;
  }

  const std::string& bytes_;
  std::map<std::uint16_t, std::string> topics_;
  std::map<std::uint16_t, std::multimap<std::uint32_t, std::string>> messages_;
};

/// The parts of the recording have each frame of the files once, and each drop record that the
/// robot sent, and nothing else.
void check_recording(const std::vector<fs::path>& parts, const orbbuf::chaos::Session& session,
                     CheckResult& found) {
  const auto problem = [&](std::uint64_t& count, const std::string& text) {
    ++count;
    found.problems.push_back("recording: " + text);
  };
  std::multimap<std::uint32_t, std::string> images;
  std::set<std::uint32_t> drops;
  for (const fs::path& part : parts) {
    const std::string bytes = read(part);
    const Recording recording(bytes);
    images.merge(recording.messages("/image"));
    for (const auto& [number, data] : recording.messages("/drops")) drops.insert(number);
  }
  std::ifstream times(session.files / "times.txt");
  for (std::string line; std::getline(times, line);) {
    const auto frame = static_cast<std::uint32_t>(std::stoul(line));
    const auto [first, last] = images.equal_range(frame);
    if (first == last) {
      problem(found.lost, "no frame " + line);
      continue;
    }
    if (std::next(first) != last) problem(found.repeated, "frame " + line);
    char name[32];
    std::snprintf(name, sizeof name, "%06u.jpg", frame);
    if (first->second.find(read(session.files / "images" / name)) == std::string::npos) {
      problem(found.unexplained, "not what the files have: frame " + line);
    }
    images.erase(first, last);
  }
  for (const auto& [frame, data] : images) {
    problem(found.unexplained, "only there: frame " + std::to_string(frame));
  }
  std::ifstream listed(session.files / "drops.csv");
  std::string line;
  std::getline(listed, line);
  while (std::getline(listed, line)) {
    const bool is_told = drops.erase(static_cast<std::uint32_t>(std::stoul(line))) > 0;
    const bool is_hole = line.find(",unknown,") != line.npos || line.find(",lost,") != line.npos;
    if (!is_told && !is_hole) problem(found.lost, "no drop record " + line);
  }
  for (const std::uint32_t number : drops) {
    problem(found.unexplained, "only there: drop record " + std::to_string(number));
  }
}

int run(const orbbuf::chaos::Session& session, const fs::path& source) {
  CheckResult found = orbbuf::chaos::check({session}, source);
  std::vector<fs::path> parts;
  for (const auto& entry : fs::directory_iterator(session.files)) {
    if (entry.path().extension() == ".mcap") parts.push_back(entry.path());
  }
  if (!parts.empty()) check_recording(parts, session, found);
  for (const std::string& problem : found.problems) std::printf("%s\n", problem.c_str());
  std::printf(
      "captured %lu delivered %lu dropped %lu died_with_robot %lu lost %lu repeated %lu "
      "unexplained %lu\n",
      found.captured, found.delivered, found.dropped, found.died_with_robot, found.lost,
      found.repeated, found.unexplained);
  return found.problems.empty() ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  orbbuf::chaos::Session session;
  fs::path source;
  orbbuf::CommandLine app("What became of every frame of a session");
  app.add_option("--session", session.files, "the server's folder of it").required();
  app.add_option("--log", session.log, "what the robot printed").required();
  app.add_option("--source", source, "the images that the robot replays").required();
  app.add_flag("--killed", session.was_killed, "the robot was killed");
  if (const auto status = app.parse(argc, argv)) return *status;
  session.name = session.files.filename().string();
  return orbbuf::bench::run_program("audit", [&] { return run(session, source); });
}
