// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <boost/asio/executor_work_guard.hpp>
#include <optional>

#include "daemon/net/server_addresses.hpp"

namespace orbbuf {
namespace {

/// What a lookup of `host` finds, in the context's thread.
Result<NameLookup::Endpoints> look_up(const std::string& host) {
  boost::asio::io_context io;
  const auto work = boost::asio::make_work_guard(io);
  std::optional<Result<NameLookup::Endpoints>> found;
  NameLookup lookup(io, [&](const Address& server, const auto& endpoints) {
    EXPECT_EQ(server, (Address{host, 7722}));
    found = endpoints;
    io.stop();
  });
  lookup.start({host, 7722});
  io.run();
  return *found;
}

TEST(NameLookup, FindsTheAddressesOfAName) {
  const auto found = look_up("localhost");
  ASSERT_TRUE(found) << found.error().text;
  for (const auto& endpoint : found.value()) {
    EXPECT_TRUE(endpoint.address().is_loopback());
    EXPECT_EQ(endpoint.port(), 7722);
  }
}

TEST(NameLookup, SaysWhichNameHasNone) {
  const auto found = look_up("no-such-host.invalid");
  ASSERT_FALSE(found);
  EXPECT_NE(found.error().text.find("cannot resolve no-such-host.invalid: "), std::string::npos)
      << found.error().text;
}

TEST(NameLookup, EndsInTheMiddleOfALookup) {
  boost::asio::io_context io;
  {
    NameLookup lookup(io, [](const auto&, const auto&) { FAIL() << "it is gone"; });
    for (int i = 0; i < 10; ++i) lookup.start({"localhost", 7722});
  }
  io.run();
}

}  // namespace
}  // namespace orbbuf
