// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_interfaces.hpp"

#include <algorithm>
#include <utility>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

constexpr LinkInterfaces::Duration kProbeInterval = 1s;
constexpr LinkInterfaces::Duration kSteady = 1min;
constexpr LinkInterfaces::Duration kLongestPatience = 5min;

std::vector<std::string> at_least_one(std::vector<std::string> names) {
  if (names.empty()) names.emplace_back();
  return names;
}

}  // namespace

LinkInterfaces::LinkInterfaces(std::vector<std::string> names, Duration return_after)
    : names_(at_least_one(std::move(names))), return_after_(return_after) {}

const std::string& LinkInterfaces::next() {
  const std::string& name = names_[turn_];
  turn_ = (turn_ + 1) % names_.size();
  return name;
}

void LinkInterfaces::on_connected(const std::string& interface, Time now) {
  const std::size_t before = std::exchange(
      stream_, static_cast<std::size_t>(std::ranges::find(names_, interface) - names_.begin()));
  well_since_.reset();
  probe_time_ = now;
  is_answered_ = false;
  if (stream_ == before) return;
  if (stream_ == 0) {
    returned_ = now;
  } else if (before == 0) {
    if (returned_ && now - *returned_ < kSteady) return double_patience();
    patience_ = return_after_;
  }
}

bool LinkInterfaces::is_probe_due(Time now) const {
  return stream_ != 0 && now - probe_time_ >= kProbeInterval;
}

void LinkInterfaces::on_probe(Time now) {
  if (!is_answered_) well_since_.reset();
  is_answered_ = false;
  probe_time_ = now;
}

bool LinkInterfaces::on_answer(Time now) {
  is_answered_ = true;
  if (!well_since_) well_since_ = probe_time_;
  return now - *well_since_ >= patience_;
}

void LinkInterfaces::on_return_failed() {
  well_since_.reset();
  double_patience();
}

void LinkInterfaces::double_patience() {
  patience_ = std::max(patience_, std::min(2 * patience_, kLongestPatience));
}

}  // namespace orbbuf
