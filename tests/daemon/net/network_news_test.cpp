// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/network_news.hpp"

#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>

#include "testing/own_network.hpp"
#include "testing/process.hpp"

namespace orbbuf {
namespace {

TEST(NetworkNews, AnInterfaceThatComesUpIsNews) {
  test::in_own_network([] {
    boost::asio::io_context io;
    int calls = 0;
    NetworkNews news(io, [&] {
      ++calls;
      io.stop();
    });
    news.start();
    ASSERT_EQ(test::run({"ip", "link", "set", "lo", "up"}).status, 0);
    io.run();
    EXPECT_EQ(calls, 1);
    ASSERT_EQ(test::run({"ip", "addr", "add", "10.9.8.7/24", "dev", "lo"}).status, 0);
    io.restart();
    io.run();
    EXPECT_EQ(calls, 2);
  });
}

TEST(NetworkNews, WhatGoesAwayIsNot) {
  test::in_own_network([] {
    ASSERT_EQ(test::run({"ip", "link", "set", "lo", "up"}).status, 0);
    ASSERT_EQ(test::run({"ip", "addr", "add", "10.9.8.7/32", "dev", "lo"}).status, 0);
    boost::asio::io_context io;
    int calls = 0;
    NetworkNews news(io, [&] { ++calls; });
    news.start();
    ASSERT_EQ(test::run({"ip", "addr", "del", "10.9.8.7/32", "dev", "lo"}).status, 0);
    io.poll();
    EXPECT_EQ(calls, 0);
  });
}

TEST(NetworkNews, ThereIsNoneAfterStop) {
  test::in_own_network([] {
    boost::asio::io_context io;
    NetworkNews news(io, [] { ADD_FAILURE(); });
    news.start();
    ASSERT_EQ(test::run({"ip", "link", "set", "lo", "up"}).status, 0);
    news.stop();
    io.run();
  });
}

}  // namespace
}  // namespace orbbuf
