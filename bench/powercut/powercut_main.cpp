// SPDX-License-Identifier: Apache-2.0
// Cuts the power of a server under load, again and again, and audits what is left on its disk.
//   orbbuf-powercut --server PROGRAM --work FOLDER [--cuts N] [--seed N] [--sync ack] [--mcap]
//     [--file-system xfs]
// Exit status 77: this machine cannot mount a loop device.
#include <poll.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>

#include "bench/power_disk.hpp"
#include "common/command_line.hpp"
#include "common/file_io.hpp"
#include "common/format.hpp"
#include "common/log.hpp"
#include "common/wire.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"
#include "testing/process.hpp"
#include "testing/robot_client.hpp"

namespace orbbuf::bench {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr int kSkipped = 77;
constexpr int kRobots = 3;
constexpr Sequence kWindow = 16;
/// With files.sync = "1 s": what was acknowledged so long before the cut must not be lost.
constexpr std::chrono::milliseconds kOld{1500};

struct Options {
  std::string server;
  fs::path work;
  int cuts = 100;
  unsigned seed = 1;
  std::string sync = "ack";
  std::string file_system = "ext4";
  bool has_mcap = false;
};

struct Counts {
  int cuts = 0;
  std::uint64_t acknowledged = 0;
  std::uint64_t acknowledged_lost = 0;
  std::uint64_t old_lost = 0;  // of these, acknowledged kOld before the cut or earlier
  std::uint64_t named_but_bad = 0;
  std::uint64_t repeated = 0;
  std::uint64_t unexplained = 0;
};

/// What must not be, by what is promised of that setting.
std::uint64_t wrong(const Options& options, const Counts& counts) {
  const std::uint64_t lost = options.sync == "ack"   ? counts.acknowledged_lost
                             : options.sync == "1 s" ? counts.old_lost
                                                     : 0;
  return lost + counts.named_but_bad + counts.repeated + counts.unexplained;
}

/// Frame `sequence` of a robot: every seventh is dropped by the robot.
bool is_dropped(Sequence sequence) { return sequence % 7 == 3; }

EncodedFrame frame_of(int robot, Sequence sequence) {
  std::minstd_rand random(
      static_cast<unsigned>(1 + static_cast<std::uint64_t>(robot) * 1'000'003 + sequence));
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns =
      1'600'000'000'000'000'000 + static_cast<std::int64_t>(sequence) * 5'000'000;
  frame.width_px = 640;
  frame.height_px = 480;
  frame.jpeg.resize(2000 + random() % 60'000);
  for (auto& byte : frame.jpeg) byte = static_cast<std::uint8_t>(1 + random() % 254);
  frame.jpeg[0] = 0xFF;
  frame.jpeg[1] = 0xD8;
  frame.jpeg[frame.jpeg.size() - 2] = 0xFF;
  frame.jpeg[frame.jpeg.size() - 1] = 0xD9;
  frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  frame.jpeg_crc = wire::crc32(frame.jpeg);
  return frame;
}

std::uint64_t drops_before(Sequence sequence) {
  std::uint64_t drops = 0;
  for (Sequence i = 0; i < sequence; ++i) drops += is_dropped(i) ? 1 : 0;
  return drops;
}

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

/// One robot of the load, which remembers what was acknowledged.
class Robot {
 public:
  Robot(int number, std::string session) : number_(number), session_(std::move(session)) {}

  std::string name() const { return fmt::format("r{}", number_); }
  const wire::Position& acknowledged() const { return acknowledged_; }
  /// What was acknowledged by then.
  wire::Position acknowledged_by(Clock::time_point time) const {
    const auto later = std::ranges::find_if(acks_, [&](const Ack& ack) { return ack.time > time; });
    return later == acks_.begin() ? wire::Position{} : std::prev(later)->position;
  }

  /// Sends from where the server's welcome puts it, until `end`, or until the server is gone.
  /// Returns the welcome's position.
  std::optional<wire::Position> run(std::uint16_t port, const std::atomic<bool>& has_ended) {
    const test::RobotClient link(port);
    const auto welcome = link.hello(name(), session_);
    if (!welcome) return std::nullopt;
    wire::Position sent = *welcome;
    bool is_alive = true;
    while (is_alive && !has_ended) {
      // The next that the server lacks: numbers of frames and records go up together.
      if (const Sequence dropped = next(sent); is_dropped(dropped)) {
        link.send_drops(sent[wire::kDrops]++, {{dropped, 0, DropReason::kPolicy}});
      } else {
        link.send_frame(frame_of(number_, next(sent)));
        sent[wire::kFrames] = next(sent) + 1;
      }
      end_ = std::max(end_, std::max(sent[wire::kFrames], next(sent)));
      const bool is_full = sent[wire::kFrames] > acknowledged_[wire::kFrames] + kWindow;
      is_alive = read_acks(link, is_full ? 200 : 0);
      std::this_thread::sleep_for(std::chrono::milliseconds(4));
    }
    return welcome;
  }

  /// Sends all that the server lacks, up to where it had got, and bye. The welcome's position.
  std::optional<wire::Position> finish(std::uint16_t port) {
    const test::RobotClient link(port);
    const auto welcome = link.hello(name(), session_);
    if (!welcome) return std::nullopt;
    std::uint64_t drop = (*welcome)[wire::kDrops];
    for (Sequence i = 0; i < end_; ++i) {
      if (is_dropped(i) && drops_before(i) == drop) {
        link.send_drops(drop++, {{i, 0, DropReason::kPolicy}});
      } else if (!is_dropped(i) && i >= (*welcome)[wire::kFrames]) {
        link.send_frame(frame_of(number_, i));
      }
    }
    wire::Position last{0, drop};
    for (Sequence i = 0; i < end_; ++i) {
      if (!is_dropped(i)) last[wire::kFrames] = i + 1;
    }
    link.send(wire::encode(wire::Bye{last}));
    while (link.ack()) {  // until bye
    }
    return welcome;
  }

  /// What is wrong on disk, all that the robot had being delivered.
  void audit(const fs::path& data, const Options& options, Counts& counts) const {
    const auto session = read_session(data / name() / session_);
    if (!session) {
      counts.unexplained += end_;
      log_error("{}", session.error().text);
      return;
    }
    std::map<Sequence, int> seen;
    for (const RecordedFrame& frame : session.value().frames) {
      ++seen[frame.sequence];
      const auto image =
          read_file(session.value().folder / session_names::left_image(frame.sequence));
      if (!image || image.value() != frame_of(number_, frame.sequence).jpeg) ++counts.named_but_bad;
    }
    for (const DropRecord& drop : session.value().drops) {
      for (Sequence i = drop.sequence; i < drop.end(); ++i) ++seen[i];
    }
    for (Sequence i = 0; i < end_; ++i) {
      if (seen[i] == 0) ++counts.unexplained;
      if (seen[i] > 1) ++counts.repeated;
    }
    counts.unexplained += session.value().problems.size();
    for (const std::string& problem : session.value().problems) log_error("{}", problem);
    if (options.has_mcap) audit_recording(session.value(), options.sync == "ack", counts);
  }

 private:
  /// The parts together have each frame and drop record once; all of them if `is_whole`.
  void audit_recording(const RecordedSession& session, bool is_whole, Counts& counts) const {
    constexpr std::uint16_t kImages = 1;  // channels of mcap::Recording
    constexpr std::uint16_t kDrops = 7;
    std::map<std::uint16_t, std::uint64_t> messages;
    for (const auto& entry : fs::directory_iterator(session.folder)) {
      if (entry.path().extension() == ".mcap") count_messages(entry.path(), messages);
      if (entry.path().extension() == ".tmp") ++counts.unexplained;
    }
    std::uint64_t named = 0;
    for (const DropRecord& drop : session.drops) named += drop.frames;
    const auto compare = [&](const char* what, std::uint64_t has, std::uint64_t listed) {
      if (has != listed) {
        log_warn("{}: {} {} in the recording, {} in the files", name(), has, what, listed);
      }
      if (has > listed) counts.repeated += has - listed;
      if (has < listed && is_whole) counts.unexplained += listed - has;
    };
    compare("frames", messages[kImages], session.frames.size());
    compare("drop records", messages[kDrops], named);
  }

  /// The first frame that is neither sent nor in a record that was.
  Sequence next(const wire::Position& sent) const {
    Sequence sequence = sent[wire::kFrames];
    while (is_dropped(sequence) && drops_before(sequence) < sent[wire::kDrops]) ++sequence;
    return sequence;
  }

  bool read_acks(const test::RobotClient& link, int milliseconds) {
    pollfd events{link.fd(), POLLIN, 0};
    while (::poll(&events, 1, milliseconds) > 0) {
      const auto position = link.ack();
      if (!position) return false;
      acknowledged_ = *position;
      acks_.push_back({Clock::now(), *position});
      milliseconds = 0;
    }
    return true;
  }

  const int number_;
  const std::string session_;
  struct Ack {
    Clock::time_point time;
    wire::Position position;
  };
  std::vector<Ack> acks_;
  wire::Position acknowledged_;
  Sequence end_ = 0;
};

class Server {
 public:
  Server(const Options& options, const fs::path& data)
      : process_({options.server, "--set", "listen.address=127.0.0.1:0", "--set", "status.socket=",
                  "--set", "files.path=" + data.string(), "--set", "files.sync=" + options.sync,
                  "--set", std::string("mcap.enabled=") + (options.has_mcap ? "true" : "false")}) {
    const auto line = process_.wait_for_line("listening on 127.0.0.1:");
    if (line) port_ = static_cast<std::uint16_t>(std::stoi(line->substr(line->rfind(':') + 1)));
  }
  std::uint16_t port() const { return port_; }
  test::Process& process() { return process_; }

 private:
  test::Process process_;
  std::uint16_t port_ = 0;
};

/// Runs the robots for a while, and cuts the power under them.
std::optional<Clock::time_point> cut_under_load(const Options& options, const PowerDisk& disk,
                                                std::vector<Robot>& robots,
                                                std::chrono::milliseconds after) {
  Server server(options, disk.folder() / "data");
  std::atomic<bool> has_ended = false;
  std::vector<std::jthread> threads;
  for (Robot& robot : robots) {
    threads.emplace_back([&] { robot.run(server.port(), has_ended); });
  }
  std::this_thread::sleep_for(after);
  const auto time = Clock::now();
  const bool is_cut = disk.cut();
  server.process().signal(SIGKILL);
  server.process().wait();
  has_ended = true;
  if (!is_cut) return std::nullopt;
  return time;
}

/// How much of `had` is not in `has`.
std::uint64_t lack(const wire::Position& had, const wire::Position& has) {
  const auto beyond = [](std::uint64_t a, std::uint64_t b) { return a > b ? a - b : 0; };
  return beyond(had[wire::kFrames], has[wire::kFrames]) +
         beyond(had[wire::kDrops], has[wire::kDrops]);
}

void finish_and_audit(const Options& options, const PowerDisk& disk, std::vector<Robot>& robots,
                      Clock::time_point cut, Counts& counts) {
  Server server(options, disk.folder() / "data");
  for (Robot& robot : robots) {
    const wire::Position acknowledged = robot.acknowledged();
    const auto welcome = robot.finish(server.port());
    counts.acknowledged += acknowledged[wire::kFrames] + acknowledged[wire::kDrops];
    const wire::Position position = welcome.value_or(wire::Position{});
    counts.acknowledged_lost += lack(acknowledged, position);
    counts.old_lost += lack(robot.acknowledged_by(cut - kOld), position);
  }
  server.process().signal(SIGTERM);
  server.process().wait();
  for (const Robot& robot : robots) robot.audit(disk.folder() / "data", options, counts);
  for (const Robot& robot : robots) {
    const auto folder = disk.folder() / "data" / robot.name();
    std::vector<std::string> command = {options.server, "check"};
    for (const auto& entry : fs::directory_iterator(folder)) command.push_back(entry.path());
    const auto check = test::run(command);
    if (check.status != 0) {
      ++counts.unexplained;
      log_error("check: {}", check.output);
    }
  }
  if (wrong(options, counts) > 0) {
    std::cout << server.process().output();
  }
}

int run(const Options& options) {
  if (!PowerDisk::leave_other_mounts()) {
    std::cout << "powercut: skipped, this user cannot mount\n";
    return kSkipped;
  }
  PowerDisk disk(options.work, "disk", std::uintmax_t{1} << 30U, options.file_system);
  std::mt19937 random(options.seed);
  Counts counts;
  while (counts.cuts < options.cuts) {
    if (!disk.mount()) {
      std::cout << "powercut: skipped, this machine cannot mount a loop device\n";
      return kSkipped;
    }
    std::vector<Robot> robots;
    for (int i = 0; i < kRobots; ++i) robots.emplace_back(i, "cut" + std::to_string(counts.cuts));
    const unsigned longest_ms = options.sync == "ack" ? 2000 : 5000;  // some syncs of one a second
    const std::chrono::milliseconds after(100 + random() % (longest_ms - 100));
    const auto cut = cut_under_load(options, disk, robots, after);
    if (!cut) {
      std::cout << "powercut: skipped, this kernel cannot shut a file system down\n";
      return kSkipped;
    }
    if (!disk.unmount() || !disk.mount()) throw std::runtime_error("cannot mount the disk again");
    finish_and_audit(options, disk, robots, *cut, counts);
    fs::remove_all(disk.folder() / "data");
    disk.unmount();
    ++counts.cuts;
  }
  std::cout << "RESULT powercut.cuts " << counts.cuts << "\nRESULT powercut.acknowledged "
            << counts.acknowledged << "\nRESULT powercut.acknowledged_lost "
            << counts.acknowledged_lost << "\nRESULT powercut.old_lost " << counts.old_lost
            << "\nRESULT powercut.named_but_bad " << counts.named_but_bad
            << "\nRESULT powercut.repeated " << counts.repeated << "\nRESULT powercut.unexplained "
            << counts.unexplained << '\n';
  return wrong(options, counts) == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace orbbuf::bench

int main(int argc, char** argv) try {
  orbbuf::bench::Options options;
  orbbuf::CommandLine app(
      "Cuts the power of a server's file system under load, and audits what is left.");
  app.add_option("--server", options.server, "orbbuf-server").required();
  app.add_option("--work", options.work, "Folder for the disk").required();
  app.add_option("--cuts", options.cuts, "How many");
  app.add_option("--seed", options.seed, "Of the instants");
  app.add_option("--sync", options.sync, "files.sync");
  app.add_option("--file-system", options.file_system, "ext4 or xfs");
  app.add_flag("--mcap", options.has_mcap, "Record MCAP as well");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run(options);
} catch (const std::exception& error) {
  std::cerr << "powercut: " << error.what() << '\n';
  return EXIT_FAILURE;
}
