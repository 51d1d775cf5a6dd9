// SPDX-License-Identifier: Apache-2.0
#include "common/address.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

TEST(Address, NamesAndNumbersAreRead) {
  EXPECT_EQ(parse_address("robot.local:7722").value(), (Address{"robot.local", 7722}));
  EXPECT_EQ(parse_address("127.0.0.1:0").value(), (Address{"127.0.0.1", 0}));
  EXPECT_EQ(parse_address("[::1]:65535").value(), (Address{"::1", 65535}));
}

TEST(Address, WritingIsTheInverseOfReading) {
  for (const char* text : {"localhost:1", "[fe80::1%eth0]:7722", "10.0.0.1:7722"}) {
    EXPECT_EQ(to_string(parse_address(text).value()), text);
  }
}

TEST(Address, LoopbackIsWhatOnlyThisMachineReaches) {
  for (const char* host : {"127.0.0.1", "127.1.2.3", "::1", "localhost"}) {
    EXPECT_TRUE(is_loopback({host, 1})) << host;
  }
  for (const char* host : {"0.0.0.0", "::", "10.0.0.1", "128.0.0.1", "fe80::1", "127.0.0.1.evil"}) {
    EXPECT_FALSE(is_loopback({host, 1})) << host;
  }
}

TEST(Address, WhatIsWrongIsNamed) {
  const auto why = [](const char* text) { return parse_address(text).error().text; };
  EXPECT_EQ(why("localhost"), "expected HOST:PORT or [IPV6]:PORT, got \"localhost\": no port");
  EXPECT_NE(why("::1:7722").find("an IPv6 address needs brackets"), std::string::npos);
  EXPECT_NE(why(":7722").find("no host"), std::string::npos);
  for (const char* text : {"host:", "host:65536", "host:-1", "host:77x", "host: 1"}) {
    EXPECT_NE(why(text).find("not a number from 0 to 65535"), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace orbbuf
