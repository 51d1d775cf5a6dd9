// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/scenario.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace orbbuf::simulation {
namespace {

constexpr std::array<std::string_view, kFaultKinds> kNames = {
    "cut",          "cut-to-server", "cut-to-robot", "new-address",
    "slow-link",    "long-way",      "loss",         "kill",
    "kill-at-call", "die-in-a-row",  "power-cut",    "power-cut-at-call",
    "stop",         "freeze",        "slow-disk",    "hanging-sync",
    "failing-disk", "full-disk",     "clock-step",   "impostor",
    "visit",        "cut-from",      "cut-one-way"};
constexpr auto kKindsOfOneServer = static_cast<std::uint64_t>(FaultKind::kCutFrom);

constexpr double kSlowest = 2500;  // bytes a second

/// Many short ones, few long ones.
Time draw_length(Random& random, Time least, Time most) {
  const double share = static_cast<double>(random.below(1001)) / 1000;
  return static_cast<Time>(static_cast<double>(least) *
                           std::pow(static_cast<double>(most) / static_cast<double>(least), share));
}

/// So that a robot has some 60 to 3000 frames: a day costs what its frames cost.
double draw_rate(Random& random, Time length) {
  constexpr double kLeast = 0.01, kMost = 30, kMostFrames = 3000, kSpan = 50;
  const double most = std::min(kMost, kMostFrames * kSecond / static_cast<double>(length));
  const double least = std::max(kLeast, most / kSpan);
  const double share = static_cast<double>(random.below(1001)) / 1000;
  return std::round(1000 * least * std::pow(most / least, share)) / 1000;
}

RobotSetup draw_robot(Random& random, Time length) {
  constexpr std::array kPolicies = {"catch-up", "catch-up", "catch-up", "uniform", "drop-oldest"};
  RobotSetup robot;
  robot.fps = draw_rate(random, length);
  robot.policy = kPolicies[random.below(kPolicies.size())];
  robot.has_spool = random.one_in(2);
  robot.has_drop_log = random.below(4) != 0;
  robot.has_small_disk = random.one_in(5);
  robot.has_large_images = robot.has_small_disk || random.one_in(3);
  robot.path.delay = draw_length(random, kMillisecond, 200 * kMillisecond);
  if (random.one_in(6))
    robot.path.delay = draw_length(random, 300 * kMillisecond, 900 * kMillisecond);
  robot.path.jitter = random.one_in(2) ? robot.path.delay / 2 : 0;
  robot.path.queue = draw_length(random, 50 * kMillisecond, kSecond);
  const double needed = robot.fps * (robot.has_large_images ? 20000 : 2500);
  // A stream that fills half of the window of its connection has no room for kept frames. Nor has
  // one over so long a way with jitter (docs/simulation.md).
  const double way = robot.path.way_s();
  const bool has_room = needed * 2 * way < static_cast<double>(kWindowBytes) / 2;
  if (!has_room || (robot.path.jitter > 0 && way > 0.5)) robot.has_spool = false;
  robot.path.bytes_per_second =
      std::max(kSlowest, needed * static_cast<double>(2 + random.below(30)));
  return robot;
}

/// A death of the server is everyone's, so it is not every second one.
int draw_machine(Random& random, std::size_t robots) {
  return random.one_in(3) ? kServer : static_cast<int>(1 + random.below(robots));
}

Time longest_fault(const Scenario& scenario) {
  return std::max(600 * kSecond, scenario.length / 24);
}

void draw_value(Fault& fault, Random& random, const Scenario& scenario) {
  const bool is_robots = fault.machine != kServer;
  switch (fault.kind) {
    case FaultKind::kSlowLink: {
      const auto& path = scenario.robots[static_cast<std::size_t>(fault.machine - 1)].path;
      fault.value = static_cast<std::uint64_t>(path.bytes_per_second) / (2 + random.below(40));
      return;
    }
    case FaultKind::kLongWay:
      fault.value = static_cast<std::uint64_t>(draw_length(random, 100 * kMillisecond, kSecond));
      return;
    case FaultKind::kLoss:
      fault.value = 2 + random.below(30);
      return;
    case FaultKind::kKillAtCall:
    case FaultKind::kPowerCutAtCall:
      fault.value = random.below(400);
      break;
    case FaultKind::kDieInARow:
      fault.value = 2 + random.below(random.one_in(3) ? 30 : 6);
      break;
    case FaultKind::kImpostor:
    case FaultKind::kVisit:
      fault.value = random.next() >> 1U;
      return;
    case FaultKind::kClockStep: {
      constexpr std::array<std::int64_t, 7> kSteps = {-500'000'000, -86'400,    -3600, -2, 5,
                                                      7200,         100'000'000};
      fault.value = static_cast<std::uint64_t>(kSteps[random.below(kSteps.size())]);
      return;
    }
    default:
      break;
  }
  switch (fault.kind) {
    case FaultKind::kKill:
    case FaultKind::kKillAtCall:
    case FaultKind::kDieInARow:
    case FaultKind::kPowerCut:
    case FaultKind::kPowerCutAtCall:
    case FaultKind::kStop:
      fault.length = draw_length(random, 100 * kMillisecond,
                                 random.one_in(8) ? longest_fault(scenario)
                                 : is_robots      ? 20 * kSecond
                                                  : 60 * kSecond);
      return;
    default:
      return;
  }
}

bool is_of_robots(FaultKind kind) {
  return kind <= FaultKind::kLoss || kind == FaultKind::kDieInARow || kind == FaultKind::kVisit;
}

Fault draw_fault(Random& random, const Scenario& scenario) {
  Fault fault;
  fault.at = random.between(kSecond, scenario.length);
  // Half of the faults are the plain ones.
  constexpr std::array kPlain = {FaultKind::kCut,  FaultKind::kKill,       FaultKind::kPowerCut,
                                 FaultKind::kStop, FaultKind::kNewAddress, FaultKind::kDieInARow};
  fault.kind = random.one_in(2) ? kPlain[random.below(kPlain.size())]
                                : static_cast<FaultKind>(random.below(kKindsOfOneServer));
  fault.machine = draw_machine(random, scenario.robots.size());
  if (is_of_robots(fault.kind) && fault.machine == kServer) {
    fault.machine = static_cast<int>(1 + random.below(scenario.robots.size()));
  }
  if (fault.kind == FaultKind::kImpostor) fault.machine = kServer;
  fault.length = draw_length(random, 200 * kMillisecond,
                             random.one_in(8) ? longest_fault(scenario) : 60 * kSecond);
  draw_value(fault, random, scenario);
  return fault;
}

/// Moves it to where another one is.
void keep_company(Fault& fault, Random& random, const Scenario& scenario) {
  const Fault& other = scenario.faults[random.below(scenario.faults.size())];
  const Time until = random.one_in(3) ? kSecond : other.length + 2 * kSecond;
  fault.at = std::clamp(other.at + random.between(-kSecond, until), kSecond, scenario.length);
  const bool may_move = other.machine != kServer || !is_of_robots(fault.kind);
  if (fault.kind == FaultKind::kImpostor) return;
  if (may_move && random.one_in(2)) fault.machine = other.machine;
}

/// What an adversary found by hand: deaths while nothing can be told.
void add_death_in_outage(Scenario& scenario, Random& random) {
  constexpr std::array kDeaths = {FaultKind::kKill,      FaultKind::kPowerCut,
                                  FaultKind::kStop,      FaultKind::kKillAtCall,
                                  FaultKind::kDieInARow, FaultKind::kPowerCutAtCall};
  Fault outage;
  outage.at = random.between(kSecond, scenario.length);
  outage.machine = static_cast<int>(1 + random.below(scenario.robots.size()));
  outage.length =
      draw_length(random, kSecond, random.one_in(4) ? longest_fault(scenario) : 60 * kSecond);
  if (random.one_in(4)) outage.kind = FaultKind::kCutToServer;
  Fault death;
  death.machine = outage.machine;
  death.kind = kDeaths[random.below(kDeaths.size())];
  death.at = outage.at + random.between(0, random.one_in(3) ? kSecond : outage.length);
  draw_value(death, random, scenario);
  if (death.kind == FaultKind::kDieInARow && random.one_in(2)) {
    death.at = outage.at;
    death.value = 10 + random.below(25);
    death.length = random.between(100 * kMillisecond, 2 * kSecond);
    outage.length = static_cast<Time>(death.value + 1) * (death.length + 5 * kSecond);
  }
  if (scenario.robots[static_cast<std::size_t>(outage.machine - 1)].has_small_disk) {
    const double fps = scenario.robots[static_cast<std::size_t>(outage.machine - 1)].fps;
    outage.length +=
        std::min(scenario.length / 2, static_cast<Time>(350e9 / fps));  // until it is full
    death.at = outage.at + outage.length - random.between(kSecond, 20 * kSecond);
  }
  scenario.faults.push_back(outage);
  scenario.faults.push_back(death);
}

/// While it writes.
void add_death_of_server(Scenario& scenario, Random& random) {
  Fault death;
  death.at = random.between(kSecond, scenario.length);
  death.kind = random.one_in(3) ? FaultKind::kKillAtCall : FaultKind::kPowerCutAtCall;
  draw_value(death, random, scenario);
  scenario.faults.push_back(death);
}

/// It takes what comes, and cannot acknowledge it.
void add_stall_of_server(Scenario& scenario, Random& random) {
  Fault stall;
  stall.kind = FaultKind::kHangingSync;
  stall.at = random.between(kSecond, scenario.length);
  stall.length = draw_length(random, 10 * kSecond, 100 * kSecond);
  scenario.faults.push_back(stall);
}

/// Programs that are none of ours.
void add_stranger(Scenario& scenario, Random& random) {
  Fault stranger;
  stranger.kind = random.one_in(2) ? FaultKind::kImpostor : FaultKind::kVisit;
  if (stranger.kind == FaultKind::kVisit) {
    stranger.machine = static_cast<int>(1 + random.below(scenario.robots.size()));
  }
  stranger.at = random.between(kSecond, scenario.length);
  stranger.length = draw_length(random, kSecond, 60 * kSecond);
  draw_value(stranger, random, scenario);
  scenario.faults.push_back(stranger);
}

/// What acknowledged frames it has then is not for sure.
void add_power_cut_of_server(Scenario& scenario, Random& random) {
  Fault cut;
  cut.kind = FaultKind::kPowerCut;
  cut.at = random.between(kSecond, scenario.length);
  cut.length = draw_length(random, 100 * kMillisecond, 60 * kSecond);
  scenario.faults.push_back(cut);
}

/// As many frames as an outage of days has at usual rates: until the robot's account must be
/// shortened, and, if it is the longest, until its record has many segments. Then it dies.
void make_long_outage(Scenario& scenario, Random& random, bool is_longest) {
  scenario.robots.resize(1);
  RobotSetup& robot = scenario.robots.front();
  robot.fps = 100;
  robot.policy = random.one_in(2) ? "drop-oldest" : "uniform";
  robot.has_spool = robot.has_large_images = robot.has_small_disk = false;
  robot.has_drop_log = is_longest || random.below(8) != 0;
  robot.path.bytes_per_second = 3e6;
  Fault outage;
  outage.at = 10 * kSecond;
  outage.machine = 1;
  outage.length = is_longest ? random.between(2600 * kSecond, 3000 * kSecond)
                             : draw_length(random, 240 * kSecond, 600 * kSecond);
  scenario.length = outage.at + outage.length + 60 * kSecond;
  scenario.faults = {outage};
  if (!is_longest && random.one_in(4)) return;
  Fault death;
  death.machine = 1;
  death.kind = random.one_in(2) ? FaultKind::kKill : FaultKind::kPowerCut;
  death.at = outage.at + outage.length - random.between(0, 20 * kSecond);
  draw_value(death, random, scenario);
  scenario.faults.push_back(death);
}

/// Some minutes at the rate of a camera, over a usual link: outages of seconds, of which the robot
/// does not survive each one.
void make_outages(Scenario& scenario, Random& random) {
  scenario.robots.resize(1);
  RobotSetup& robot = scenario.robots.front();
  robot.fps = static_cast<double>(10 + random.below(21));
  robot.policy = random.one_in(2) ? "catch-up" : "uniform";
  robot.has_spool = random.one_in(2);
  robot.path.bytes_per_second = robot.fps * (robot.has_large_images ? 20000 : 2500) *
                                static_cast<double>(3 + random.below(10));
  robot.path.delay = draw_length(random, kMillisecond, 30 * kMillisecond);
  robot.path.jitter = 0;
  robot.path.queue = draw_length(random, 50 * kMillisecond, 200 * kMillisecond);
  scenario.faults.clear();
  scenario.length = 15 * kSecond;
  for (std::uint64_t i = 2 + random.below(4); i > 0; --i) {
    Fault outage;
    outage.at = scenario.length;
    outage.machine = 1;
    outage.length = draw_length(random, 2 * kSecond, 20 * kSecond);
    scenario.length += outage.length + random.between(10 * kSecond, 20 * kSecond);
    scenario.faults.push_back(outage);
    if (random.one_in(2)) continue;
    Fault death;
    death.machine = 1;
    death.kind = random.one_in(4) ? FaultKind::kPowerCut : FaultKind::kKill;
    death.at = outage.at + outage.length - random.between(0, 2 * kSecond);
    death.length = draw_length(random, 100 * kMillisecond, 5 * kSecond);
    scenario.faults.push_back(death);
  }
}

/// Robots without a clock of their own that lose their power again and again.
void make_many_starts(Scenario& scenario, Random& random) {
  for (RobotSetup& robot : scenario.robots) robot.has_no_clock = true;
  for (std::size_t i = 0; i < scenario.robots.size(); ++i) {
    Fault row;
    row.machine = static_cast<int>(i + 1);
    row.at = random.between(kSecond, 10 * kSecond);
    row.kind = FaultKind::kDieInARow;
    row.value = 100 + random.below(200);
    row.length = random.between(100 * kMillisecond, kSecond);
    scenario.length =
        std::max(scenario.length, row.at + static_cast<Time>(row.value) * 4 * kSecond);
    scenario.faults.push_back(row);
  }
}

RobotSetup draw_robot_of_servers(Random& random, const Scenario& scenario) {
  RobotSetup robot = draw_robot(random, scenario.length);
  std::vector<int> all;
  for (int i = 0; i < scenario.servers; ++i) all.push_back(scenario.server(i));
  robot.servers.clear();
  const std::size_t known = random.one_in(6) ? 1 : 1 + random.below(all.size());
  while (robot.servers.size() < known) {
    const auto one = all.begin() + static_cast<std::ptrdiff_t>(random.below(all.size()));
    robot.servers.push_back(*one);
    all.erase(one);
  }
  return robot;
}

int draw_server(Random& random, const Scenario& scenario) {
  return scenario.server(
      static_cast<int>(random.below(static_cast<std::uint64_t>(scenario.servers))));
}

Fault draw_fault_of_server(Random& random, const Scenario& scenario) {
  constexpr std::array kKinds = {
      FaultKind::kKill,        FaultKind::kKill,           FaultKind::kPowerCut,
      FaultKind::kKillAtCall,  FaultKind::kPowerCutAtCall, FaultKind::kFreeze,
      FaultKind::kFreeze,      FaultKind::kStop,           FaultKind::kDieInARow,
      FaultKind::kHangingSync, FaultKind::kCutFrom,        FaultKind::kCutFrom,
      FaultKind::kCutOneWay,   FaultKind::kCutOneWay,      FaultKind::kClockStep};
  Fault fault;
  fault.machine = draw_server(random, scenario);
  fault.kind = kKinds[random.below(kKinds.size())];
  fault.length = draw_length(random, 200 * kMillisecond, 40 * kSecond);
  draw_value(fault, random, scenario);
  if (fault.kind == FaultKind::kDieInARow) fault.value = 2 + random.below(8);
  if (fault.kind != FaultKind::kCutFrom && fault.kind != FaultKind::kCutOneWay) return fault;
  const int other = static_cast<int>(1 + random.below(scenario.robots.size()));
  fault.value = static_cast<std::uint64_t>(other);
  if (fault.kind == FaultKind::kCutOneWay && random.one_in(2)) {
    fault.value = static_cast<std::uint64_t>(std::exchange(fault.machine, other));
  }
  return fault;
}

Fault draw_fault_of_servers(Random& random, const Scenario& scenario) {
  Fault fault;
  switch (random.below(8)) {
    case 0:
    case 1:
      do {
        fault = draw_fault(random, scenario);
      } while (!scenario.is_robot(fault.machine) || fault.kind == FaultKind::kVisit);
      fault.length = std::min(fault.length, 60 * kSecond);
      break;
    default:
      fault = draw_fault_of_server(random, scenario);
  }
  fault.at = random.between(kSecond, scenario.length);
  return fault;
}

/// Half of them while the session is at another server, or goes there.
void add_bad_disk_of_servers(Scenario& scenario, Random& random) {
  constexpr std::array kKinds = {FaultKind::kSlowDisk, FaultKind::kFailingDisk,
                                 FaultKind::kFullDisk};
  Fault fault;
  fault.machine = draw_server(random, scenario);
  fault.kind = kKinds[random.below(kKinds.size())];
  fault.length = draw_length(random, kSecond, 40 * kSecond);
  const Fault& other = scenario.faults[random.below(scenario.faults.size())];
  const Time near = other.at + random.between(-20 * kSecond, 20 * kSecond);
  fault.at = random.one_in(2) ? random.between(kSecond, scenario.length)
                              : std::clamp(near, kSecond, scenario.length);
  scenario.faults.push_back(fault);
}

/// Faults of what servers share, and several at a time.
void make_servers(Scenario& scenario, Random& random) {
  scenario.sync = "ack";
  scenario.length = draw_length(random, 60 * kSecond, 1200 * kSecond);
  for (RobotSetup& robot : scenario.robots) robot = draw_robot_of_servers(random, scenario);
  scenario.faults.clear();
  const auto minutes = static_cast<std::uint64_t>(scenario.length / (60 * kSecond));
  for (std::uint64_t i = 2 + random.below(4 + 2 * minutes); i > 0; --i) {
    Fault fault = draw_fault_of_servers(random, scenario);
    if (!scenario.faults.empty() && random.one_in(2)) {  // more at a time
      const Fault& other = scenario.faults[random.below(scenario.faults.size())];
      const Time until = random.one_in(3) ? kSecond : other.length + 5 * kSecond;
      fault.at = std::clamp(other.at + random.between(-kSecond, until), kSecond, scenario.length);
    }
    scenario.faults.push_back(fault);
  }
  const bool has_bad_disks = scenario.seed % 40 == 11 || scenario.seed % 40 == 21;
  for (std::uint64_t i = has_bad_disks ? 1 + random.below(3) : 0; i > 0; --i)
    add_bad_disk_of_servers(scenario, random);
}

}  // namespace

std::string_view to_string(FaultKind kind) { return kNames[static_cast<std::size_t>(kind)]; }

std::string Scenario::name_of(int machine) const {
  if (is_robot(machine)) return fmt::format("robot{}", machine);
  if (machine >= machines()) return "stranger";
  if (!has_several()) return "server";
  return fmt::format("server{}", machine == kServer ? 1 : machine - robots_end() + 2);
}

std::string to_string(const Fault& fault, const Scenario& scenario) {
  const bool has_other = fault.kind == FaultKind::kCutFrom || fault.kind == FaultKind::kCutOneWay;
  const auto value = static_cast<std::int64_t>(fault.value);
  return fmt::format("{:.3f} s: {} of {}, {:.3f} s, {} {}", static_cast<double>(fault.at) / 1e9,
                     to_string(fault.kind), scenario.name_of(fault.machine),
                     static_cast<double>(fault.length) / 1e9, has_other ? "other" : "value",
                     has_other ? scenario.name_of(static_cast<int>(value)) : std::to_string(value));
}

Scenario draw_scenario(std::uint64_t seed) {
  Random random{Random{seed}.next()};  // far from those of the seeds beside it
  Scenario scenario;
  scenario.seed = seed;
  scenario.length = draw_length(random, 60 * kSecond, 72 * 3600 * kSecond);
  if (random.one_in(4)) scenario.sync = "1 s";
  scenario.sync_time = draw_length(random, 100 * kMicrosecond, 30 * kMillisecond);
  const std::uint64_t robots = 1 + random.below(3);
  for (std::uint64_t i = 0; i < robots; ++i)
    scenario.robots.push_back(draw_robot(random, scenario.length));
  const std::uint64_t faults =
      2 + random.below(
              3 + static_cast<std::uint64_t>(std::min(scenario.length / (60 * kSecond), Time{20})));
  for (std::uint64_t i = 0; i < faults; ++i) {
    Fault fault = draw_fault(random, scenario);
    if (!scenario.faults.empty() && random.one_in(2)) keep_company(fault, random, scenario);
    scenario.faults.push_back(fault);
    if (random.one_in(3)) add_death_in_outage(scenario, random);
    if (random.one_in(6)) add_death_of_server(scenario, random);
  }
  if (random.one_in(4)) add_stall_of_server(scenario, random);
  if (random.one_in(2)) add_stranger(scenario, random);
  if (scenario.sync != "ack") add_power_cut_of_server(scenario, random);
  // Seeds in a row have some of each kind. The longest costs most.
  const std::uint64_t kind = seed % 60;
  if (kind % 20 == 0) {
    make_long_outage(scenario, random, seed % 120 == 0);
  } else if (kind % 20 == 7) {
    make_many_starts(scenario, random);
  } else if (kind % 5 == 3) {
    make_outages(scenario, random);
  } else if (kind % 10 == 1) {
    make_servers(scenario, random);
  }
  std::sort(scenario.faults.begin(), scenario.faults.end(),
            [](const Fault& a, const Fault& b) { return a.at < b.at; });
  return scenario;
}

std::string to_string(const Scenario& scenario) {
  auto text =
      fmt::format("seed {}: {:.0f} s, {} robots, sync {}{}\n", scenario.seed,
                  static_cast<double>(scenario.length) / 1e9, scenario.robots.size(), scenario.sync,
                  scenario.has_several() ? fmt::format(", {} servers", scenario.servers) : "");
  for (std::size_t i = 0; i < scenario.robots.size(); ++i) {
    const RobotSetup& robot = scenario.robots[i];
    text += fmt::format(
        "  robot{}: {} fps, {}, spool {}, drop log {}, {} images, {} disk, {:.0f} B/s, "
        "{:.1f} ms, queue {:.0f} ms\n",
        i + 1, robot.fps, robot.policy, robot.has_spool, robot.has_drop_log,
        robot.has_large_images ? "large" : "small",
        robot.has_no_clock     ? "no clock, large"
        : robot.has_small_disk ? "small"
                               : "large",
        robot.path.bytes_per_second, static_cast<double>(robot.path.delay) / 1e6,
        static_cast<double>(robot.path.queue) / 1e6);
    if (!scenario.has_several()) continue;
    text += "    knows";
    for (const int server : robot.servers) text += " " + scenario.name_of(server);
    text += '\n';
  }
  for (std::size_t i = 0; i < scenario.faults.size(); ++i) {
    text += fmt::format("  fault {} at {}\n", i, to_string(scenario.faults[i], scenario));
  }
  return text;
}

}  // namespace orbbuf::simulation
