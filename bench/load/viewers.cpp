// SPDX-License-Identifier: Apache-2.0
#include "bench/load/viewers.hpp"

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace orbbuf::load {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using Json = nlohmann::json;

class Viewers::Viewer {
 public:
  Viewer(asio::io_context& io, std::uint16_t port, std::atomic<std::uint64_t>& shown)
      : socket_(io), shown_(shown) {
    socket_.next_layer().connect({asio::ip::address_v4::loopback(), port});
    socket_.set_option(websocket::stream_base::decorator([](websocket::request_type& request) {
      request.set(boost::beast::http::field::sec_websocket_protocol, "foxglove.sdk.v1");
    }));
    socket_.handshake("localhost", "/");
    read();
  }

 private:
  void read() {
    socket_.async_read(buffer_, [this](const boost::system::error_code& failed, std::size_t) {
      if (failed) return;  // the server has ended
      if (socket_.got_text()) {
        on_text(Json::parse(boost::beast::buffers_to_string(buffer_.data())));
      } else {
        ++shown_;
      }
      buffer_.clear();
      read();
    });
  }

  void on_text(const Json& message) {
    if (message["op"] != "advertise") return;
    auto wanted = Json::array();
    for (const Json& channel : message["channels"]) {
      if (channel["schemaName"] != "foxglove.CompressedImage") continue;
      wanted.push_back({{"id", channel["id"]}, {"channelId", channel["id"]}});
    }
    if (!wanted.empty()) {
      socket_.write(asio::buffer(Json{{"op", "subscribe"}, {"subscriptions", wanted}}.dump()));
    }
  }

  websocket::stream<tcp::socket> socket_;
  std::atomic<std::uint64_t>& shown_;
  boost::beast::flat_buffer buffer_;
};

Viewers::Viewers(std::uint16_t port, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    viewers_.push_back(std::make_unique<Viewer>(io_, port, shown_));
  }
  thread_ = std::jthread([this] { io_.run(); });
}

Viewers::~Viewers() {
  io_.stop();
  thread_.join();
}

}  // namespace orbbuf::load
