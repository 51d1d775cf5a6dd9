// SPDX-License-Identifier: Apache-2.0
#include "testing/scripted_server.hpp"

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <stdexcept>
#include <utility>

namespace orbbuf::test {
namespace asio = boost::asio;

namespace {

template <class T>
T value(wire::Parsed<T> parsed) {
  if (!parsed) throw std::runtime_error(parsed.error().text);
  return std::move(parsed).value();
}

}  // namespace

EncodedFrame Message::frame() const {
  const std::span<const std::uint8_t> bytes(body);
  return value(wire::parse_frame(header, bytes.first<wire::kFrameMetaBytes>(),
                                 {body.begin() + wire::kFrameMetaBytes, body.end()}));
}

wire::Items Message::items() const { return value(wire::parse_items(header, body)); }

wire::Welcome welcome_at(const wire::Position& position) {
  wire::Welcome welcome;
  welcome.position = position;
  welcome.takes.set(wire::kFrames).set(wire::kDrops);
  return welcome;
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
  return value(wire::parse_hello(message->header, message->body));
}

wire::Hello ScriptedServer::welcome(const wire::Position& position) {
  wire::Hello hello = accept_hello();
  wire::Welcome welcome = welcome_at(position);
  for (const auto& stream : hello.streams) welcome.takes.set(stream.id);
  send(wire::encode(welcome));
  return hello;
}

std::optional<Message> ScriptedServer::read_any() {
  std::array<std::uint8_t, wire::kHeaderBytes> bytes{};
  boost::system::error_code error;
  asio::read(socket_, asio::buffer(bytes), error);
  if (error) return std::nullopt;
  const auto header = value(wire::parse_header(bytes, 1 << 24));
  Message message{header, std::vector<std::uint8_t>(header.body_bytes)};
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

wire::Items ScriptedServer::read_items(wire::StreamId stream) {
  wire::Items items = read(wire::Type::kItems).items();
  while (items.stream != stream) items = read(wire::Type::kItems).items();
  return items;
}

NumberedDrops ScriptedServer::read_drops() {
  const wire::Items items = read_items(wire::kDrops);
  return {items.first, value(wire::parse_drops(items.payload))};
}

void ScriptedServer::send(const std::vector<std::uint8_t>& bytes) {
  boost::system::error_code ignored;  // a robot that has gone is a case of its own
  asio::write(socket_, asio::buffer(bytes), ignored);
}

void ScriptedServer::ack(const wire::Position& position, std::optional<Sequence> received) {
  send(wire::encode(wire::Ack{position, received.value_or(position[wire::kFrames])}));
}

void ScriptedServer::close() { socket_.close(); }

void ScriptedServer::die() {
  acceptor_.close();
  socket_.close();
}

}  // namespace orbbuf::test
