// SPDX-License-Identifier: Apache-2.0
#include "bench/chaos/plan.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <random>

namespace orbbuf::chaos {
namespace {

namespace fs = std::filesystem;

constexpr double kLowestMbit = 0.5;
constexpr double kHighestMbit = 50;
constexpr double kMinuteOutage = 60;

/// Draws one plan. std::*_distribution differ between libraries, hence our own.
class Planner {
 public:
  explicit Planner(const PlanSettings& settings)
      : settings_(settings),
        random_(settings.seed),
        rate_at_(settings.rates.empty() ? 0 : below(settings.rates.size())) {}

  std::vector<Step> plan() {
    for (int event = 0; event < settings_.events;) event += add_event() ? 1 : 0;
    std::ranges::stable_sort(steps_, {}, &Step::at_s);
    return std::move(steps_);
  }

 private:
  double uniform(double from, double to) {
    return from + (to - from) * static_cast<double>(random_() >> 11U) * 0x1.0p-53;
  }
  std::size_t below(std::size_t limit) { return random_() % limit; }
  double log_uniform(double from, double to) {
    return std::exp(uniform(std::log(from), std::log(to)));
  }

  /// From the recorded link, walking on; or any rate.
  double rate() {
    if (settings_.rates.empty()) return log_uniform(kLowestMbit, kHighestMbit);
    rate_at_ = (rate_at_ + 1 + below(10)) % settings_.rates.size();
    return std::clamp(settings_.rates[rate_at_], kLowestMbit, kHighestMbit);
  }

  double outage() {
    if (settings_.has_minute_outages && below(8) == 0) return kMinuteOutage;
    return log_uniform(0.2, settings_.longest_outage_s);
  }

  /// False if what was drawn cannot be at this moment.
  bool add_event() {
    const std::size_t kind = below(100);
    if (kind < 28) return add(Action::kRate, rate());
    if (kind < 50) return add_pair(Action::kCut, Action::kMend, outage(), link_free_);
    if (kind < 64) {
      return add_pair(Action::kReset, Action::kEndReset, log_uniform(0.02, 1), link_free_);
    }
    if (kind < 75) {
      return add_pair(Action::kKillServer, Action::kStartServer, log_uniform(0.01, 2),
                      server_free_);
    }
    if (kind < 80) {
      return add_pair(Action::kEndServer, Action::kStartServer, uniform(1, 2), server_free_);
    }
    if (kind < 92) {
      return add_pair(Action::kPauseServer, Action::kResumeServer, log_uniform(0.2, 4),
                      server_free_);
    }
    return add(Action::kKillRobot, static_cast<double>(below(settings_.robots)));
  }

  bool add(Action action, double value) {
    steps_.push_back({now_, action, value});
    now_ += gap();
    return true;
  }

  /// `free`: when the link, or the server, is itself again.
  bool add_pair(Action begin, Action end, double duration, double& free) {
    if (now_ < free) {
      now_ += gap();
      return false;
    }
    steps_.push_back({now_, begin, 0});
    steps_.push_back({now_ + duration, end, 0});
    // A moment longer: a step takes time to do.
    free = now_ + duration + 0.1;
    // What comes next mostly waits for the end of this, and sometimes strikes in the midst of it.
    now_ += (below(3) == 0 ? uniform(0, duration) : duration) + gap();
    return true;
  }

  double gap() { return uniform(0.05, 0.8); }

  const PlanSettings& settings_;
  std::mt19937_64 random_;
  std::size_t rate_at_;
  std::vector<Step> steps_;
  double now_ = 1;
  double link_free_ = 0;
  double server_free_ = 0;
};

/// One object a line, about a second each.
void read_json_rates(std::istream& in, std::vector<double>& rates) {
  constexpr std::string_view kKey = "\"bandwidth_kbps\":";
  for (std::string line; std::getline(in, line);) {
    const std::size_t at = line.find(kKey);
    if (at != std::string::npos) rates.push_back(std::stod(line.substr(at + kKey.size())) / 1000);
  }
}

/// One millisecond a line: when a packet of 1500 bytes could leave.
void read_mahimahi_rates(std::istream& in, std::vector<double>& rates) {
  constexpr double kPacketMbit = 1500 * 8e-6;
  std::vector<double> seconds;
  for (std::size_t ms = 0; in >> ms;) {
    if (ms / 1000 >= seconds.size()) seconds.resize(ms / 1000 + 1);
    seconds[ms / 1000] += kPacketMbit;
  }
  rates.insert(rates.end(), seconds.begin(), seconds.end());
}

}  // namespace

std::string Step::text() const {
  static constexpr std::array kNames{"rate",         "cut",           "mend",       "reset",
                                     "end reset",    "kill server",   "end server", "start server",
                                     "pause server", "resume server", "kill robot"};
  const std::string name = kNames.at(static_cast<std::size_t>(action));
  const bool has_value = action == Action::kRate || action == Action::kKillRobot;
  return fmt::format("{:8.3f} {}{}", at_s, name, has_value ? fmt::format(" {:.3g}", value) : "");
}

std::vector<Step> make_plan(const PlanSettings& settings) { return Planner(settings).plan(); }

std::vector<double> read_rates(const fs::path& traces) {
  std::vector<fs::path> files;
  std::error_code absent;
  for (const auto& entry : fs::recursive_directory_iterator(traces, absent)) {
    const auto extension = entry.path().extension();
    if (extension == ".json" || extension == ".up") files.push_back(entry.path());
  }
  std::ranges::sort(files);
  std::vector<double> rates;
  for (const fs::path& file : files) {
    std::ifstream in(file);
    file.extension() == ".up" ? read_mahimahi_rates(in, rates) : read_json_rates(in, rates);
  }
  return rates;
}

}  // namespace orbbuf::chaos
