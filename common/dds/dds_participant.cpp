// SPDX-License-Identifier: Apache-2.0
#include "common/dds/dds_participant.hpp"

#include <dds/dds.h>
#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>

#include "common/log.hpp"

namespace orbbuf {
namespace {

/// Cyclone has a writer wait while readers lack so many bytes; the depths are the limit here. With
/// that much a reader is asked what it has only after a pause of this interval, which a camera at
/// 25 Hz never made with the default of 100 ms. And it sends by multicast what several readers
/// want: then what is sent again for a slow one costs a good one images, which come again 0.1 s
/// later.
constexpr std::string_view kApartConfig =
    "<Internal><Watermarks><WhcHigh>1GB</WhcHigh><WhcHighInit>1GB</WhcHighInit></Watermarks>"
    "<HeartbeatInterval>5ms</HeartbeatInterval>"
    "</Internal><General><AllowMulticast>spdp</AllowMulticast></General>";

constexpr std::chrono::seconds kFarewell{5};

dds_domainid_t configured_domain_id() {
  const char* text = std::getenv("ROS_DOMAIN_ID");
  if (text == nullptr || *text == '\0') return 0;
  constexpr dds_domainid_t kMost = 232;  // beyond, its ports are above 65535
  const std::string_view digits(text);
  dds_domainid_t id = 0;
  const auto [end, failed] = std::from_chars(digits.begin(), digits.end(), id);
  if (failed != std::errc() || end != digits.end() || id > kMost) {
    throw std::runtime_error(
        fmt::format("dds: ROS_DOMAIN_ID is \"{}\"; set a number from 0 to {}", text, kMost));
  }
  return id;
}

std::vector<dds_entity_t> children_of(dds_entity_t entity) {
  std::vector<dds_entity_t> children(
      static_cast<std::size_t>(std::max(dds_get_children(entity, nullptr, 0), 0)));
  if (!children.empty()) dds_get_children(entity, children.data(), children.size());
  return children;
}

}  // namespace

std::vector<int> writers_of(int participant) {
  std::vector<int> writers;
  for (const dds_entity_t publisher : children_of(participant)) {
    for (const dds_entity_t each : children_of(publisher)) {
      if (dds_get_publisher(each) == publisher) writers.push_back(each);
    }
  }
  return writers;
}

int require_dds(int entity, std::string_view attempt) {
  if (entity >= 0) return entity;
  throw std::runtime_error(fmt::format("dds: cannot {}: {}", attempt, dds_strretcode(-entity)));
}

DdsParticipant::DdsParticipant() : domain_id_(configured_domain_id()) {
  constexpr std::string_view kAttempt =
      "join the domain (see CYCLONEDDS_URI and the network interfaces)";
  const char* const uri = std::getenv("CYCLONEDDS_URI");
  const std::string config = fmt::format("{},{}", kApartConfig, uri != nullptr ? uri : "");
  domain_ = require_dds(dds_create_domain(domain_id_, config.c_str()), kAttempt);
  entity_ = dds_create_participant(domain_id_, nullptr, nullptr);
  if (entity_ < 0) dds_delete(domain_);
  require_dds(entity_, kAttempt);
}

std::shared_ptr<const DdsParticipant> DdsParticipant::shared() {
  static std::weak_ptr<const DdsParticipant> known;
  auto participant = known.lock();
  if (!participant) known = participant = std::make_shared<const DdsParticipant>();
  return participant;
}

/// Without the network that it used, Cyclone does not return.
DdsParticipant::~DdsParticipant() {
  const auto left = std::make_shared<std::promise<void>>();
  std::thread([left, domain = domain_] {
    dds_delete(domain);
    left->set_value();
  }).detach();
  if (left->get_future().wait_for(kFarewell) == std::future_status::ready) return;
  log_warn(
      "dds: cannot leave the domain within {} s: the network interface is gone, or a reader "
      "does not answer",
      kFarewell.count());
}

}  // namespace orbbuf
