// SPDX-License-Identifier: Apache-2.0
#include "testing/robot_client.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

namespace orbbuf::test {

UniqueFd RobotClient::tcp_socket() {
  return UniqueFd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
}

RobotClient::RobotClient(std::uint16_t port, UniqueFd socket) : socket_(std::move(socket)) {
  const timeval limit{30, 0};
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
  const int yes = 1;  // else Nagle's algorithm waits for the server's delayed ACK
  ::setsockopt(socket_.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    throw std::runtime_error("cannot connect to the server under test");
  }
}

void RobotClient::send(std::span<const std::uint8_t> bytes) const {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return;  // reading shows what happened
    bytes = bytes.subspan(static_cast<std::size_t>(sent));
  }
}

void RobotClient::send_text(std::string_view text) const {
  send({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

void RobotClient::send_frame(const EncodedFrame& frame) const {
  send(wire::encode_frame_head(frame));
  send(frame.jpeg);
}

void RobotClient::send_drops(std::uint64_t first, const std::vector<DropRecord>& records) const {
  send(wire::encode(wire::Items{wire::kDrops, first, wire::encode_drops(records)}));
}

void RobotClient::send_late(std::uint64_t number, const std::string& session,
                            const EncodedFrame& frame) const {
  send_late(number, wire::encode_late_record(session, frame));
}

void RobotClient::send_late(std::uint64_t number, std::span<const std::uint8_t> record) const {
  const auto bytes = static_cast<std::uint32_t>(record.size());
  constexpr std::uint32_t kPartBytes = 16'000;
  for (std::uint32_t offset = 0; offset < bytes; offset += kPartBytes) {
    const auto part = record.subspan(offset, std::min(kPartBytes, bytes - offset));
    send(wire::encode(
        wire::Items{wire::kLate, number, wire::encode_late_part({offset, bytes, part})}));
  }
}

void RobotClient::send_account(std::uint64_t number, const wire::Account& account) const {
  send(wire::encode(wire::Items{wire::kAccounts, number, wire::encode_account(account)}));
}

void RobotClient::send_hello(const std::string& robot, const std::string& session) const {
  wire::Hello hello;
  hello.robot_id = robot;
  hello.session_id = session;
  hello.software = "test";
  send(wire::encode(hello));
}

std::optional<wire::Position> RobotClient::hello(const std::string& robot,
                                                 const std::string& session) const {
  send_hello(robot, session);
  return welcome();
}

std::optional<wire::Position> RobotClient::welcome() const {
  const auto message = read(wire::Type::kWelcome);
  if (!message) return std::nullopt;
  last_ = {wire::parse_welcome(message->header, message->body).value().position, 0};
  last_.received = last_.position[wire::kFrames];
  return last_.position;
}

std::optional<wire::Position> RobotClient::ack() const {
  const auto whole = whole_ack();
  if (!whole) return std::nullopt;
  return whole->position;
}

std::optional<wire::Ack> RobotClient::whole_ack() const {
  constexpr int kMostBeats = 8;
  for (int beats = 0;; ++beats) {
    const auto message = read(wire::Type::kAck);
    if (!message) return std::nullopt;
    const auto ack = wire::parse_ack(message->header, message->body).value();
    if (std::exchange(last_, ack) != ack || beats == kMostBeats) return ack;
  }
}

std::optional<wire::Position> RobotClient::bye() const {
  const auto message = read(wire::Type::kBye);
  if (!message) return std::nullopt;
  return wire::parse_bye(message->header, message->body).value().position;
}

std::optional<wire::ErrorMessage> RobotClient::error() const {
  const auto message = read(wire::Type::kError);
  if (!message) return std::nullopt;
  return wire::parse_error(message->header, message->body).value();
}

bool RobotClient::acked(std::uint64_t next, wire::StreamId stream) const {
  auto position = ack();
  while (position && (*position)[stream] < next) position = ack();
  return position && (*position)[stream] == next;
}

bool RobotClient::is_closed() const {
  std::uint8_t byte = 0;
  return ::recv(socket_.get(), &byte, 1, 0) == 0;
}

void RobotClient::close(bool abruptly) {
  const linger reset{1, 0};
  if (abruptly) ::setsockopt(socket_.get(), SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
  const UniqueFd gone(socket_.release());
}

std::optional<RobotClient::Message> RobotClient::read(wire::Type type) const {
  auto message = read();
  while (message && message->header.type == wire::Type::kAck && type != wire::Type::kAck) {
    message = read();
  }
  return message && message->header.type == type ? std::move(message) : std::nullopt;
}

std::optional<RobotClient::Message> RobotClient::read() const {
  std::array<std::uint8_t, wire::kHeaderBytes> bytes{};
  if (!read_exactly(bytes)) return std::nullopt;
  const auto header = wire::parse_header(bytes, 0);
  if (!header) return std::nullopt;
  Message message{header.value(), std::vector<std::uint8_t>(header.value().body_bytes)};
  if (!read_exactly(message.body)) return std::nullopt;
  return message;
}

bool RobotClient::read_exactly(std::span<std::uint8_t> bytes) const {
  if (bytes.empty()) return true;
  return ::recv(socket_.get(), bytes.data(), bytes.size(), MSG_WAITALL) ==
         static_cast<ssize_t>(bytes.size());
}

}  // namespace orbbuf::test
