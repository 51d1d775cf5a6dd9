// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "testing/simulation/disk.hpp"
#include "testing/simulation/programs.hpp"
#include "testing/simulation/scenario.hpp"

namespace orbbuf::simulation {

/// The images that all robots replay again and again: frame n of a session is the n-th of them.
struct Source {
  std::string name;
  std::vector<std::string> images;
  std::size_t giant = 0;  ///< the one that the server refuses for its size
};

struct Programs {
  /// Of a build folder.
  Programs(const std::filesystem::path& build, int memory, const std::vector<std::string>& emulator)
      : robot(build / "daemon/orbbufd", library(build), memory, emulator),
        server(build / "server/orbbuf-server", library(build), memory, emulator),
        stranger(build / "testing/simulation/orbbuf-stranger", library(build), memory, emulator) {}
  static std::filesystem::path library(const std::filesystem::path& build) {
    return build / "testing/simulation/liborbbuf-simulated.so";
  }

  Program robot;
  Program server;
  Program stranger;
};

/// A scenario from its first second until all machines have stopped in good order.
class Run {
 public:
  Run(const Scenario& scenario, Programs& programs, const std::vector<Source>& sources);

  void run();

  /// What is wrong by what was seen on the way.
  const std::vector<std::string>& problems() const { return problems_; }
  const Source& source_of(int machine) const;
  bool has_server_crashed() const { return has_server_crashed_; }
  /// The last one; 0: none.
  Time server_power_cut() const { return server_power_cut_; }
  /// Until then it did not do what it should; 0: it always did.
  Time bad_disk_until(int machine) const {
    return bad_disk_until_[static_cast<std::size_t>(machine)];
  }
  bool has_bad_disk(int machine) const { return bad_disk_until(machine) > 0; }
  bool has_bad_server_disk() const {
    for (int i = 0; i < scenario_.servers; ++i) {
      if (has_bad_disk(scenario_.server(i))) return true;
    }
    return false;
  }

 private:
  void at(Time time, std::function<void()> what) { actions_.emplace(time, std::move(what)); }
  void after(Time time, std::function<void()> what) { at(world->now + time, std::move(what)); }
  void advance(Time until);
  void look_after_machines();
  void begin(int machine);
  void begin_later(int machine, Time after_that);
  void die(int machine, bool loses_power);
  void die_in_a_row(int machine, std::uint64_t times, Time pause);
  void signal(int machine, int signal);
  void apply(const Fault& fault);
  void apply_to_link(const Fault& fault);
  void cut_from(const Fault& fault);
  void apply_to_disk(const Fault& fault);
  void take_servers_place(const Fault& fault);
  void visit(const Fault& fault);
  void start_stranger(std::vector<std::string> words);
  void end_stranger();
  void heal();
  void await_late_frames();
  const SessionFacts& facts_of(int robot) const;
  void set_down(int machine, int direction, bool is_down);
  void await_end(int begin, int end);
  std::vector<std::string> arguments_of(int machine) const;
  std::vector<std::string> arguments_of_server(int machine) const;
  Program& program_of(int machine);
  const RobotSetup& setup_of(int robot) const {
    return scenario_.robots[static_cast<std::size_t>(robot - 1)];
  }
  int stranger() const { return machines(); }  ///< its machine
  int machines() const { return scenario_.machines(); }
  int robots_end() const { return scenario_.robots_end(); }
  void problem(std::string text) { problems_.push_back(std::move(text)); }

  const Scenario& scenario_;
  Programs& programs_;
  const std::vector<Source>& sources_;
  Random random_;
  const Time settling_;  ///< after the last fault
  std::multimap<Time, std::function<void()>> actions_;
  std::vector<std::unique_ptr<Device>> devices_;
  std::array<std::array<int, 2>, kMostMachines> downs_{};
  std::array<bool, kMostMachines> dies_of_power_{};
  std::array<Time, kMostMachines> pause_after_death_{};
  std::array<Time, kMostMachines> begins_{};  // the last time that was told
  std::array<Time, kMostMachines> bad_disk_until_{};
  bool has_server_crashed_ = false;
  Time server_power_cut_ = 0;
  bool is_ending_ = false;
  bool has_impostor_ = false;
  std::vector<std::string> problems_;
};

}  // namespace orbbuf::simulation
