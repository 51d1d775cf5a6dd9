// SPDX-License-Identifier: Apache-2.0
#include "bench/strangers/probe.hpp"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/write.hpp>
#include <string>

#include "common/net/stream.hpp"

namespace orbbuf::bench {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;

constexpr std::string_view kRequest = "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n";

}  // namespace

Probe::Probe(const asio::ip::tcp::endpoint& page, const TlsSettings& tls)
    : tls_(make_tls_context(tls)), thread_([this, page](const std::stop_token& stop) {
        while (!stop.stop_requested()) {
          const auto begun = Clock::now();
          if (!ask(page)) ++failures_;
          ++count_;
          longest_ = std::max<std::chrono::nanoseconds>(longest_, Clock::now() - begun);
          std::this_thread::sleep_until(begun + kInterval);
        }
      }) {}

bool Probe::ask(const asio::ip::tcp::endpoint& page) const {
  asio::io_context io;
  Stream stream(asio::ip::tcp::socket(io), tls_.get());
  std::string answer;
  const auto talk = [&](const error_code& failed) {
    if (failed) return;
    asio::async_write(stream, asio::buffer(kRequest), [&](const error_code& gone, std::size_t) {
      if (gone) return;
      asio::async_read_until(stream, asio::dynamic_buffer(answer), "\r\n\r\n",
                             [](const error_code& /*told by the answer*/, std::size_t) {});
    });
  };
  stream.socket().async_connect(page, [&](const error_code& failed) {
    if (failed || !stream.is_tls()) return talk(failed);
    stream.async_handshake_as_robot(page.address().to_string(), talk);
  });
  io.run_for(kPatience);
  return answer.starts_with("HTTP/1.1 200");
}

}  // namespace orbbuf::bench
