// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_addresses.hpp"

#include <gtest/gtest.h>
#include <net/if.h>

#include <boost/asio/ip/address.hpp>
#include <chrono>
#include <string>
#include <vector>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using Endpoint = ServerAddresses::Endpoint;

constexpr ServerAddresses::Time kNow{1h};
const Address kSlam{"slam", 7722};

Endpoint at(const std::string& address) { return {boost::asio::ip::make_address(address), 7722}; }

/// The addresses of the next attempts, a word each.
std::string next(ServerAddresses& addresses, int count) {
  std::string words;
  for (int i = 0; i < count; ++i)
    words += addresses.next(kNow).endpoint.address().to_string() + " ";
  return words;
}

TEST(ServerAddresses, NumericHostsNeedNoLookup) {
  for (const char* host : {"10.0.0.1", "::1", "fe80::1%lo"}) {
    ServerAddresses addresses({{host, 7}});
    EXPECT_TRUE(addresses.names().empty()) << host;
    ASSERT_FALSE(addresses.is_empty()) << host;
    EXPECT_EQ(addresses.next(kNow).endpoint.port(), 7) << host;
  }
}

TEST(ServerAddresses, AScopeIsLookedForWithEachAttempt) {
  ServerAddresses addresses({{"fe80::1%lo", 7}});
  EXPECT_EQ(addresses.next(kNow).endpoint.address().to_v6().scope_id(), ::if_nametoindex("lo"));
}

TEST(ServerAddresses, ANameHasNoAddressUntilItIsLookedUp) {
  ServerAddresses addresses({kSlam});
  EXPECT_EQ(addresses.names(), (std::vector<Address>{kSlam}));
  EXPECT_TRUE(addresses.is_empty());
  EXPECT_TRUE(addresses.found(kSlam, {at("10.0.0.1")}));
  EXPECT_EQ(next(addresses, 2), "10.0.0.1 10.0.0.1 ");
}

TEST(ServerAddresses, EachAddressHasItsTurn) {
  ServerAddresses addresses({kSlam});
  addresses.found(kSlam, {at("fd00::1"), at("10.0.0.1")});
  EXPECT_EQ(next(addresses, 4), "fd00::1 10.0.0.1 fd00::1 10.0.0.1 ");
}

TEST(ServerAddresses, TheGoodAddressIsFirstAndHasThreeTurnsOfFour) {
  ServerAddresses addresses({kSlam});
  addresses.found(kSlam, {at("fd00::1"), at("10.0.0.1")});
  addresses.welcomed_at({kSlam, at("10.0.0.1")});
  EXPECT_EQ(next(addresses, 5), "10.0.0.1 10.0.0.1 10.0.0.1 fd00::1 10.0.0.1 ");
}

TEST(ServerAddresses, ALookupThatFindsTheSameIsNoNews) {
  ServerAddresses addresses({kSlam});
  addresses.found(kSlam, {at("10.0.0.1"), at("10.0.0.2")});
  EXPECT_FALSE(addresses.found(kSlam, {at("10.0.0.2"), at("10.0.0.1")}));
}

TEST(ServerAddresses, ANewAddressIsNextAndTheGoodOneIsKept) {
  ServerAddresses addresses({kSlam});
  addresses.found(kSlam, {at("10.0.0.1")});
  addresses.welcomed_at({kSlam, at("10.0.0.1")});
  EXPECT_TRUE(addresses.found(kSlam, {at("10.0.0.9")}));
  EXPECT_EQ(next(addresses, 5), "10.0.0.9 10.0.0.1 10.0.0.1 10.0.0.1 10.0.0.1 ");
  addresses.welcomed_at({kSlam, at("10.0.0.9")});
  EXPECT_TRUE(addresses.found(kSlam, {at("10.0.0.8")}));
  EXPECT_EQ(next(addresses, 4), "10.0.0.8 10.0.0.9 10.0.0.9 10.0.0.9 ");
}

/// Three servers, a to c, of which a has two addresses.
class SeveralServers : public ::testing::Test {
 protected:
  SeveralServers() {
    addresses_.found(kA, {at("10.0.0.1"), at("10.0.1.1")});
    addresses_.found(kB, {at("10.0.0.2")});
    addresses_.found(kC, {at("10.0.0.3")});
  }
  /// The servers of the next attempts, a word each; after a plus the one beside.
  std::string attempts(int count, ServerAddresses::Time now = kNow) {
    std::string words;
    for (int i = 0; i < count; ++i) {
      words += addresses_.next(now).server.host;
      if (const auto beside = addresses_.next_beside(now)) words += "+" + beside->server.host;
      words += " ";
    }
    return words;
  }

  static inline const Address kA{"a", 7722}, kB{"b", 7722}, kC{"c", 7722}, kGuest{"guest", 7722};
  ServerAddresses addresses_{{kA, kB, kC}};
};

TEST_F(SeveralServers, EachHasItsTurnWithoutAPreferredOne) {
  EXPECT_EQ(attempts(4), "a b c a ");
  EXPECT_TRUE(addresses_.is_wanted(kC, kNow, 0ns));
}

TEST_F(SeveralServers, OneWithoutAnAddressHasNoTurn) {
  ServerAddresses addresses({kA, kB});
  EXPECT_TRUE(addresses.is_empty());
  EXPECT_TRUE(addresses.found(kB, {at("10.0.0.2")}));
  EXPECT_FALSE(addresses.is_known(kA));
  EXPECT_EQ(next(addresses, 2), "10.0.0.2 10.0.0.2 ");
  addresses.welcomed_at({kB, at("10.0.0.2")});
  EXPECT_FALSE(addresses.next_beside(kNow));
}

TEST_F(SeveralServers, TheOneThatWelcomedIsPreferredAndTheOthersAreBeside) {
  addresses_.welcomed_at({kB, at("10.0.0.2")});
  EXPECT_EQ(attempts(4), "b+a b+c b+a b+c ");
}

TEST_F(SeveralServers, AnotherIsWantedARoundTripAfterTheFirstAnswer) {
  EXPECT_TRUE(addresses_.is_wanted(kB, kNow, 0ns));
  addresses_.welcomed_at({kA, at("10.0.0.1")});
  EXPECT_FALSE(addresses_.is_wanted(kB, kNow, 300ms));
  EXPECT_TRUE(addresses_.is_wanted(kA, kNow, 300ms));
  EXPECT_FALSE(addresses_.is_wanted(kC, kNow + 299ms, 300ms));
  EXPECT_TRUE(addresses_.is_wanted(kC, kNow + 300ms, 300ms));
  EXPECT_FALSE(addresses_.is_wanted(kB, kNow + 11s, 0ns)) << "another outage";
  addresses_.welcomed_at({kB, at("10.0.0.2")});
  EXPECT_FALSE(addresses_.is_wanted(kA, kNow + 11s, 0ns));
}

TEST_F(SeveralServers, OneThatFailedIsNotTriedBeforeItsTimeUnlessAllDid) {
  addresses_.welcomed_at({kA, at("10.0.0.1")});
  addresses_.failed(kA, kNow + 1s);
  EXPECT_EQ(attempts(3), "b c b ");
  EXPECT_TRUE(addresses_.is_wanted(kC, kNow, 1s));
  EXPECT_TRUE(addresses_.is_any_ready(kNow));
  EXPECT_EQ(attempts(3, kNow + 1s), "c a b ");
  addresses_.failed(kB, kNow + 3s);
  EXPECT_FALSE(addresses_.have_all_failed());
  addresses_.failed(kC, kNow + 2s);
  EXPECT_TRUE(addresses_.have_all_failed());
  EXPECT_FALSE(addresses_.is_any_ready(kNow));
  EXPECT_EQ(attempts(2), "a a ") << "the first to be ready";
  addresses_.welcomed_at({kA, at("10.0.0.1")});
  EXPECT_FALSE(addresses_.have_all_failed());
  EXPECT_TRUE(addresses_.is_any_ready(kNow));
}

TEST_F(SeveralServers, OneThatFailedIsNotTriedBesideThePreferredOneEither) {
  addresses_.welcomed_at({kA, at("10.0.0.1")});
  addresses_.failed(kB, kNow + 1s);
  EXPECT_EQ(attempts(2), "a+c a+c ");
  addresses_.failed(kC, kNow + 1s);
  EXPECT_EQ(attempts(2), "a a ");
  addresses_.welcomed_at({kA, at("10.0.0.1")});
  EXPECT_EQ(attempts(2), "a+b a+c ") << "a welcome ends that";
}

TEST(ServerAddresses, OneWithoutAnAddressIsNeitherReadyNorHopedFor) {
  ServerAddresses addresses({{"10.0.0.1", 7722}, kSlam});
  EXPECT_TRUE(addresses.is_any_ready(kNow));
  addresses.failed({"10.0.0.1", 7722}, kNow + 1s);
  EXPECT_FALSE(addresses.is_any_ready(kNow));
  EXPECT_TRUE(addresses.have_all_failed());
  addresses.found(kSlam, {at("10.0.0.2")});
  EXPECT_TRUE(addresses.is_any_ready(kNow));
  EXPECT_FALSE(addresses.have_all_failed());
}

}  // namespace
}  // namespace orbbuf
