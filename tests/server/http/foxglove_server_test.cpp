// SPDX-License-Identifier: Apache-2.0
#include "server/http/foxglove_server.hpp"

#include <gmock/gmock.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <nlohmann/json.hpp>

#include "server/foxglove/messages.hpp"
#include "testing/certificates.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/http/http_client.hpp"
#include "tests/server/link/listener_fixture.hpp"

namespace orbbuf::test {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using Json = nlohmann::json;
using testing::HasSubstr;

const std::string kCamera = "Pinhole 100 101 80 60 0\n160 120\nnone\n160 120\n0.1\n";

struct Shown {
  std::uint32_t subscription = 0;
  std::uint64_t time_ns = 0;
  std::string payload;
};

/// A program like Foxglove, over a real socket.
class Viewer {
 public:
  explicit Viewer(std::uint16_t port, std::string subprotocol = "foxglove.websocket.v1",
                  std::string origin = "", const std::string& host = "localhost")
      : socket_(io_) {
    socket_.next_layer().connect({asio::ip::address_v4::loopback(), port});
    socket_.set_option(websocket::stream_base::decorator(
        [subprotocol = std::move(subprotocol),
         origin = std::move(origin)](websocket::request_type& request) {
          namespace http = boost::beast::http;
          if (!subprotocol.empty()) request.set(http::field::sec_websocket_protocol, subprotocol);
          if (!origin.empty()) request.set(http::field::origin, origin);
        }));
    boost::system::error_code failed;
    socket_.handshake(answer_, host, "/", failed);
    is_open_ = !failed;
  }

  bool is_open() const { return is_open_; }
  std::string subprotocol() const {
    return std::string(answer_[boost::beast::http::field::sec_websocket_protocol]);
  }
  void send(const std::string& text) {
    socket_.text(true);
    socket_.write(asio::buffer(text));
  }
  void send_binary(const std::string& bytes) {
    socket_.binary(true);
    socket_.write(asio::buffer(bytes));
  }
  void subscribe(std::uint32_t id, const std::string& topic) {
    while (!channels_.contains(topic)) read();
    send(Json{{"op", "subscribe"},
              {"subscriptions", {{{"id", id}, {"channelId", channels_.at(topic)["id"]}}}}}
             .dump());
  }
  /// The next message, which must be text.
  Json text() {
    while (texts_.empty()) read();
    Json next = std::move(texts_.front());
    texts_.pop_front();
    return next;
  }
  Json text(const std::string& op) {
    Json next = text();
    while (next["op"] != op) next = text();
    return next;
  }
  Shown shown() {
    while (shown_.empty()) read();
    Shown next = std::move(shown_.front());
    shown_.pop_front();
    return next;
  }
  const Json& channel(const std::string& topic) {
    while (!channels_.contains(topic)) read();
    return channels_.at(topic);
  }
  /// Until the server closes; the number of messages that came.
  std::size_t read_to_end() {
    boost::beast::flat_buffer buffer;
    boost::system::error_code failed;
    std::size_t count = 0;
    for (; !failed; ++count, buffer.clear()) socket_.read(buffer, failed);
    return count - 1;
  }
  tcp::socket& socket() { return socket_.next_layer(); }

 private:
  void read() {
    boost::beast::flat_buffer buffer;
    socket_.read(buffer);
    const std::string bytes = boost::beast::buffers_to_string(buffer.data());
    if (!socket_.got_text()) {
      Shown shown;
      ASSERT_GE(bytes.size(), foxglove::kMessageHeadBytes);
      EXPECT_EQ(bytes[0], 1);
      for (std::size_t i = 0; i < 12; ++i) {
        const auto byte = static_cast<std::uint8_t>(bytes[i + 1]);
        if (i < 4) shown.subscription |= std::uint32_t{byte} << (8 * i);
        if (i >= 4) shown.time_ns |= std::uint64_t{byte} << (8 * (i - 4));
      }
      shown.payload = bytes.substr(foxglove::kMessageHeadBytes);
      return shown_.push_back(std::move(shown));
    }
    texts_.push_back(Json::parse(bytes));
    const Json& message = texts_.back();
    if (message["op"] == "advertise") {
      for (const Json& channel : message["channels"]) channels_[channel["topic"]] = channel;
    }
  }

  asio::io_context io_;
  websocket::stream<tcp::socket> socket_;
  websocket::response_type answer_;
  bool is_open_ = false;
  std::deque<Json> texts_;
  std::deque<Shown> shown_;
  std::map<std::string, Json> channels_;
};

/// A whole server, and robots that stream to it.
class FoxgloveServerTest : public ListenerTest {
 protected:
  FoxgloveServerTest() { settings_.http_address = Address{"127.0.0.1", 0}; }

  Viewer view(const std::string& subprotocol = "foxglove.websocket.v1") {
    if (!server_) start();
    return Viewer(server_->http_port(), subprotocol);
  }
  RobotClient robot(const std::string& calibration = "", const std::string& session = "s") {
    RobotClient robot = connect();
    robot.send(wire::encode(wire::Hello{6, 6, "r", session, "test", calibration, {}}));
    EXPECT_TRUE(robot.welcome());
    return robot;
  }
  static std::string image_of(const EncodedFrame& frame, const std::string& frame_id,
                              std::span<const std::uint8_t> jpeg) {
    const auto bytes = foxglove::compressed_image(frame.capture_time_ns, frame_id, jpeg);
    return {bytes.begin(), bytes.end()};
  }
};

TEST_F(FoxgloveServerTest, AnswersWithTheSubprotocolThatWasAskedFor) {
  for (const char* name : {"foxglove.websocket.v1", "foxglove.sdk.v1"}) {
    auto viewer = view(name);
    ASSERT_TRUE(viewer.is_open());
    EXPECT_EQ(viewer.subprotocol(), name);
    const Json info = viewer.text();
    EXPECT_EQ(info["op"], "serverInfo");
    EXPECT_EQ(info["capabilities"], Json::array());
  }
  EXPECT_EQ(view("x, foxglove.sdk.v1").subprotocol(), "foxglove.sdk.v1");
  EXPECT_FALSE(view("chat").is_open());
  EXPECT_FALSE(view("").is_open());
}

TEST_F(FoxgloveServerTest, OtherPagesAndMisledBrowsersAreRefused) {
  start();
  const auto opens = [&](const char* origin, const char* host = "localhost") {
    return Viewer(server_->http_port(), "foxglove.sdk.v1", origin, host).is_open();
  };
  EXPECT_TRUE(opens("https://app.foxglove.dev"));
  EXPECT_TRUE(opens("http://localhost:8080"));
  EXPECT_TRUE(opens("http://[::1]:8080"));
  EXPECT_TRUE(opens("http://192.168.0.7:8080", "192.168.0.7:9090"));
  EXPECT_FALSE(opens("http://6.6.6.6"));
  EXPECT_FALSE(opens("http://6.6.6.6", "192.168.0.7:9090"));
  EXPECT_TRUE(opens("file://"));
  EXPECT_FALSE(opens("https://evil.example"));
  EXPECT_FALSE(opens("https://app.foxglove.dev.evil.example"));
  EXPECT_FALSE(opens("null"));
  EXPECT_FALSE(opens("", "evil.example"));
}

TEST_F(FoxgloveServerTest, ARefusalSaysWhy) {
  const auto ask = [&](const std::string& path, const std::string& more) {
    if (!server_) start();
    const HttpClient client(server_->http_port());
    client.send("GET " + path +
                " HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
                "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n" +
                more + "\r\n");
    return client.read();
  };
  const std::string ours = "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n";
  EXPECT_EQ(ask("/robots", ours).status, 404);
  EXPECT_THAT(ask("/", "").body, HasSubstr("foxglove.websocket.v1 or foxglove.sdk.v1"));
  EXPECT_EQ(ask("/", ours + "Origin: https://evil.example\r\n").status, 403);
}

TEST_F(FoxgloveServerTest, ImagesComeByteForByteWithTheirTimes) {
  auto viewer = view();
  const auto robot = this->robot();
  robot.send_frame(plain_frame(0));
  viewer.subscribe(9, "/r/image");
  viewer.subscribe(3, "/r/image");
  viewer.send("{}");  // its answer tells that the subscriptions are there
  viewer.text("status");
  EXPECT_EQ(viewer.channel("/r/image")["schemaName"], "foxglove.CompressedImage");
  const auto frame = plain_frame(1);
  robot.send_frame(frame);
  for (const std::uint32_t subscription : {9U, 3U}) {
    const Shown shown = viewer.shown();
    EXPECT_EQ(shown.subscription, subscription);
    EXPECT_EQ(shown.time_ns, static_cast<std::uint64_t>(frame.capture_time_ns));
    EXPECT_EQ(shown.payload, image_of(frame, "r", frame.jpeg));
  }
}

TEST_F(FoxgloveServerTest, AStereoRobotHasTheTopicsOfItsRecording) {
  auto viewer = view();
  const auto robot = this->robot(kCamera);
  robot.send_frame(plain_pair(0, 10, 20));
  viewer.subscribe(1, "/r/left/image");
  viewer.subscribe(2, "/r/right/image");
  viewer.subscribe(3, "/r/right/calibration");
  EXPECT_EQ(viewer.shown().subscription, 3U);
  const auto pair = plain_pair(1, 10, 20);
  robot.send_frame(pair);
  EXPECT_EQ(viewer.shown().payload, image_of(pair, "r/left", pair.left()));
  EXPECT_EQ(viewer.shown().payload, image_of(pair, "r/right", pair.right()));
}

TEST_F(FoxgloveServerTest, ALateSubscriberGetsTheCalibrationOfTheNewestSession) {
  const auto robot = this->robot(kCamera);
  robot.send_frame(plain_frame(0));
  EXPECT_TRUE(robot.acked(1));
  auto viewer = view();
  viewer.subscribe(1, "/r/calibration");
  const auto camera = calibrated_cameras(kCamera).left;
  const auto payload = foxglove::camera_calibration(0, "r", *camera);
  EXPECT_EQ(viewer.shown().payload, std::string(payload.begin(), payload.end()));

  const std::string other = "Pinhole 50 51 80 60 0\n160 120\nnone\n160 120\n";
  const auto again = this->robot(other, "s2");
  again.send_frame(plain_frame(0));
  const auto next = foxglove::camera_calibration(0, "r", *calibrated_cameras(other).left);
  EXPECT_EQ(viewer.shown().payload, std::string(next.begin(), next.end()));
}

TEST_F(FoxgloveServerTest, DropsAndFiguresAreJson) {
  auto viewer = view();
  const auto robot = this->robot();
  robot.send_frame(plain_frame(0));
  viewer.subscribe(1, "/r/drops");
  viewer.subscribe(2, "/r/status");
  viewer.send("{}");
  viewer.text("status");
  EXPECT_EQ(Json::parse(viewer.channel("/r/status")["schema"].get<std::string>())["title"],
            "orbbuf.Robot");
  robot.send_drops(0, {{1, 40'000'000, DropReason::kPolicy, 77}});
  const Shown drop = viewer.shown();
  EXPECT_EQ(drop.subscription, 1U);
  EXPECT_EQ(drop.time_ns, 40'000'000U);
  EXPECT_EQ(Json::parse(drop.payload)["similarity"], 77);
  robot.send(wire::encode(wire::Report{{3, 0, 0, 1, 1, 0, 1}, 25, 1000, 2'000'000, 40'000}));
  const Shown status = viewer.shown();
  EXPECT_EQ(status.subscription, 2U);
  const Json figures = Json::parse(status.payload);
  EXPECT_EQ(figures["state"], "connected");
  EXPECT_EQ(figures["report"]["link_rate"], 2'000'000);
}

TEST_F(FoxgloveServerTest, WhatAViewerSaysWrongIsAnsweredAndCostsNothingElse) {
  auto viewer = view();
  const auto robot = this->robot();
  robot.send_frame(plain_frame(0));
  const auto answer = [&] { return viewer.text("status")["message"].get<std::string>(); };
  viewer.send("not JSON");
  EXPECT_THAT(answer(), HasSubstr("not a message of Foxglove's WebSocket protocol"));
  viewer.send_binary("\1\2\3\4\5");
  EXPECT_THAT(answer(), HasSubstr("only publishes"));
  viewer.send(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":99}]})");
  EXPECT_EQ(answer(), "there is no channel 99");
  viewer.send(R"({"op":"unsubscribe","subscriptionIds":[1]})");
  EXPECT_EQ(answer(), "there is no subscription 1");
  viewer.subscribe(1, "/r/image");
  viewer.subscribe(1, "/r/image");
  EXPECT_EQ(answer(), "subscription 1 exists already");
  robot.send_frame(plain_frame(1));
  EXPECT_EQ(viewer.shown().subscription, 1U);
  viewer.send(R"({"op":"unsubscribe","subscriptionIds":[1]})");
  viewer.subscribe(2, "/r/image");
  viewer.send("{}");
  answer();
  robot.send_frame(plain_frame(2));
  EXPECT_EQ(viewer.shown().subscription, 2U);
}

TEST_F(FoxgloveServerTest, AMessageThatIsTooLongEndsTheConnection) {
  auto viewer = view();
  viewer.text();
  viewer.send(std::string(FoxgloveServer::kMostRequestBytes + 1, ' '));
  EXPECT_EQ(viewer.read_to_end(), 0U);
  EXPECT_TRUE(view().is_open());
}

TEST_F(FoxgloveServerTest, OneThatReadsNothingLosesMessagesAndNobodyElseDoes) {
  auto slow = view();
  auto quick = view();
  const auto robot = this->robot();
  constexpr std::size_t kBytes = 1'000'000;
  const auto large = [](Sequence sequence) {
    EncodedFrame frame = plain_frame(sequence);
    frame.jpeg.assign(kBytes, static_cast<std::uint8_t>(sequence));
    frame.jpeg_crc = wire::crc32(frame.jpeg);
    return frame;
  };
  robot.send_frame(large(0));
  for (Viewer* viewer : {&slow, &quick}) {
    viewer->subscribe(1, "/r/image");
    viewer->send("{}");
    viewer->text("status");
  }
  // Until no queue and no socket holds more. Not longer: a viewer that takes nothing for 10 s is
  // cut off.
  const HttpClient browser(server_->http_port());
  constexpr Sequence kMostFrames = 60;
  Sequence sent = 1;
  std::string metrics;
  do {
    const auto frame = large(sent++);
    robot.send_frame(frame);
    EXPECT_EQ(quick.shown().payload, image_of(frame, "r", frame.jpeg));
    metrics = browser.get("/metrics").body;
  } while (sent < kMostFrames &&
           metrics.find("orbbuf_foxglove_given_up_total 0") != std::string::npos);
  EXPECT_THAT(metrics, testing::ContainsRegex("orbbuf_foxglove_given_up_total [1-9]"));
  EXPECT_THAT(metrics, HasSubstr("orbbuf_foxglove_viewers 2"));
  EXPECT_TRUE(robot.acked(sent));
  const auto warning = slow.text("status");
  EXPECT_EQ(warning["level"], 1);
  EXPECT_THAT(warning["message"].get<std::string>(), HasSubstr("messages were not shown"));
}

TEST_F(FoxgloveServerTest, AConnectionThatBreaksUnderWayIsForgotten) {
  const auto robot = this->robot();
  robot.send_frame(plain_frame(0));
  {
    auto viewer = view();
    viewer.subscribe(1, "/r/image");
    viewer.send("{}");
    viewer.text("status");
    robot.send_frame(plain_frame(1));
    viewer.socket().set_option(tcp::socket::linger(true, 0));
    viewer.socket().close();
  }
  robot.send_frame(plain_frame(2));
  EXPECT_TRUE(robot.acked(3));
  const HttpClient browser(server_->http_port());
  while (browser.get("/metrics").body.find("orbbuf_foxglove_viewers 0") == std::string::npos) {
    std::this_thread::yield();
  }
}

TEST_F(FoxgloveServerTest, UnderTlsAViewerNeedsACertificate) {
  const Certificates keys;
  settings_.listen.tls = keys.server();
  start();
  const TlsSettings own = keys.robot();
  asio::ssl::context context(asio::ssl::context::tlsv13_client);
  context.use_certificate_chain_file(own.certificate.string());
  context.use_private_key_file(own.key.string(), asio::ssl::context::pem);
  asio::io_context io;
  websocket::stream<asio::ssl::stream<tcp::socket>> socket(io, context);
  socket.next_layer().next_layer().connect(
      {asio::ip::address_v4::loopback(), server_->http_port()});
  socket.next_layer().handshake(asio::ssl::stream_base::client);
  socket.set_option(websocket::stream_base::decorator([](websocket::request_type& request) {
    request.set(boost::beast::http::field::sec_websocket_protocol, "foxglove.sdk.v1");
  }));
  socket.handshake("localhost", "/");
  boost::beast::flat_buffer buffer;
  socket.read(buffer);
  EXPECT_THAT(boost::beast::buffers_to_string(buffer.data()), HasSubstr("serverInfo"));
}

TEST_F(FoxgloveServerTest, MoreThanItsViewersAreRefused) {
  std::vector<std::unique_ptr<Viewer>> viewers;
  start();
  for (std::size_t i = 0; i < FoxgloveServer::kMaxViewers; ++i) {
    viewers.push_back(std::make_unique<Viewer>(server_->http_port()));
    EXPECT_TRUE(viewers.back()->is_open());
  }
  EXPECT_FALSE(view().is_open());
}

}  // namespace
}  // namespace orbbuf::test
