// SPDX-License-Identifier: Apache-2.0
#include "testing/scripted_server.hpp"

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <stdexcept>

namespace orbbuf::test {
namespace asio = boost::asio;

EncodedFrame Message::frame() const {
  const std::span<const std::uint8_t> bytes(body);
  auto frame = wire::parse_frame(header, bytes.first<wire::kFrameMetaBytes>(),
                                 {body.begin() + wire::kFrameMetaBytes, body.end()});
  if (!frame) throw std::runtime_error(frame.error().text);
  return std::move(frame.value());
}

ScriptedServer::ScriptedServer()
    : acceptor_(io_, {asio::ip::address_v4::loopback(), 0}), socket_(io_) {}

std::uint16_t ScriptedServer::port() const { return acceptor_.local_endpoint().port(); }

void ScriptedServer::accept() { socket_ = acceptor_.accept(); }

void ScriptedServer::accept_beside() {
  silent_.push_back(std::move(socket_));
  accept();
}

wire::Hello ScriptedServer::accept_hello() {
  std::optional<Message> message;
  while (!message) {
    accept();
    message = read_any();
  }
  auto hello = wire::parse_hello(message->header, message->body);
  if (!hello) throw std::runtime_error(hello.error().text);
  return hello.value();
}

wire::Hello ScriptedServer::welcome(const wire::Position& position) {
  wire::Hello hello = accept_hello();
  send(wire::encode(wire::Welcome{wire::kProtocolVersion, position}));
  return hello;
}

std::optional<Message> ScriptedServer::read_any() {
  std::array<std::uint8_t, wire::kHeaderBytes> bytes{};
  boost::system::error_code error;
  asio::read(socket_, asio::buffer(bytes), error);
  if (error) return std::nullopt;
  const auto header = wire::parse_header(bytes, 1 << 24);
  if (!header) throw std::runtime_error(header.error().text);
  Message message{header.value(), std::vector<std::uint8_t>(header.value().body_bytes)};
  asio::read(socket_, asio::buffer(message.body), error);
  if (error) return std::nullopt;
  return message;
}

std::optional<Message> ScriptedServer::read() {
  std::optional<Message> message = read_any();
  while (message && message->type() == wire::Type::kStats) message = read_any();
  return message;
}

Message ScriptedServer::read(wire::Type type) {
  while (std::optional<Message> message = read_any()) {
    if (message->type() == type) return *message;
  }
  throw std::runtime_error("the robot closed the connection");
}

void ScriptedServer::send(const std::vector<std::uint8_t>& bytes) {
  boost::system::error_code ignored;  // a robot that has gone is a case of its own
  asio::write(socket_, asio::buffer(bytes), ignored);
}

void ScriptedServer::ack(const wire::Position& position, std::optional<Sequence> received) {
  send(wire::encode(wire::Ack{position, received.value_or(position.next_sequence)}));
}

void ScriptedServer::close() { socket_.close(); }

void ScriptedServer::die() {
  acceptor_.close();
  socket_.close();
}

}  // namespace orbbuf::test
