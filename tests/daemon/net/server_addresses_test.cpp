// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_addresses.hpp"

#include <gtest/gtest.h>
#include <net/if.h>

#include <boost/asio/ip/address.hpp>
#include <string>

namespace orbbuf {
namespace {

using Endpoint = ServerAddresses::Endpoint;

Endpoint at(const std::string& address) { return {boost::asio::ip::make_address(address), 7722}; }

/// The addresses of the next attempts, a word each.
std::string next(ServerAddresses& addresses, int count) {
  std::string words;
  for (int i = 0; i < count; ++i) words += addresses.next().address().to_string() + " ";
  return words;
}

TEST(ServerAddresses, NumericHostsNeedNoLookup) {
  for (const char* host : {"10.0.0.1", "::1", "fe80::1%lo"}) {
    ServerAddresses addresses({host, 7});
    EXPECT_TRUE(addresses.is_numeric()) << host;
    ASSERT_FALSE(addresses.is_empty()) << host;
    EXPECT_EQ(addresses.next().port(), 7) << host;
  }
}

TEST(ServerAddresses, AScopeIsLookedForWithEachAttempt) {
  ServerAddresses addresses({"fe80::1%lo", 7});
  EXPECT_EQ(addresses.next().address().to_v6().scope_id(), ::if_nametoindex("lo"));
}

TEST(ServerAddresses, ANameHasNoAddressUntilItIsLookedUp) {
  ServerAddresses addresses({"slam.local", 7722});
  EXPECT_FALSE(addresses.is_numeric());
  EXPECT_TRUE(addresses.is_empty());
  EXPECT_TRUE(addresses.found({at("10.0.0.1")}));
  EXPECT_EQ(next(addresses, 2), "10.0.0.1 10.0.0.1 ");
}

TEST(ServerAddresses, EachAddressHasItsTurn) {
  ServerAddresses addresses({"slam", 7722});
  addresses.found({at("fd00::1"), at("10.0.0.1")});
  EXPECT_EQ(next(addresses, 4), "fd00::1 10.0.0.1 fd00::1 10.0.0.1 ");
}

TEST(ServerAddresses, TheGoodAddressIsFirstAndHasThreeTurnsOfFour) {
  ServerAddresses addresses({"slam", 7722});
  addresses.found({at("fd00::1"), at("10.0.0.1")});
  addresses.welcomed_at(at("10.0.0.1"));
  EXPECT_EQ(next(addresses, 5), "10.0.0.1 10.0.0.1 10.0.0.1 fd00::1 10.0.0.1 ");
}

TEST(ServerAddresses, ALookupThatFindsTheSameIsNoNews) {
  ServerAddresses addresses({"slam", 7722});
  addresses.found({at("10.0.0.1"), at("10.0.0.2")});
  EXPECT_FALSE(addresses.found({at("10.0.0.2"), at("10.0.0.1")}));
}

TEST(ServerAddresses, ANewAddressIsNextAndTheGoodOneIsKept) {
  ServerAddresses addresses({"slam", 7722});
  addresses.found({at("10.0.0.1")});
  addresses.welcomed_at(at("10.0.0.1"));
  EXPECT_TRUE(addresses.found({at("10.0.0.9")}));
  EXPECT_EQ(next(addresses, 5), "10.0.0.9 10.0.0.1 10.0.0.1 10.0.0.1 10.0.0.1 ");
  addresses.welcomed_at(at("10.0.0.9"));
  EXPECT_TRUE(addresses.found({at("10.0.0.8")}));
  EXPECT_EQ(next(addresses, 4), "10.0.0.8 10.0.0.9 10.0.0.9 10.0.0.9 ");
}

}  // namespace
}  // namespace orbbuf
