// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

/// The messages of Foxglove's WebSocket protocol that this server speaks, as bytes
/// (https://github.com/foxglove/ws-protocol, docs/spec.md). Those of foxglove.websocket.v1 and of
/// foxglove.sdk.v1 are the same. Pure functions; reentrant.
namespace orbbuf::foxglove {

/// What a viewer may subscribe to.
struct LiveChannel {
  std::uint32_t id = 0;
  std::string topic;
  std::string_view encoding;  ///< `protobuf`, or `json`
  std::string_view schema_name;
  std::string schema;  ///< protobuf: a FileDescriptorSet; json: a JSON schema
};

enum class StatusLevel : std::uint8_t { kInfo = 0, kWarning = 1, kError = 2 };

std::string server_info();
/// `channels` may be a part of all.
std::string advertise(std::span<const LiveChannel> channels);
std::string unadvertise(std::span<const std::uint32_t> channel_ids);
/// id: a later status with the same id takes the place of this one.
std::string status(StatusLevel level, std::string_view text, std::string_view id);

/// What stands before a message's payload in its binary frame: opcode 1, the viewer's number of
/// the subscription, the log time.
inline constexpr std::size_t kMessageHeadBytes = 13;
std::array<std::uint8_t, kMessageHeadBytes> message_head(std::uint32_t subscription_id,
                                                         std::uint64_t log_time_ns);

struct Subscription {
  std::uint32_t id = 0;  ///< the viewer's choice
  std::uint32_t channel_id = 0;

  friend bool operator==(const Subscription&, const Subscription&) = default;
};
using Subscribe = std::vector<Subscription>;
using Unsubscribe = std::vector<std::uint32_t>;  ///< subscription ids
/// Why a viewer's message cannot be followed; for the viewer.
using NotUnderstood = std::string;

/// A text message of a viewer, whatever is in it.
std::variant<Subscribe, Unsubscribe, NotUnderstood> parse_request(std::string_view text);

}  // namespace orbbuf::foxglove
