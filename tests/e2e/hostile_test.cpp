// SPDX-License-Identifier: Apache-2.0
// Strangers at the server's door: each costs its own connection, and no robot a frame.
#include <gtest/gtest.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <csignal>
#include <random>

#include "common/address.hpp"
#include "common/wire.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace asio = boost::asio;
using Bytes = std::vector<std::uint8_t>;
using Random = std::mt19937_64;

std::size_t below(Random& random, std::size_t limit) {
  return static_cast<std::size_t>(random() % limit);
}

/// Sends `bytes` and reads until the server closes the connection; what it said.
Bytes talk(const std::string& address, const Bytes& bytes, bool half_close = true) {
  const Address server = parse_address(address).value();
  asio::io_context io;
  asio::ip::tcp::socket socket(io);
  socket.connect({asio::ip::make_address(server.host), server.port});
  boost::system::error_code error;  // the server may well close before it has read everything
  asio::write(socket, asio::buffer(bytes), error);
  if (half_close) socket.shutdown(asio::socket_base::shutdown_send, error);
  Bytes answer;
  asio::read(socket, asio::dynamic_buffer(answer), error);
  return answer;
}

void append(Bytes& stream, const Bytes& message) {
  stream.insert(stream.end(), message.begin(), message.end());
}

/// The messages of a small valid session.
std::vector<Bytes> valid_session(Random& random) {
  wire::Hello hello;
  hello.robot_id = "hostile";
  hello.session_id = "s" + std::to_string(random());
  hello.calibration = "Pinhole 1 1 1 1 0\n2 2\nnone\n2 2\n";
  std::vector<Bytes> messages = {wire::encode(hello)};
  for (Sequence sequence = 0; sequence < 3; ++sequence) {
    EncodedFrame frame;
    frame.sequence = sequence;
    frame.jpeg.assign(1 + below(random, 2000), static_cast<std::uint8_t>(random()));
    frame.jpeg_crc = wire::crc32(frame.jpeg);
    const auto head = wire::encode_frame_head(frame);
    messages.emplace_back(head.begin(), head.end());
    append(messages.back(), frame.jpeg);
  }
  const auto add_items = [&](wire::StreamId stream, const Bytes& payload) {
    messages.push_back(wire::encode(wire::Items{stream, 0, payload}));
  };
  const DropRecord drop{3, 3, DropReason::kPolicy};
  add_items(wire::kDrops, wire::encode_drops({&drop, 1}));
  wire::Account account;
  account.session_id = hello.session_id;
  account.held = 1;
  account.first_held = 3;
  account.given_up = {{0, 0, DropReason::kLost, kUnknownSimilarity, 2, 5}};
  add_items(wire::kAccounts, wire::encode_account(account));
  EncodedFrame late;
  late.sequence = 3;
  late.jpeg.assign(500, 7);
  late.jpeg_crc = wire::crc32(late.jpeg);
  const Bytes record = wire::encode_late_record(hello.session_id, late);
  add_items(wire::kLate,
            wire::encode_late_part({0, static_cast<std::uint32_t>(record.size()), record}));
  messages.push_back(wire::encode(wire::Report{}));
  messages.push_back(wire::encode(wire::Bye{{4, 1}}));
  return messages;
}

void put32(Bytes& message, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    message[at + i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

/// Makes the checksums of a mutated message right again, so that it gets past them.
void seal(Bytes& message) {
  const std::span<const std::uint8_t> bytes(message);
  put32(message, 12, wire::crc32(bytes.subspan(wire::kHeaderBytes)));
  put32(message, 16, wire::crc32(bytes.first(16)));
}

Bytes mutated_session(Random& random) {
  std::vector<Bytes> messages = valid_session(random);
  Bytes& victim = messages[below(random, messages.size())];
  for (std::size_t n = 1 + below(random, 4); n > 0; --n) {
    victim[below(random, victim.size())] = static_cast<std::uint8_t>(random());
  }
  if (random() % 2 == 0) seal(victim);
  if (random() % 4 == 0) std::swap(messages.front(), messages[below(random, messages.size())]);
  Bytes stream;
  for (const Bytes& message : messages) append(stream, message);
  if (random() % 3 == 0) stream.resize(below(random, stream.size()));
  return stream;
}

Bytes random_bytes(Random& random) {
  Bytes bytes(below(random, 300));
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

TEST(Hostile, TwoThousandStrangersCostAGoodRobotNoFrame) {
  const TemporaryFolder out;
  Server server(out.path());
  Process good(
      robot_command("good", server.address(),
                    {"source.frames=100000000", "source.realtime=false", "source.width=160",
                     "source.height=120", "link.stall_timeout=60 s"}));  // the machine may be slow
  ASSERT_TRUE(good.wait_for_line("connected to"));
  Random random(1);
  for (int i = 0; i < 1000; ++i) talk(server.address(), random_bytes(random));
  for (int i = 0; i < 1000; ++i) talk(server.address(), mutated_session(random));
  good.signal(SIGTERM);
  ASSERT_EQ(good.wait(), 0) << good.output();

  EXPECT_EQ(good.count_lines("connected to"), 1) << good.output();
  const auto stats = closing_stats(good);
  const Record record = read_record(out.path(), "good");
  expect_exactly_once(record, stats.at("captured"));
  EXPECT_GT(record.delivered.size(), 100U);
  for (const auto& [sequence, reason] : record.dropped) EXPECT_EQ(reason, "shutdown");
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(), 0) << server.process().output();
}

/// That a server which a stranger has said that to warns once, and of what.
void expect_named_once(const Bytes& said, const std::string& reason,
                       const Overrides& overrides = {}) {
  const TemporaryFolder out;
  Server server(out.path(), overrides);
  Process& process = server.process();
  talk(server.address(), said, false);
  EXPECT_TRUE(process.wait_for_line(reason)) << process.output();
  process.signal(SIGTERM);
  EXPECT_EQ(process.wait(), 0);
  EXPECT_EQ(process.count_lines(" warn ["), 1) << process.output();
}

TEST(Hostile, EachStrangerIsNamedOnceWithTheReason) {
  const std::string http = "GET / HTTP/1.1\r\nHost: robot\r\n\r\n";
  expect_named_once({http.begin(), http.end()}, "GET ");

  Random random(2);
  const Bytes hello = valid_session(random).front();
  Bytes huge = hello;
  Bytes header = {'O', 'R', 'B', 'B', 1, 3, 0, 0, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0, 0, 0, 0, 0};
  put32(header, 16, wire::crc32(std::span<const std::uint8_t>(header).first(16)));
  append(huge, header);
  expect_named_once(huge, "4294967295");

  expect_named_once({}, "no hello within 0.1 s", {"listen.hello_timeout=100 ms"});
  expect_named_once(hello, "nothing came for 0.1 s", {"listen.idle_timeout=100 ms"});
}

}  // namespace
}  // namespace orbbuf::test
