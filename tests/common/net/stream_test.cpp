// SPDX-License-Identifier: Apache-2.0
#include "common/net/stream.hpp"

#include <gtest/gtest.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <string>
#include <vector>

#include "testing/certificates.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using test::Certificates;

/// A robot and a server under TLS, and a relay between them that notes who speaks when.
class StreamTest : public ::testing::Test {
 protected:
  StreamTest() {
    connect(robot_.socket(), robots_end_);
    connect(servers_end_, server_.socket());
    relay(robots_end_, servers_end_, 'r', from_robot_);
    relay(servers_end_, robots_end_, 's', from_server_);
  }
  void connect(tcp::socket& from, tcp::socket& to) {
    tcp::acceptor acceptor(io_, {asio::ip::address_v4::loopback(), 0});
    from.connect(acceptor.local_endpoint());
    acceptor.accept(to);
  }
  void relay(tcp::socket& from, tcp::socket& to, char name, std::array<char, 4096>& bytes) {
    from.async_read_some(asio::buffer(bytes), [&, name](const error_code& error, std::size_t size) {
      if (error) return;
      if (turns_.empty() || turns_.back() != name) turns_ += name;
      asio::write(to, asio::buffer(bytes, size));
      relay(from, to, name, bytes);
    });
  }
  /// The handshakes of both; then the robot sends a byte. Returns when the server has read it, or
  /// the robot has failed.
  error_code shake_hands(const std::string& host) {
    error_code robots;
    server_.async_handshake_as_server([&](const error_code& error) {
      if (!error) asio::async_read(server_, asio::buffer(byte_), [&](auto, auto) { io_.stop(); });
    });
    robot_.async_handshake_as_robot(host, [&](const error_code& error) {
      robots = error;
      if (error) return io_.stop();
      asio::async_write(robot_, asio::buffer(byte_), [](auto, auto) {});
    });
    io_.run();
    return robots;
  }

  const Certificates keys_;
  const std::shared_ptr<TlsContext> robots_context_ = make_tls_context(keys_.robot());
  const std::shared_ptr<TlsContext> servers_context_ = make_tls_context(keys_.server());
  asio::io_context io_;
  Stream robot_{tcp::socket(io_), robots_context_.get()};
  Stream server_{tcp::socket(io_), servers_context_.get()};
  tcp::socket robots_end_{io_};
  tcp::socket servers_end_{io_};
  std::array<char, 4096> from_robot_{};
  std::array<char, 4096> from_server_{};
  std::array<char, 1> byte_{};
  std::string turns_;
};

TEST_F(StreamTest, TlsTakesOneRoundTripBeforeTheFirstMessage) {
  EXPECT_FALSE(shake_hands("127.0.0.1"));
  EXPECT_EQ(turns_, "rsr");
}

TEST_F(StreamTest, AScopeIsNoPartOfTheAddressInACertificate) {
  EXPECT_TRUE(shake_hands("::1%lo"));
  EXPECT_EQ(robot_.explain({}),
            "the certificate of \"orbbuf-server\" was rejected: IP address mismatch");
}

// OpenSSL refuses to expect the one, and takes the other as leave to accept every certificate.
TEST_F(StreamTest, AHostThatCannotBeExpectedIsNotTrusted) {
  EXPECT_TRUE(shake_hands(std::string("local\0host", 10)));
  EXPECT_EQ(robot_.explain({}), "the name in a certificate cannot be compared with link.server");
}

TEST_F(StreamTest, NoHostIsNotTrusted) {
  EXPECT_TRUE(shake_hands(""));
  EXPECT_EQ(robot_.explain({}), "the name in a certificate cannot be compared with link.server");
}

}  // namespace
}  // namespace orbbuf
