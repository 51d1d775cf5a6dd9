// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/run.hpp"

#include <signal.h>

#include <algorithm>
#include <utility>

#include "testing/simulation/network.hpp"

namespace orbbuf::simulation {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kLargeDisk = 1ULL << 40;
constexpr std::uint64_t kSmallDisk = 6 << 20;
constexpr double kFewFrames = 10;  // of a stream that is reduced some always wait
constexpr Time kLongestEnd = 60 * kSecond;
constexpr Time kLongestWay = 3 * kSecond;  // with its queue; what robots wrote last comes
constexpr std::size_t kMostForged = 8;     // frames of a visit

const Path kWire{
    .delay = 300 * kMicrosecond, .jitter = 200 * kMicrosecond, .bytes_per_second = 1e8};

/// Those of a session whose images are on the server's disk, from the oldest on, at most so many.
std::vector<std::string> recorded(const SessionFacts& facts, const fs::path& folder,
                                  std::uint64_t most) {
  std::vector<std::string> numbers;
  std::error_code none;
  for (const auto& image : fs::directory_iterator(folder / facts.id.data() / "images", none)) {
    const std::string number = image.path().stem().string();
    if (number.find_first_not_of("0123456789") == std::string::npos) numbers.push_back(number);
  }
  std::sort(numbers.begin(), numbers.end());
  numbers.resize(std::min<std::uint64_t>(numbers.size(), most));
  return numbers;
}

std::string address_text(int number) { return fmt::format("10.0.{}.1", number); }

/// Until frames come again, of the slowest robot too.
Time settling_of(const Scenario& scenario) {
  double least = 1;
  for (const RobotSetup& robot : scenario.robots) least = std::min(least, robot.fps);
  return std::max(30 * kSecond, static_cast<Time>(2.5e9 / least));
}

}  // namespace

Run::Run(const Scenario& scenario, Programs& programs, const std::vector<Source>& sources)
    : scenario_(scenario),
      programs_(programs),
      sources_(sources),
      random_{scenario.seed ^ 0x5EEDU},
      settling_(settling_of(scenario)) {
  const auto give_name = [&scenario](int number) {
    const std::string name = scenario.name_of(number);
    name.copy(machine(number).name.data(), machine(number).name.size() - 1);
  };
  give_name(stranger());
  for (int i = 0; i < machines(); ++i) {
    give_name(i);
    devices_.push_back(std::make_unique<Device>(i));
    fs::create_directories(fs::path(world_folder) / folder_name(i));
    machine(i).disk.capacity = kLargeDisk;
    machine(i).disk.sync_time = scenario.sync_time;
    if (!scenario_.is_robot(i)) {
      world->paths[static_cast<std::size_t>(i)] = kWire;
      continue;
    }
    world->paths[static_cast<std::size_t>(i)] = setup_of(i).path;
    if (setup_of(i).has_small_disk) machine(i).disk.capacity = kSmallDisk;
  }
}

Program& Run::program_of(int number) {
  return scenario_.is_robot(number) ? programs_.robot : programs_.server;
}

const Source& Run::source_of(int number) const {
  return sources_[setup_of(number).has_large_images ? 1 : 0];
}

std::vector<std::string> Run::arguments_of_server(int number) const {
  return {"orbbuf-server",
          "--set",
          "listen.address=0.0.0.0:7722",
          "--set",
          "listen.insecure=true",
          "--set",
          "listen.max_frame=64 KiB",
          "--set",
          "status.socket=",
          "--set",
          "files.path=" + world_folder + "/" + folder_name(number) + "/data",
          "--set",
          "files.sync=" + scenario_.sync};
}

std::vector<std::string> Run::arguments_of(int number) const {
  const std::string folder = folder_name(number);
  if (scenario_.is_server(number)) return arguments_of_server(number);
  const RobotSetup& robot = setup_of(number);
  std::string servers;
  for (const int server : robot.servers) {
    servers += fmt::format("{}\"{}:7722\"", servers.empty() ? "" : ", ", address_text(server));
  }
  std::vector<std::string> all = {
      "orbbufd",
      "--set",
      fmt::format("robot.id=robot{}", number),
      "--set",
      "link.server=[" + servers + "]",
      "--set",
      "source.kind=folder",
      "--set",
      "source.path=" + world_folder + "/source/" + source_of(number).name,
      "--set",
      fmt::format("source.fps={:.3f}", robot.fps),
      "--set",
      "source.loop=true",
      "--set",
      "buffer.policy=" + robot.policy,
      "--set",
      "buffer.memory=1 MiB"};
  const std::string record = world_folder + "/" + folder + "/record";
  const auto set = [&all](std::string text) {
    all.emplace_back("--set");
    all.push_back(std::move(text));
  };
  set("buffer.drop_log=" + (robot.has_drop_log && !robot.has_spool ? record : ""));
  if (robot.has_spool) set("spool.path=" + record);
  if (robot.has_spool) set("spool.size=64 MiB");
  return all;
}

void Run::begin(int number) {
  if (machine(number).is_running || machine(number).pid != 0) return;
  if (number == kServer && has_impostor_) return;
  if (scenario_.is_robot(number)) {
    if (world->sessions_used == kMostSessions) return;
    if (setup_of(number).has_no_clock && !machine(number).is_on) {
      machine(number).clock_offset = -world->now;
    }
    machine(number).session = world->sessions_used;
    SessionFacts& facts = world->sessions[static_cast<std::size_t>(world->sessions_used++)];
    facts.machine = number;
    facts.start = machine(number).start;
    facts.fps = setup_of(number).fps;
    facts.began = world->now;
  }
  trace(number, "STARTS");
  program_of(number).start(number, arguments_of(number));
}

void Run::begin_later(int number, Time after_that) {
  const Time time = world->now + after_that;
  begins_[static_cast<std::size_t>(number)] = time;
  after(after_that, [this, number, time] {
    if (begins_[static_cast<std::size_t>(number)] == time) begin(number);
  });
}

void Run::die(int number, bool loses_power) {
  Machine& one = machine(number);
  if (one.pid == 0) return;
  ++world->deaths;
  if (scenario_.is_server(number)) {
    has_server_crashed_ = true;
    if (loses_power) server_power_cut_ = world->now;
  } else if (scenario_.is_robot(number)) {
    SessionFacts& facts = world->sessions[static_cast<std::size_t>(one.session)];
    facts.ended = world->now;
    facts.was_killed = !one.has_ended;
    facts.lost_power = loses_power;
  }
  trace_line(number, loses_power ? "LOSES POWER" : "IS KILLED");
  if (loses_power) {
    one.is_on = false;
    abandon_all(number);
  }
  program_of(number).kill(number);
  if (!loses_power) return;
  devices_[static_cast<std::size_t>(number)]->cut_power(random_);
  one.disk.slow_until = one.disk.syncs_hang_until = 0;
}

void Run::die_in_a_row(int number, std::uint64_t times, Time pause) {
  const bool has_no_clock = scenario_.is_robot(number) && setup_of(number).has_no_clock;
  die(number, has_no_clock || random_.one_in(4));
  begin_later(number, random_.between(kMillisecond, pause));
  if (times <= 1) return;
  after(pause + random_.between(10 * kMillisecond, 5 * kSecond),
        [this, number, times, pause] { die_in_a_row(number, times - 1, pause); });
}

void Run::signal(int number, int which) {
  Machine& one = machine(number);
  if (!one.is_running) return;
  one.signal = which;
  if (scenario_.is_robot(number)) ++world->sessions[static_cast<std::size_t>(one.session)].stops;
  wake_io(number);
}

void Run::look_after_machines() {
  for (int i = 0; i < machines(); ++i) {
    Machine& one = machine(i);
    if (one.is_dying) {
      one.is_dying = false;
      const auto place = static_cast<std::size_t>(i);
      die(i, dies_of_power_[place]);
      begin_later(i, pause_after_death_[place]);
    }
    if (one.has_ended && one.pid != 0) {
      trace(i, "ENDS with status {}", one.status);
      const bool is_crash = one.status >= 128;
      if (is_crash)
        problem(fmt::format("{} crashed: signal {}", one.name.data(), one.status - 128));
      if (scenario_.is_robot(i)) {
        world->sessions[static_cast<std::size_t>(one.session)].ended = world->now;
        if (is_crash) world->sessions[static_cast<std::size_t>(one.session)].was_killed = true;
      } else if (is_crash) {
        has_server_crashed_ = true;
      }
      program_of(i).kill(i);
      if (!is_ending_) begin_later(i, 2 * kSecond);  // RestartSec of the units
    }
    if (one.disk.log_used > kDiskLogBytes / 8) devices_[static_cast<std::size_t>(i)]->follow();
  }
  if (machine(stranger()).has_ended) end_stranger();
}

void Run::advance(Time until) {
  while (world->now < until || (!actions_.empty() && actions_.begin()->first <= world->now)) {
    look_after_machines();
    if (world->is_stuck) {
      world->is_stuck = false;
      problem("all threads wait, and nothing will happen");
      return;
    }
    while (!actions_.empty() && actions_.begin()->first <= world->now) {
      const auto what = std::move(actions_.begin()->second);
      actions_.erase(actions_.begin());
      what();
    }
    const Time next = actions_.empty() ? kNever : actions_.begin()->first;
    run_until(std::min(until, next));
  }
  look_after_machines();
}

void Run::set_down(int number, int direction, bool is_down) {
  int& count = downs_[static_cast<std::size_t>(number)][static_cast<std::size_t>(direction)];
  count += is_down ? 1 : -1;
  world->paths[static_cast<std::size_t>(number)].is_down[static_cast<std::size_t>(direction)] =
      count > 0;
}

void Run::cut_from(const Fault& fault) {
  const auto one = static_cast<std::size_t>(fault.machine);
  const auto other = static_cast<std::size_t>(fault.value);
  const bool is_both_ways = fault.kind == FaultKind::kCutFrom;
  const auto add = [one, other, is_both_ways](int count) {
    world->cuts[one][other] += count;
    if (is_both_ways) world->cuts[other][one] += count;
  };
  add(1);
  after(fault.length, [add] { add(-1); });
}

void Run::apply_to_link(const Fault& fault) {
  Path& path = world->paths[static_cast<std::size_t>(fault.machine)];
  const Path usual = setup_of(fault.machine).path;
  const int number = fault.machine;
  switch (fault.kind) {
    case FaultKind::kCut:
    case FaultKind::kCutToServer:
    case FaultKind::kCutToRobot:
      for (const int direction : {0, 1}) {
        if (fault.kind == FaultKind::kCutToServer && direction == 1) continue;
        if (fault.kind == FaultKind::kCutToRobot && direction == 0) continue;
        set_down(number, direction, true);
        after(fault.length, [this, number, direction] { set_down(number, direction, false); });
      }
      return;
    case FaultKind::kNewAddress:
      return change_address(number);
    case FaultKind::kSlowLink:
      path.bytes_per_second = std::max(500.0, static_cast<double>(fault.value));
      return after(fault.length,
                   [&path, usual] { path.bytes_per_second = usual.bytes_per_second; });
    case FaultKind::kLongWay:
      path.delay = static_cast<Time>(fault.value);
      return after(fault.length, [&path, usual] { path.delay = usual.delay; });
    case FaultKind::kLoss:
      path.loss_one_in = static_cast<std::uint32_t>(fault.value);
      return after(fault.length, [&path] { path.loss_one_in = 0; });
    default:
      return;
  }
}

void Run::apply_to_disk(const Fault& fault) {
  Disk& disk = machine(fault.machine).disk;
  if (fault.kind == FaultKind::kHangingSync) {  // until all is well again
    disk.syncs_hang_until = std::min(world->now + fault.length, scenario_.length);
  }
  if (fault.kind == FaultKind::kHangingSync && scenario_.is_server(fault.machine)) return;
  const auto place = static_cast<std::size_t>(fault.machine);
  bad_disk_until_[place] =
      std::max(bad_disk_until_[place], world->now + fault.length + 5 * kSecond);
  if (fault.kind == FaultKind::kSlowDisk) disk.slow_until = world->now + fault.length;
  if (fault.kind == FaultKind::kFailingDisk) disk.fails_until = world->now + fault.length;
  if (fault.kind != FaultKind::kFullDisk) return;
  const std::uint64_t usual = disk.capacity;
  disk.capacity = std::min(usual, disk.used + 4096);
  after(fault.length, [&disk] { disk.capacity = std::max(disk.capacity, kLargeDisk); });
}

void Run::start_stranger(std::vector<std::string> words) {
  words.insert(words.begin(), "orbbuf-stranger");
  programs_.stranger.start(stranger(), words);
}

void Run::end_stranger() {
  Machine& one = machine(stranger());
  if (one.pid == 0) return;
  if (one.has_ended && one.status != 0) problem(fmt::format("a stranger ended: {}", one.status));
  programs_.stranger.kill(stranger());
  one.has_ended = false;
}

void Run::take_servers_place(const Fault& fault) {
  constexpr std::array kAnswers = {"sent away", "sent away", "sent away", "sent away", "sent away",
                                   "refused",   "bye",       "beyond",    "garbage",   "silence"};
  end_stranger();
  die(kServer, false);
  has_impostor_ = true;
  start_stranger({"answer", kAnswers[fault.value % kAnswers.size()]});
  after(fault.length, [this] {
    end_stranger();
    has_impostor_ = false;
    begin(kServer);
  });
}

/// In the name of the robot and of its session, with other bytes for what is recorded of this one,
/// or of an earlier one. (Another session would end the robot's.)
void Run::visit(const Fault& fault) {
  constexpr std::array kDoings = {"late", "late", "live", "half", "garbage"};
  const std::string doing = kDoings[fault.value % kDoings.size()];
  if (machine(stranger()).pid != 0) return;
  const std::string robot = fmt::format("robot{}", fault.machine);
  const fs::path folder = fs::path(world_folder) / folder_name(kServer) / "data" / robot;
  std::vector<SessionFacts*> sessions;
  for (int i = 0; i < world->sessions_used; ++i) {
    SessionFacts& facts = world->sessions[static_cast<std::size_t>(i)];
    if (facts.machine == fault.machine && facts.id[0] != 0) sessions.push_back(&facts);
  }
  if (sessions.empty() || !machine(fault.machine).is_running) return;
  SessionFacts& facts =
      doing == "live" ? *sessions.back() : *sessions[random_.below(sessions.size())];
  const Source& other = sources_[setup_of(fault.machine).has_large_images ? 0 : 1];
  std::vector<std::string> words = {
      "visit",         doing,
      robot,           sessions.back()->id.data(),
      facts.id.data(), world_folder + "/source/" + other.name + "/000000.jpg"};
  // Those that a server may have lost its power with are not recorded for sure.
  const bool is_sure = scenario_.sync == "ack" || server_power_cut_ == 0;
  auto numbers = recorded(facts, folder, is_sure ? facts.acknowledged : 0);
  while (numbers.size() > kMostForged) {
    numbers.erase(numbers.begin() + static_cast<std::ptrdiff_t>(random_.below(numbers.size())));
  }
  words.insert(words.end(), numbers.begin(), numbers.end());
  facts.was_visited = true;
  start_stranger(std::move(words));
}

void Run::apply(const Fault& fault) {
  trace(-1, "FAULT {}", to_string(fault, scenario_));
  const auto place = static_cast<std::size_t>(fault.machine);
  Machine& one = machine(fault.machine);
  switch (fault.kind) {
    case FaultKind::kKill:
    case FaultKind::kPowerCut:
      die(fault.machine, fault.kind == FaultKind::kPowerCut);
      return begin_later(fault.machine, fault.length);
    case FaultKind::kKillAtCall:
    case FaultKind::kPowerCutAtCall:
      dies_of_power_[place] = fault.kind == FaultKind::kPowerCutAtCall;
      pause_after_death_[place] = fault.length;
      if (one.is_running) one.calls_until_death = static_cast<std::int64_t>(fault.value);
      return;
    case FaultKind::kDieInARow:
      return die_in_a_row(fault.machine, fault.value, fault.length);
    case FaultKind::kStop:
      return signal(fault.machine, SIGTERM);
    case FaultKind::kFreeze:
      one.frozen_until = std::max(one.frozen_until, world->now + fault.length);
      return;
    case FaultKind::kClockStep:
      one.clock_offset = static_cast<std::int64_t>(fault.value) * kSecond;
      return;
    case FaultKind::kImpostor:
      return take_servers_place(fault);
    case FaultKind::kVisit:
      return visit(fault);
    case FaultKind::kCutFrom:
    case FaultKind::kCutOneWay:
      return cut_from(fault);
    case FaultKind::kSlowDisk:
    case FaultKind::kHangingSync:
    case FaultKind::kFailingDisk:
    case FaultKind::kFullDisk:
      return apply_to_disk(fault);
    default:
      return apply_to_link(fault);
  }
}

void Run::heal() {
  trace(-1, "ALL IS WELL AGAIN");
  actions_.clear();
  downs_ = {};
  world->cuts = {};
  end_stranger();
  has_impostor_ = false;
  for (int i = 0; i < machines(); ++i) {
    Machine& one = machine(i);
    one.frozen_until = 0;
    one.calls_until_death = -1;
    one.disk.slow_until = one.disk.fails_until = one.disk.syncs_hang_until = 0;
    if (!scenario_.is_robot(i) || !setup_of(i).has_small_disk) one.disk.capacity = kLargeDisk;
    if (scenario_.is_robot(i)) {
      Path& path = world->paths[static_cast<std::size_t>(i)];
      path.is_down = {};
      path.loss_one_in = 0;
      path.delay = setup_of(i).path.delay;
      path.bytes_per_second = std::max(1e6, setup_of(i).path.bytes_per_second);
    }
    begin(i);
  }
}

const SessionFacts& Run::facts_of(int robot) const {
  return world->sessions[static_cast<std::size_t>(machine(robot).session)];
}

void Run::await_late_frames() {
  for (int i = 1; i < robots_end(); ++i) {
    // What is on its way for long is kept, too.
    const double few = kFewFrames + 2 * setup_of(i).path.way_s() * setup_of(i).fps;
    while (facts_of(i).spooled > 0) {
      const std::uint64_t before = facts_of(i).spooled;
      advance(world->now + settling_);
      if (facts_of(i).spooled < before) continue;
      if (static_cast<double>(before) < few) break;
      return problem(
          fmt::format("robot{}: {} kept frames do not come although all is well", i, before));
    }
  }
}

/// Those machines are told to.
void Run::await_end(int begin, int end) {
  for (int i = begin; i < end; ++i) signal(i, SIGTERM);
  const auto is_any_running = [begin, end] {
    for (int i = begin; i < end; ++i) {
      if (machine(i).is_running) return true;
    }
    return false;
  };
  const Time limit = world->now + kLongestEnd;
  while (is_any_running() && world->now < limit) advance(world->now + 100 * kMillisecond);
  for (int i = begin; i < end; ++i) {
    if (!machine(i).is_running) continue;
    problem(fmt::format("{} does not end", machine(i).name.data()));
    die(i, false);
  }
}

void Run::run() {
  const Time begun = world->now;
  begin(kServer);
  for (int i = robots_end(); i < machines(); ++i) begin(i);
  for (int i = 1; i < robots_end(); ++i) begin_later(i, random_.between(0, 3 * kSecond));
  for (const Fault& fault : scenario_.faults) at(begun + fault.at, [this, fault] { apply(fault); });
  advance(begun + scenario_.length);
  look_after_machines();
  // A server whose disk failed acknowledges nothing until it is started again.
  for (int i = 0; i < scenario_.servers; ++i) {
    if (has_bad_disk(scenario_.server(i))) die(scenario_.server(i), false);
  }
  heal();
  advance(world->now + settling_);
  std::array<std::uint64_t, kMostMachines> before{};
  for (int i = 1; i < robots_end(); ++i)
    before[static_cast<std::size_t>(i)] = facts_of(i).acknowledged;
  advance(world->now + settling_);
  for (int i = 1; i < robots_end(); ++i) {
    if (facts_of(i).acknowledged <= before[static_cast<std::size_t>(i)]) {
      problem(fmt::format("robot{}: no frame is acknowledged although all is well", i));
    }
  }
  await_late_frames();
  is_ending_ = true;
  await_end(1, robots_end());
  advance(world->now + kLongestWay);
  for (int i = 0; i < scenario_.servers; ++i) {
    await_end(scenario_.server(i), scenario_.server(i) + 1);
  }
  look_after_machines();
}

}  // namespace orbbuf::simulation
