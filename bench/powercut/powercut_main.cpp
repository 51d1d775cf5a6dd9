// SPDX-License-Identifier: Apache-2.0
// Cuts the power of a server under load, again and again, and audits what is left on its disk.
//   orbbuf-powercut --server PROGRAM --work FOLDER [--cuts N] [--seed N] [--sync ack] [--mcap]
//     [--file-system xfs]
// Exit status 77: this machine cannot mount a loop device.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "bench/power_disk.hpp"
#include "bench/powercut/audit.hpp"
#include "bench/powercut/robot.hpp"
#include "common/command_line.hpp"
#include "common/log.hpp"
#include "common/wire.hpp"
#include "testing/process.hpp"

namespace orbbuf::powercut {
namespace {

namespace fs = std::filesystem;
using bench::PowerDisk;

constexpr int kSkipped = 77;
constexpr int kRobots = 3;
constexpr std::array<wire::StreamId, 4> kLive = {wire::kFrames, wire::kDrops, wire::kFirstOther,
                                                 wire::kFirstOther + 1};
/// With files.sync = "1 s": what was acknowledged so long before the cut must not be lost.
constexpr std::chrono::milliseconds kOld{1500};

struct Options {
  std::string server;
  fs::path work;
  std::uint64_t cuts = 100;
  unsigned seed = 1;
  std::string sync = "ack";
  std::string file_system = "ext4";
  bool has_mcap = false;
};

/// What must not be, by what is promised of that setting.
std::uint64_t wrong(const Options& options, const Counts& counts) {
  const std::uint64_t lost = options.sync == "ack"   ? counts.acknowledged_lost
                             : options.sync == "1 s" ? counts.old_lost
                                                     : 0;
  return lost + counts.named_but_bad + counts.repeated + counts.unexplained;
}

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

/// How many numbers of `had` are not in `has`.
std::uint64_t lack(const wire::Position& had, const wire::Position& has) {
  std::uint64_t items = 0;
  for (const auto stream : kLive) items += std::max(had[stream], has[stream]) - has[stream];
  return items;
}

void finish_and_audit(const Options& options, const PowerDisk& disk, std::vector<Robot>& robots,
                      Clock::time_point cut, Counts& counts) {
  Server server(options, disk.folder() / "data");
  for (Robot& robot : robots) {
    const wire::Position acknowledged = robot.acknowledged_by(Clock::now());
    const wire::Position position = robot.finish(server.port()).value_or(wire::Position{});
    counts.acknowledged += lack(acknowledged, {}) + acknowledged[wire::kLate];
    counts.acknowledged_lost += lack(acknowledged, position);
    counts.old_lost += lack(robot.acknowledged_by(cut - kOld), position);
  }
  server.process().signal(SIGTERM);
  server.process().wait();
  for (const Robot& robot : robots) {
    const fs::path folder = disk.folder() / "data" / robot.name() / robot.session();
    audit(robot, folder, robot.acknowledged_by(Clock::now()), robot.acknowledged_by(cut - kOld),
          counts);
    if (options.has_mcap) audit_recording(robot, folder, options.sync == "ack", counts);
    const auto check = test::run({options.server, "check", folder});
    if (check.status != 0) {
      ++counts.unexplained;
      log_error("check: {}", check.output);
    }
  }
  if (wrong(options, counts) > 0) {
    std::cout << server.process().output();
  }
}

void print(const Counts& counts) {
  for (const auto& [name, count] : {std::pair{"cuts", counts.cuts},
                                    {"frames", counts.frames},
                                    {"stereo", counts.stereo},
                                    {"reduced", counts.reduced},
                                    {"late", counts.late},
                                    {"dropped", counts.dropped},
                                    {"samples", counts.samples},
                                    {"messages", counts.messages},
                                    {"late_items", counts.late_items},
                                    {"acknowledged", counts.acknowledged},
                                    {"acknowledged_lost", counts.acknowledged_lost},
                                    {"old_lost", counts.old_lost},
                                    {"named_but_bad", counts.named_but_bad},
                                    {"repeated", counts.repeated},
                                    {"unexplained", counts.unexplained}}) {
    std::cout << "RESULT powercut." << name << ' ' << count << '\n';
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
  print(counts);
  return wrong(options, counts) == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace orbbuf::powercut

int main(int argc, char** argv) try {
  orbbuf::powercut::Options options;
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
  return orbbuf::powercut::run(options);
} catch (const std::exception& error) {
  std::cerr << "powercut: " << error.what() << '\n';
  return EXIT_FAILURE;
}
