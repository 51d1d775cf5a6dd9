// SPDX-License-Identifier: Apache-2.0
#include "server/http/foxglove_protocol.hpp"

#include <gmock/gmock.h>

namespace orbbuf::foxglove {
namespace {

using testing::HasSubstr;

TEST(FoxgloveProtocol, AProtobufSchemaIsBase64AndAJsonSchemaIsItself) {
  const std::array<LiveChannel, 2> channels = {
      LiveChannel{1, "/r/image", "protobuf", "a.B", std::string("\0\1\2\3", 4)},
      LiveChannel{7, "/r/drops", "json", "c.D", R"({"type":"object"})"}};
  EXPECT_EQ(advertise(channels),
            R"({"channels":[{"encoding":"protobuf","id":1,"schema":"AAECAw==",)"
            R"("schemaEncoding":"protobuf","schemaName":"a.B","topic":"/r/image"},)"
            R"({"encoding":"json","id":7,"schema":"{\"type\":\"object\"}",)"
            R"("schemaEncoding":"jsonschema","schemaName":"c.D","topic":"/r/drops"}],)"
            R"("op":"advertise"})");
}

TEST(FoxgloveProtocol, OtherMessagesAreAsTheSpecificationHasThem) {
  EXPECT_THAT(server_info(), HasSubstr(R"("capabilities":[],)"));
  EXPECT_THAT(server_info(), HasSubstr(R"("op":"serverInfo")"));
  EXPECT_EQ(unadvertise(std::array{3U, 4U}), R"({"channelIds":[3,4],"op":"unadvertise"})");
  EXPECT_EQ(status(StatusLevel::kWarning, "too \"slow\"\xff", "x"),
            "{\"id\":\"x\",\"level\":1,\"message\":\"too \\\"slow\\\"\uFFFD\",\"op\":\"status\"}");
}

TEST(FoxgloveProtocol, AMessageBeginsWithOpcodeSubscriptionAndTime) {
  const std::array<std::uint8_t, kMessageHeadBytes> head = {
      1, 4, 3, 2, 1, 0x18, 0x17, 0x16, 0x15, 0x14, 0x13, 0x12, 0x11};
  EXPECT_EQ(message_head(0x01020304, 0x1112131415161718), head);
}

TEST(FoxgloveProtocol, ReadsWhatAViewerAsksFor) {
  const auto subscribe =
      parse_request(R"({"op":"subscribe","subscriptions":[{"id":0,"channelId":4294967295}]})");
  EXPECT_EQ(std::get<Subscribe>(subscribe), (Subscribe{{0, 4294967295U}}));
  EXPECT_EQ(std::get<Unsubscribe>(parse_request(R"({"subscriptionIds":[3,2],"op":"unsubscribe"})")),
            (Unsubscribe{3, 2}));
}

TEST(FoxgloveProtocol, SaysWhatItDoesNotUnderstand) {
  EXPECT_THAT(std::get<NotUnderstood>(parse_request(R"({"op":"setParameters"})")),
              HasSubstr("\"setParameters\""));
  for (const char* text :
       {"", "{", "[]", "7", "{}", R"({"op":3})", R"({"op":"subscribe"})",
        R"({"op":"subscribe","subscriptions":[7]})", R"({"op":"subscribe","subscriptions":[{}]})",
        R"({"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]})",
        R"({"op":"subscribe","subscriptions":[{"id":1.5,"channelId":1}]})",
        R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":4294967296}]})",
        R"({"op":"unsubscribe","subscriptionIds":{"a":"b"}})", "\xff\xfe"}) {
    EXPECT_THAT(std::get<NotUnderstood>(parse_request(text)),
                HasSubstr("not a message of Foxglove's WebSocket protocol"))
        << text;
  }
}

TEST(FoxgloveProtocol, DeepNestingIsNoMessage) {
  const std::string deep = R"({"op":)" + std::string(60'000, '[');
  EXPECT_TRUE(std::holds_alternative<NotUnderstood>(parse_request(deep)));
}

}  // namespace
}  // namespace orbbuf::foxglove
