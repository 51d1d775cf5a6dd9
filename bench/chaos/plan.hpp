// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace orbbuf::chaos {

enum class Action : std::uint8_t {
  kRate,          ///< of the link, `value` Mbit/s from now on
  kCut,           ///< every packet to the server is lost, until kMend
  kMend,          ///< ends kCut
  kReset,         ///< every packet to the server is answered by a TCP reset, until kEndReset
  kEndReset,      ///< ends kReset
  kKillServer,    ///< kill -9, until kStartServer
  kEndServer,     ///< SIGTERM, until kStartServer
  kStartServer,   ///< ends kKillServer and kEndServer
  kPauseServer,   ///< SIGSTOP: its sinks take nothing more, until kResumeServer
  kResumeServer,  ///< ends kPauseServer
  kKillRobot,     ///< kill -9 of robot `value`, and a new one at once: a new session
};

struct Step {
  double at_s;  ///< since the beginning
  Action action;
  double value;

  std::string text() const;
};

struct PlanSettings {
  std::uint64_t seed = 1;
  int events = 200;
  double longest_outage_s = 10;
  bool has_minute_outages = false;  ///< one outage in eight lasts 60 s
  std::size_t robots = 2;
  std::vector<double>
      rates;  ///< Mbit/s, one after the other as a link had them; empty: random ones
};

/// Every disturbance and its end, in the order of time; the same settings make the same plan. The
/// link is undisturbed and the server runs after the last step. An outage may fall into a server's
/// absence and the other way round; a robot may die at any time.
std::vector<Step> make_plan(const PlanSettings& settings);

/// The rates of all traces in a folder, Mbit/s: `bandwidth_kbps` of *.json, and mahimahi's *.up by
/// the second. Empty if there are none.
std::vector<double> read_rates(const std::filesystem::path& traces);

}  // namespace orbbuf::chaos
