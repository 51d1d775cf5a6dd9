// SPDX-License-Identifier: Apache-2.0
#include "bench/fleet/robot.hpp"

#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <utility>

#include "common/address.hpp"

namespace orbbuf::fleet_bench {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using std::chrono::milliseconds;

constexpr milliseconds kWatch{50};
constexpr milliseconds kStall{300};        // while the kernel has no acknowledgement: orbbufd's
constexpr milliseconds kSilence{1000};     // while the server says nothing: orbbufd's
constexpr milliseconds kAttempt{1500};     // to the welcome
constexpr milliseconds kSentAttempt{300};  // the same, of a server that another names
constexpr milliseconds kRetry{50};

bool is_outstanding(tcp::socket& socket) {
  tcp_info info{};
  socklen_t size = sizeof info;
  return ::getsockopt(socket.native_handle(), IPPROTO_TCP, TCP_INFO, &info, &size) == 0 &&
         info.tcpi_unacked > 0;
}

}  // namespace

struct Robot::Link {
  explicit Link(asio::io_context& io) : socket(io) {}
  tcp::socket socket;
  std::array<std::uint8_t, wire::kHeaderBytes> header{};
  std::vector<std::uint8_t> body;
  std::vector<std::uint8_t> out;
  std::array<std::uint8_t, wire::kHeaderBytes + wire::kFrameMetaBytes> head{};
  FramePtr frame;
  std::size_t server = 0;
  bool is_writing = false;
  bool is_bye_sent = false;
  std::optional<Sequence> successor_begins;  // set: it is a former one
};

Robot::Robot(asio::io_context& io, const load::Content& content, Plan plan)
    : io_(io),
      content_(content),
      plan_(std::move(plan)),
      capture_timer_(io),
      watch_timer_(io),
      retry_timer_(io),
      server_(plan_.number % plan_.servers.size()) {}

void Robot::start(Clock::time_point first) {
  capture_at(first);
  attempt(plan_.servers[server_]);
  watch();
}

void Robot::end(std::function<void()> ended) {
  is_capturing_ = false;
  ended_ = std::move(ended);
  write_next();
}

void Robot::cut() {
  if (!link_) return;
  error_code ignored;
  link_->socket.close(ignored);
}

void Robot::capture_at(Clock::time_point due) {
  capture_timer_.expires_at(due);
  capture_timer_.async_wait([this, due](const error_code& failed) {
    if (failed || !is_capturing_) return;
    kept_.push_back({content_.frame(plan_.number, counts_.captured++), due});
    write_next();
    capture_at(due + plan_.interval);
  });
}

/// Whether the server lives: it says what it receives, and that it lives.
void Robot::watch() {
  watch_timer_.expires_after(kWatch);
  watch_timer_.async_wait([this](const error_code& failed) {
    if (failed || is_over_) return;
    const auto now = Clock::now();
    const bool is_due = counts_.captured > received_ && !kept_.empty() &&
                        now - kept_.back().captured < std::chrono::seconds(10);
    if (link_ && !attempt_ && is_due &&
        now - heard_ > (is_outstanding(link_->socket) ? kStall : kSilence)) {
      attempt_next();
    }
    if (attempt_ && now - attempt_begun_ > (sent_by_ ? kSentAttempt : kAttempt)) {
      error_code ignored;
      std::exchange(attempt_, nullptr)->socket.close(ignored);
      attempt_next();
    }
    watch();
  });
}

void Robot::attempt_next() {
  server_ = sent_by_ ? *sent_by_ : (server_ + 1) % plan_.servers.size();
  sent_by_.reset();
  attempt(plan_.servers[server_]);
}

void Robot::attempt_later() {
  retry_timer_.expires_after(kRetry);
  retry_timer_.async_wait([this](const error_code& failed) {
    if (!failed && !attempt_ && !is_over_) attempt_next();
  });
}

void Robot::attempt(const tcp::endpoint& server) {
  const auto link = attempt_ = std::make_shared<Link>(io_);
  const auto at = std::ranges::find(plan_.servers, server);
  if (at != plan_.servers.end()) server_ = static_cast<std::size_t>(at - plan_.servers.begin());
  link->server = server_;
  attempt_begun_ = Clock::now();
  link->socket.async_connect(server, [this, link](const error_code& failed) {
    if (failed) return on_lost(link);
    link->socket.set_option(tcp::no_delay(true));
    wire::Hello hello;
    hello.robot_id = id();
    hello.session_id = kSession;
    hello.software = "orbbuf-fleet";
    link->out = wire::encode(hello);
    asio::async_write(link->socket, asio::buffer(link->out),
                      [this, link](const error_code& lost, std::size_t) {
                        if (lost) return on_lost(link);
                        read(link);
                      });
  });
}

void Robot::read(const std::shared_ptr<Link>& link) {
  asio::async_read(link->socket, asio::buffer(link->header),
                   [this, link](const error_code& failed, std::size_t) {
                     if (failed) return on_lost(link);
                     const auto header = wire::parse_header(link->header, 0);
                     if (!header) return on_lost(link);
                     link->body.resize(header.value().body_bytes);
                     asio::async_read(link->socket, asio::buffer(link->body),
                                      [this, link, header = header.value()](const error_code& lost,
                                                                            std::size_t) {
                                        if (lost) return on_lost(link);
                                        take(link, header);
                                      });
                   });
}

void Robot::take(const std::shared_ptr<Link>& link, const wire::Header& header) {
  switch (header.type) {
    case wire::Type::kWelcome:
      take_welcome(link, wire::parse_welcome(header, link->body).value());
      break;
    case wire::Type::kAck:
      take_ack(link, wire::parse_ack(header, link->body).value());
      break;
    case wire::Type::kBye:
      if (link != link_ || !link->is_bye_sent || !ended_) return on_lost(link);
      is_over_ = true;
      watch_timer_.cancel();
      return std::exchange(ended_, nullptr)();
    case wire::Type::kError:
      return take_error(link, wire::parse_error(header, link->body).value());
    default:
      return on_lost(link);
  }
  read(link);
}

void Robot::take_welcome(const std::shared_ptr<Link>& link, const wire::Welcome& welcome) {
  if (link != attempt_) return;
  const Sequence begins = welcome.position[wire::kFrames];
  if (link_) {
    link_->successor_begins = begins;
    former_.push_back(link_);
  }
  for (const auto& weak : former_) {
    if (const auto former = weak.lock()) former->successor_begins = begins;
  }
  if (begins < confirmed_) counts_.forgotten += confirmed_ - begins;
  if (last_server_ != SIZE_MAX && last_server_ != link->server) {
    counts_.gaps_s.push_back(std::chrono::duration<double>(Clock::now() - heard_).count());
  }
  last_server_ = link->server;
  sent_by_.reset();
  link_ = std::exchange(attempt_, nullptr);
  heard_ = Clock::now();
  confirm(begins);
  received_ = begins;
  sent_ = 0;
  write_next();
}

void Robot::take_ack(const std::shared_ptr<Link>& link, const wire::Ack& ack) {
  const Sequence next = ack.position[wire::kFrames];
  if (link->successor_begins) {
    if (next > *link->successor_begins) counts_.split_brain += next - *link->successor_begins;
    return;
  }
  if (link != link_) return;
  heard_ = Clock::now();
  received_ = std::max(received_, ack.received);
  confirm(next);
  write_next();
}

void Robot::confirm(Sequence next) {
  const auto now = Clock::now();
  while (!kept_.empty() && kept_.front().frame->sequence < next) {
    counts_.acks_s.push_back(std::chrono::duration<double>(now - kept_.front().captured).count());
    kept_.pop_front();
    if (sent_ > 0) --sent_;
  }
  confirmed_ = std::max(confirmed_, next);
}

void Robot::take_error(const std::shared_ptr<Link>& link, const wire::ErrorMessage& error) {
  error_code ignored;
  link->socket.close(ignored);
  const bool is_current = link == link_ || link == attempt_;
  if (link == link_) link_ = nullptr;
  if (link == attempt_) attempt_ = nullptr;
  if (!is_current || attempt_) return;
  const auto address = parse_address(error.text);
  if (error.code != wire::ErrorCode::kMoved || !address) return attempt_later();
  sent_by_ = link->server;
  attempt({asio::ip::make_address(address.value().host), address.value().port});
}

void Robot::on_lost(const std::shared_ptr<Link>& link) {
  error_code ignored;
  link->socket.close(ignored);
  const bool was_welcome = link == link_;
  const bool is_current = was_welcome || link == attempt_;
  if (was_welcome) link_ = nullptr;
  if (link == attempt_) attempt_ = nullptr;
  if (!is_current || attempt_ || is_over_) return;
  if (was_welcome) return attempt(plan_.servers[link->server]);
  attempt_later();
}

void Robot::write_next() {
  const auto link = link_;
  if (!link || link->is_writing || link->is_bye_sent) return;
  const auto written = [this, link](const error_code& failed, std::size_t) {
    link->is_writing = false;
    if (!failed && link == link_) write_next();  // reading shows why
  };
  if (sent_ < kept_.size()) {
    link->frame = kept_[sent_++].frame;
    link->head = wire::encode_frame_head(*link->frame);
    link->is_writing = true;
    const std::array<asio::const_buffer, 2> parts = {asio::buffer(link->head),
                                                     asio::buffer(link->frame->jpeg)};
    asio::async_write(link->socket, parts, written);
  } else if (!is_capturing_ && kept_.empty() && ended_) {
    link->is_bye_sent = link->is_writing = true;
    link->out = wire::encode(wire::Bye{{counts_.captured, 0}});
    asio::async_write(link->socket, asio::buffer(link->out), written);
  }
}

std::string Robot::state() const {
  return id() + ": " + std::to_string(kept_.size()) + " frames wait from " +
         std::to_string(confirmed_) + (link_ ? ", welcomed by " : ", not welcomed by ") +
         std::to_string(server_);
}

}  // namespace orbbuf::fleet_bench
