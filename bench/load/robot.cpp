// SPDX-License-Identifier: Apache-2.0
#include "bench/load/robot.hpp"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <stdexcept>
#include <utility>

namespace orbbuf::load {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

// As orbbufd has them.
constexpr std::chrono::seconds kAccountInterval{1};
constexpr std::chrono::seconds kQuietAccountInterval{4};

}  // namespace

Robot::Robot(asio::io_context& io, const Content& content, Plan plan)
    : content_(content), plan_(plan), socket_(io), capture_timer_(io), stats_timer_(io) {
  latencies_.reserve(plan_.frames);
  received_latencies_.reserve(plan_.frames);
}

std::string Robot::id() const { return "robot-" + std::to_string(plan_.number); }

void Robot::connect(const asio::ip::tcp::endpoint& server, std::function<void()> welcome) {
  welcome_ = std::move(welcome);
  socket_.async_connect(server, [this](const error_code& failed) {
    check(failed, "connect");
    socket_.set_option(asio::ip::tcp::no_delay(true));
    wire::Hello hello;
    hello.robot_id = id();
    hello.session_id = kSession;
    hello.software = "orbbuf-load";
    say(wire::encode(hello));
    read();
  });
}

void Robot::start(Clock::time_point first, std::function<void()> settled) {
  settled_ = std::move(settled);
  if (plan_.frames > 0) capture_at(first);
  stats_at(first + stats_interval());
}

void Robot::capture_at(Clock::time_point due) {
  capture_timer_.expires_at(due);
  capture_timer_.async_wait([this, due](const error_code& failed) {
    check(failed, "wait");
    most_late_ = std::max<std::chrono::nanoseconds>(most_late_, Clock::now() - due);
    kept_.push_back({content_.frame(plan_.number, captured_++), due});
    write_next();
    if (captured_ < plan_.frames) capture_at(due + plan_.interval);
  });
}

std::chrono::seconds Robot::stats_interval() const {
  return plan_.frames > 0 ? kAccountInterval : kQuietAccountInterval;
}

void Robot::stats_at(Clock::time_point due) {
  stats_timer_.expires_at(due);
  stats_timer_.async_wait([this, due](const error_code& failed) {
    if (failed) return;  // at the end
    say(wire::encode(wire::Report{stats()}));
    stats_at(due + stats_interval());
  });
}

wire::Stats Robot::stats() const {
  wire::Stats stats;
  stats.captured = captured_;
  stats.acknowledged = captured_ - kept_.size();
  stats.in_flight = sent_;
  stats.waiting = kept_.size() - sent_;
  return stats;
}

void Robot::end(std::function<void()> ended) {
  ended_ = std::move(ended);
  stats_timer_.cancel();
  say(wire::encode(wire::Bye{{captured_, 0}}));
}

void Robot::say(std::vector<std::uint8_t> message) {
  waiting_.insert(waiting_.end(), message.begin(), message.end());
  write_next();
}

void Robot::write_next() {
  if (is_writing_) return;
  const auto written = [this](const error_code& failed, std::size_t) {
    check(failed, "write");
    is_writing_ = false;
    write_next();
  };
  if (!waiting_.empty()) {
    out_ = std::exchange(waiting_, {});
    is_writing_ = true;
    asio::async_write(socket_, asio::buffer(out_), written);
  } else if (sent_ < kept_.size()) {
    frame_ = kept_[sent_++].frame;
    head_ = wire::encode_frame_head(*frame_);
    is_writing_ = true;
    const std::array<asio::const_buffer, 2> parts = {asio::buffer(head_),
                                                     asio::buffer(frame_->jpeg)};
    asio::async_write(socket_, parts, written);
  }
}

void Robot::read() {
  asio::async_read(socket_, asio::buffer(header_), [this](const error_code& failed, std::size_t) {
    check(failed, "read");
    const auto header = wire::parse_header(header_, 0);
    if (!header) throw std::runtime_error(id() + ": " + header.error().text);
    body_.resize(header.value().body_bytes);
    asio::async_read(socket_, asio::buffer(body_),
                     [this, header = header.value()](const error_code& lost, std::size_t) {
                       check(lost, "read");
                       take(header);
                     });
  });
}

void Robot::take(const wire::Header& header) {
  switch (header.type) {
    case wire::Type::kWelcome:
      std::exchange(welcome_, nullptr)();
      return read();
    case wire::Type::kAck:
      take_ack(wire::parse_ack(header, body_).value());
      return read();
    case wire::Type::kBye:
      if (!ended_) throw std::runtime_error(id() + ": the server says bye too soon");
      return std::exchange(ended_, nullptr)();
    case wire::Type::kError:
      throw std::runtime_error(
          id() + ": the server says: " + wire::parse_error(header, body_).value().text);
    default:
      throw std::runtime_error(id() + ": unexpected " + std::string(to_string(header.type)));
  }
}

void Robot::take_ack(const wire::Ack& ack) {
  const auto now = Clock::now();
  for (; received_latencies_.size() < ack.received; ++received_) {
    received_latencies_.push_back(now - kept_[received_].captured);
  }
  while (!kept_.empty() && kept_.front().frame->sequence < ack.position[wire::kFrames]) {
    latencies_.push_back(now - kept_.front().captured);
    kept_.pop_front();
    --sent_;
    --received_;
  }
  if (latencies_.size() == plan_.frames && settled_) std::exchange(settled_, nullptr)();
}

void Robot::check(const error_code& failed, const char* attempt) const {
  if (failed) throw std::runtime_error(id() + ": " + attempt + ": " + failed.message());
}

}  // namespace orbbuf::load
