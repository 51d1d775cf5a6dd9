// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fleet_keys.hpp"

#include <gtest/gtest.h>

namespace orbbuf::fleet {
namespace {

TEST(FleetKeys, ASessionsKeysLeadBackToIt) {
  const SessionName name{"tb3", "20260101-1"};
  EXPECT_EQ(name.owner_key(), "/orbbuf/session/tb3/20260101-1");
  EXPECT_EQ(session_of(name.owner_key()), name);
  EXPECT_EQ(session_of(name.position_key()), name);
  for (const char* const other :
       {"/orbbuf/session/tb3", "/orbbuf/session/../x", "/orbbuf/session/a/b/c", "/other/a/b"}) {
    EXPECT_FALSE(session_of(other)) << other;
  }
}

TEST(FleetKeys, ASegmentsFolderLeadsBackToIt) {
  EXPECT_EQ(folder_of("s", {"a", 1, {}}), "s");
  EXPECT_EQ(folder_of("s", {"a", 7, {}}), "s.e7");
  EXPECT_EQ(parse_folder("s").epoch, 1U);
  EXPECT_EQ(parse_folder("s.e7").epoch, 7U);
  EXPECT_EQ(parse_folder("s.e7").session_id, "s");
  for (const char* const whole : {"s.e", "s.e1", "s.e7x", ".e7", "s.e-7", "e7"}) {
    EXPECT_EQ(parse_folder(whole).session_id, whole);
  }
}

TEST(FleetKeys, ValuesAreReadAsTheyWereWritten) {
  const SessionOwner owner{"b", "0f", 3, {{"a", 1, {}}, {"b", 3, {1234567890123, 5}}}, true};
  EXPECT_EQ(owner_from(to_text(owner)), owner);
  const wire::Position position{7, 8};
  EXPECT_EQ(position_from(to_text(position)), position);
  const ServerEntry server{"a", "0f", "10.0.0.1:7722", "10.0.0.1:7780", 3, true};
  EXPECT_EQ(server_from(server.key(), to_text(server)), server);
}

TEST(FleetKeys, WhatCannotBeReadIsNothing) {
  for (const char* const text : {"", "{", "[]", "null", R"({"server":1})", R"({"epoch":"x"})"}) {
    EXPECT_FALSE(owner_from(text)) << text;
    EXPECT_FALSE(position_from(text)) << text;
    EXPECT_FALSE(server_from("/orbbuf/server/a", text)) << text;
  }
  EXPECT_FALSE(owner_from(to_text(SessionOwner{"a", "0", 1, {}, false})));  // without a segment
}

}  // namespace
}  // namespace orbbuf::fleet
