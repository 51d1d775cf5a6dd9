// SPDX-License-Identifier: Apache-2.0
#include "server/http/foxglove_protocol.hpp"

#include <openssl/evp.h>

#include <boost/endian/conversion.hpp>
#include <nlohmann/json.hpp>

namespace orbbuf::foxglove {
namespace {

using Json = nlohmann::json;

/// Ids are the robots', texts ours; whatever is no UTF-8 in them is replaced.
std::string to_text(const Json& message) {
  return message.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string base64(std::string_view bytes) {
  std::string text((bytes.size() + 2) / 3 * 4 + 1, '\0');  // with the zero that OpenSSL adds
  ::EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                    reinterpret_cast<const unsigned char*>(bytes.data()),
                    static_cast<int>(bytes.size()));
  text.pop_back();
  return text;
}

/// Throws Json::exception if it is none.
std::uint32_t number(const Json& value) {
  const auto id = value.get<std::uint64_t>();
  if (!value.is_number_unsigned() || id > UINT32_MAX) {
    throw Json::out_of_range::create(401, "not a number of 32 bits: " + value.dump(), nullptr);
  }
  return static_cast<std::uint32_t>(id);
}

}  // namespace

std::string server_info() {
  return to_text({{"op", "serverInfo"},
                  {"name", "orbbuf-server " ORBBUF_VERSION},
                  {"capabilities", Json::array()},
                  {"supportedEncodings", Json::array()},
                  {"metadata", Json::object()}});
}

std::string advertise(std::span<const LiveChannel> channels) {
  auto list = Json::array();
  for (const LiveChannel& channel : channels) {
    const bool is_json = channel.encoding == "json";
    list.push_back({{"id", channel.id},
                    {"topic", channel.topic},
                    {"encoding", channel.encoding},
                    {"schemaName", channel.schema_name},
                    {"schema", is_json ? channel.schema : base64(channel.schema)},
                    {"schemaEncoding", is_json ? "jsonschema" : "protobuf"}});
  }
  return to_text({{"op", "advertise"}, {"channels", std::move(list)}});
}

std::string unadvertise(std::span<const std::uint32_t> channel_ids) {
  return to_text(
      {{"op", "unadvertise"}, {"channelIds", std::vector(channel_ids.begin(), channel_ids.end())}});
}

std::string status(StatusLevel level, std::string_view text, std::string_view id) {
  return to_text(
      {{"op", "status"}, {"level", static_cast<int>(level)}, {"message", text}, {"id", id}});
}

std::array<std::uint8_t, kMessageHeadBytes> message_head(std::uint32_t subscription_id,
                                                         std::uint64_t log_time_ns) {
  std::array<std::uint8_t, kMessageHeadBytes> head{};
  head[0] = 1;
  boost::endian::store_little_u32(&head[1], subscription_id);
  boost::endian::store_little_u64(&head[5], log_time_ns);
  return head;
}

std::variant<Subscribe, Unsubscribe, NotUnderstood> parse_request(std::string_view text) {
  try {
    const auto request = Json::parse(text);
    const auto& op = request.at("op").get_ref<const std::string&>();
    if (op == "subscribe") {
      Subscribe subscribe;
      for (const Json& item : request.at("subscriptions")) {
        subscribe.push_back({number(item.at("id")), number(item.at("channelId"))});
      }
      return subscribe;
    }
    if (op == "unsubscribe") {
      Unsubscribe unsubscribe;
      for (const Json& id : request.at("subscriptionIds")) unsubscribe.push_back(number(id));
      return unsubscribe;
    }
    return "this server only publishes: it does not know the operation \"" + op + "\"";
  } catch (const Json::exception& error) {
    return std::string("not a message of Foxglove's WebSocket protocol: ") + error.what();
  }
}

}  // namespace orbbuf::foxglove
