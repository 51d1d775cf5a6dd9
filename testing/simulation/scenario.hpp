// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "testing/simulation/world.hpp"

/// What a seed stands for: machines, and what goes wrong.
namespace orbbuf::simulation {

inline constexpr std::uint64_t kBufferBytes = 1 << 20;
inline constexpr int kServer = 0;  ///< its machine; the robots follow, then other servers

enum class FaultKind : std::uint8_t {
  kCut,  ///< of the link, both ways
  kCutToServer,
  kCutToRobot,
  kNewAddress,  ///< the robot's connections are dead, without a word
  kSlowLink,    ///< value: bytes a second
  kLongWay,     ///< value: ns, one way
  kLoss,        ///< value: one segment in so many
  kKill,        ///< as -9; it starts again after `length`
  kKillAtCall,  ///< likewise, at that system call from then on
  kDieInARow,   ///< value: so many times, each after at most 5 s
  kPowerCut,
  kPowerCutAtCall,
  kStop,  ///< as SIGTERM
  kFreeze,
  kSlowDisk,
  kHangingSync,  ///< writes go on
  kFailingDisk,
  kFullDisk,
  kClockStep,  ///< value: seconds, as a signed number
  kImpostor,   ///< in the server's place for `length`; value: what it answers
  kVisit,      ///< by a stranger that says it is that robot; value: what it does
  kCutFrom,    ///< of a machine; value: the other one, nothing gets through
  kCutOneWay,  ///< likewise, what it sends the other one
};
inline constexpr int kFaultKinds = 23;
std::string_view to_string(FaultKind kind);

struct Fault {
  Time at = 0;
  FaultKind kind = FaultKind::kCut;
  int machine = kServer;
  Time length = 0;
  std::uint64_t value = 0;
};

struct RobotSetup {
  double fps = 5;
  std::string policy = "catch-up";
  bool has_spool = false;
  bool has_drop_log = false;
  bool has_large_images = false;
  bool has_small_disk = false;
  bool has_no_clock = false;  ///< each start after a power cut begins at the same time
  Path path;
  std::vector<int> servers{kServer};  ///< those that it knows, in that order

  bool has_record() const { return has_spool || has_drop_log; }
};

struct Scenario {
  std::uint64_t seed = 0;
  Time length = 0;  ///< of the time with faults
  std::string sync = "ack";
  Time sync_time = 0;
  std::vector<RobotSetup> robots;
  std::vector<Fault> faults;
  int servers = 1;

  bool has_several() const { return servers > 1; }  ///< servers
  int robots_end() const { return static_cast<int>(robots.size()) + 1; }
  bool is_robot(int machine) const { return machine > kServer && machine < robots_end(); }
  int server(int number) const { return number == 0 ? kServer : robots_end() + number - 1; }
  bool is_server(int machine) const {
    return machine == kServer || (machine >= robots_end() && machine < server(servers));
  }
  int machines() const { return server(servers); }
  std::string name_of(int machine) const;
};
std::string to_string(const Fault& fault, const Scenario& scenario);

Scenario draw_scenario(std::uint64_t seed);
std::string to_string(const Scenario& scenario);

}  // namespace orbbuf::simulation
