// SPDX-License-Identifier: Apache-2.0
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>

#include "bench/powercut/audit.hpp"
#include "common/file_io.hpp"
#include "common/format.hpp"
#include "common/log.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::powercut {
namespace {

namespace fs = std::filesystem;

/// Adds those of a complete MCAP file, by channel, as the statistics in its summary have them
/// (https://mcap.dev/spec). Throws if it is not complete.
void count_messages(const fs::path& path, std::map<std::uint16_t, std::uint64_t>& counts) {
  constexpr std::string_view kMagic = "\x89MCAP0\r\n";
  constexpr std::size_t kPrefix = 9;  // opcode, length
  constexpr std::size_t kFooter = kPrefix + 20;
  constexpr char kStatistics = 0x0B;
  constexpr std::size_t kBeforeMap = 42;  // of the fields of statistics
  const auto content = read_text(path);
  if (!content) throw std::runtime_error(content.error().text);
  const std::string& file = content.value();
  const auto number = [&](std::size_t at, auto value) {
    if (at + sizeof value > file.size()) throw std::runtime_error(path.string() + ": cut off");
    std::memcpy(&value, file.data() + at, sizeof value);
    return value;
  };
  if (!file.ends_with(kMagic)) throw std::runtime_error(path.string() + ": not complete");
  const std::size_t footer = file.size() - kMagic.size() - kFooter;
  for (std::size_t at = number(footer + kPrefix, std::uint64_t{}); at < footer;
       at += kPrefix + number(at + 1, std::uint64_t{})) {
    if (file[at] != kStatistics) continue;
    const std::size_t map = at + kPrefix + kBeforeMap;
    const auto bytes = number(map, std::uint32_t{});
    for (std::size_t entry = map + 4; entry < map + 4 + bytes; entry += 10) {
      counts[number(entry, std::uint16_t{})] += number(entry + 2, std::uint64_t{});
    }
  }
}

}  // namespace

void audit_recording(const Robot& robot, const fs::path& folder, bool is_whole, Counts& counts) {
  enum Channel : std::uint16_t {
    kImage = 1,
    kLeft = 3,
    kRight = 5,
    kDrops = 7,
    kSamples = 9,
    kOdom = 1024
  };
  std::map<std::uint16_t, std::uint64_t> messages;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".mcap") count_messages(entry.path(), messages);
    if (entry.path().extension() == ".tmp") ++counts.unexplained;
  }
  const auto session = read_session(folder);
  if (!session) throw std::runtime_error(session.error().text);
  const auto compare = [&](std::uint16_t channel, std::uint64_t listed, std::uint64_t again = 0) {
    const std::uint64_t has = messages[channel];
    if (has < listed || has > listed + again) {
      log_warn("{}: channel {}: {} in the recording, {} in the files", robot.name(), channel, has,
               listed);
    }
    if (has > listed + again) counts.repeated += has - listed - again;
    if (has < listed && is_whole) counts.unexplained += listed - has;
  };
  // What came reduced is in a later part once more, whole.
  const std::uint64_t frames = session.value().frames.size();
  const std::uint64_t replaced = session.value().summary.totals.replaced;
  const bool is_stereo = robot.content().is_stereo();
  compare(is_stereo ? kLeft : kImage, frames, replaced);
  if (is_stereo) compare(kRight, frames, replaced);
  std::uint64_t named = 0;
  for (Sequence step = 0; step < robot.end(); ++step) named += Content::is_dropped(step) ? 1 : 0;
  if (!is_stereo) compare(kDrops, named);  // MCAP's profile ros2 has none
  compare(kSamples, robot.end() * Content::items_a_step(wire::kFirstOther));
  if (is_stereo) compare(kOdom, robot.end());
}

}  // namespace orbbuf::powercut
