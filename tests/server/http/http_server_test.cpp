// SPDX-License-Identifier: Apache-2.0
#include "server/http/http_server.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <poll.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "server/http/views.hpp"
#include "testing/captured_log.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/http/http_client.hpp"
#include "tests/server/link/listener_fixture.hpp"

namespace orbbuf::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

/// A whole server with its page, and a robot `r` in session `s` that has sent two frames, dropped
/// one and sent its stats.
class HttpServerTest : public ListenerTest {
 protected:
  HttpServerTest() { settings_.http_address = Address{"127.0.0.1", 0}; }

  HttpClient browse() {
    if (!server_) start();
    return HttpClient(server_->http_port());
  }
  HttpAnswer get(const std::string& path) { return browse().get(path); }
  RobotClient stream() {
    RobotClient robot = connect();
    robot.hello("r", "s");
    robot.send_frame(plain_frame(0));
    robot.send_drops(0, {{1, 40'000'000, DropReason::kPolicy, 77}});
    robot.send(
        wire::encode(wire::Report{{3, 0, 0, 1, 1, 0, 1}, 25, 1000, 2'000'000, 40'000, 0, 5}));
    robot.send_frame(plain_frame(2));
    EXPECT_TRUE(robot.acked(3));
    return robot;
  }
  fs::path session() const { return folder_ / "data/r/s"; }
};

TEST_F(HttpServerTest, SaysThatItIsWell) {
  const HttpAnswer answer = get("/healthz");
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(answer.body, "ok\n");
}

TEST_F(HttpServerTest, SaysThatItIsWellWhileTheDiskIsSlow) {
  make_unreadable("a/s");
  make_unreadable("b/s");  // the pool has two threads
  const RobotClient a = connect();
  a.send_hello("a", "s");
  const RobotClient b = connect();
  b.send_hello("b", "s");
  while (!server_->has_session("b", "s")) std::this_thread::yield();
  EXPECT_EQ(get("/healthz").status, 200);
  EXPECT_EQ(get("/metrics").status, 200);
  EXPECT_FALSE(has_answer(a, 0) || has_answer(b, 0));
  finish_reading("a/s");
  finish_reading("b/s");
  EXPECT_TRUE(a.welcome() && b.welcome());
}

TEST_F(HttpServerTest, SaysWhichStreamIsPausedAndWhy) {
  const RobotClient robot = stream();
  fs::rename(session(), folder_ / "aside");
  write_file(session(), "a file where the folder should be");
  robot.send_frame(plain_frame(3));
  log_.wait_for("stream paused");
  const HttpAnswer answer = get("/healthz");
  EXPECT_EQ(answer.status, 503);
  EXPECT_THAT(answer.body, testing::MatchesRegex("r s: stream paused: .*Not a directory\n"));
  EXPECT_THAT(get("/metrics").body, HasSubstr("orbbuf_stream_paused{robot=\"r\"} 1"));
  fs::remove(session());
  fs::rename(folder_ / "aside", session());
  EXPECT_TRUE(robot.acked(4));
  EXPECT_EQ(get("/healthz").body, "ok\n");
  EXPECT_THAT(get("/metrics").body, HasSubstr("orbbuf_stream_paused{robot=\"r\"} 0"));
}

TEST_F(HttpServerTest, ThePageIsOneFileThatLoadsNothingFromElsewhere) {
  const HttpAnswer answer = get("/");
  EXPECT_EQ(answer.status, 200);
  EXPECT_THAT(answer.head, HasSubstr("Content-Type: text/html"));
  EXPECT_THAT(answer.head, HasSubstr("default-src 'none'; script-src 'sha256-"));
  EXPECT_LT(answer.body.size(), 150'000U);
  for (const char* outside : {"http://", "https://", "//cdn", " src=", "@import", "url("}) {
    std::string body = answer.body;
    const std::string svg = "http://www.w3.org/2000/svg";  // a name, never fetched
    for (std::size_t at = body.find(svg); at != std::string::npos; at = body.find(svg)) {
      body.erase(at, svg.size());
    }
    EXPECT_THAT(body, Not(HasSubstr(outside)));
  }
  EXPECT_EQ(get("/sessions/r/s").body, answer.body);
}

TEST_F(HttpServerTest, RobotsAreListedWithTheirStats) {
  const RobotClient robot = stream();
  const std::string json = get("/api/robots").body;
  for (const char* part :
       {R"("robot":"r","session":"s","state":"connected","connections":1,"frames":2,)",
        R"("drops":1,)", R"("captured":3,"skipped":0,"failed":0,"dropped":1,"acknowledged":1,)",
        R"("waiting":0,"in_flight":1,"capacity":25,"waiting_bytes":1000,)",
        R"("link_rate":2000000,"round_trip_us":40000,"irreducible":5})",
        R"("image":{"sequence":2,)", ",77,"}) {
    EXPECT_THAT(json, HasSubstr(part));
  }
}

TEST_F(HttpServerTest, OfTheTimelineOnlyWhatHasChangedIsSentAgain) {
  const RobotClient robot = stream();
  const std::string all = get("/api/robots").body;
  EXPECT_THAT(all, HasSubstr("\"seconds\":[["));
  const std::size_t clock = all.find("\"clock_ms\":") + 11;
  const auto later = std::stoull(all.substr(clock)) + 1;
  EXPECT_THAT(get("/api/robots?since=" + std::to_string(later)).body, HasSubstr("\"seconds\":[]"));
}

TEST_F(HttpServerTest, MetricsAreTheSameStats) {
  const RobotClient robot = stream();
  const HttpAnswer answer = get("/metrics");
  EXPECT_THAT(answer.head, HasSubstr("text/plain; version=0.0.4"));
  for (const char* line :
       {"orbbuf_session_info{robot=\"r\",session=\"s\"} 1", "orbbuf_robot_connected{robot=\"r\"} 1",
        "orbbuf_frames_total{robot=\"r\"} 2", "orbbuf_drop_records_total{robot=\"r\"} 1",
        "orbbuf_unpublished_frames_total{robot=\"r\"} 0",
        "orbbuf_robot_captured_total{robot=\"r\"} 3", "orbbuf_robot_dropped_total{robot=\"r\"} 1",
        "orbbuf_robot_buffer_capacity_frames{robot=\"r\"} 25",
        "orbbuf_robot_irreducible_total{robot=\"r\"} 5",
        "orbbuf_robot_round_trip_seconds{robot=\"r\"} 0.04"}) {
    EXPECT_THAT(answer.body, HasSubstr(std::string(line) + "\n"));
  }
}

TEST_F(HttpServerTest, WhatArrivesLateIsShownAndCounted) {
  Metrics metrics(1);
  const auto robot = metrics.begin({"r", "s", ""});
  const auto json = [&] { return to_json(metrics, 0, RobotMetrics::Time()); };
  const auto prometheus = [&] { return to_prometheus(metrics, RobotMetrics::Time()); };
  EXPECT_THAT(json(), HasSubstr(R"("late":0,"late_total":0,"reduced":0,"now":)"));
  EXPECT_THAT(prometheus(), Not(HasSubstr("orbbuf_on_robot")));
  robot->on_late(true);
  robot->on_late(false);
  robot->on_spool(3, 10);
  EXPECT_THAT(
      json(),
      HasSubstr(R"("late":1,"late_total":2,"reduced":0,"on_robot":3,"on_robot_total":10,)"));
  EXPECT_THAT(prometheus(), HasSubstr("orbbuf_late_total{robot=\"r\"} 2\n"));
  EXPECT_THAT(prometheus(), HasSubstr("orbbuf_on_robot{robot=\"r\"} 10\n"));
  EXPECT_THAT(robot_schema(), HasSubstr(R"("on_robot_total":{"type":"number"})"));
}

TEST_F(HttpServerTest, QualityAndReducedFramesAreShownAndCounted) {
  Metrics metrics(1);
  const auto robot = metrics.begin({"r", "s", ""});
  const auto json = [&] { return to_json(metrics, 0, RobotMetrics::Time()); };
  const auto prometheus = [&] { return to_prometheus(metrics, RobotMetrics::Time()); };
  EXPECT_THAT(json(), Not(HasSubstr("\"quality\":")));
  EXPECT_THAT(prometheus(), Not(HasSubstr("orbbuf_frame_quality")));
  EXPECT_THAT(prometheus(), HasSubstr("orbbuf_frames_reduced_total{robot=\"r\"} 0\n"));
  robot->on_samples("imu0", 0, 3, std::vector<Sample>{{2'000'000'000, {0, 0, 1}, {}}});
  EXPECT_THAT(json(), HasSubstr(R"("streams":[{"name":"imu0","captured":0,"samples":1,"waiting":0,)"
                                R"("lost":3,"rate":)"));
  EXPECT_THAT(json(), HasSubstr(R"("seconds":[[2,1,3,57,0]])"));
  EXPECT_THAT(to_json(*robot, RobotMetrics::Time()), Not(HasSubstr("\"seconds\":")));
  EXPECT_THAT(prometheus(), HasSubstr("orbbuf_samples_total{robot=\"r\",stream=\"imu0\"} 1\n"));
  robot->on_delivered(std::make_shared<EncodedFrame>(reduced_frame(0)));
  EXPECT_THAT(json(), AllOf(HasSubstr(R"("reduced":1,)"), HasSubstr(R"("quality":30,)")));
  EXPECT_THAT(prometheus(), HasSubstr("orbbuf_frames_reduced_total{robot=\"r\"} 1\n"));
  EXPECT_THAT(prometheus(), HasSubstr("orbbuf_frame_quality{robot=\"r\"} 30\n"));
  for (const char* name : {"reduced", "quality", "irreducible"}) {
    EXPECT_THAT(robot_schema(), HasSubstr(fmt::format(R"("{}":{{"type":"number"}})", name)));
  }
}

TEST_F(HttpServerTest, WithoutRobotsThereAreNoMetrics) { EXPECT_EQ(get("/metrics").status, 200); }

TEST_F(HttpServerTest, TheNewestImageIsServedByteForByte) {
  EXPECT_EQ(get("/robots/r/image").status, 404);
  const RobotClient robot = stream();
  const HttpAnswer answer = get("/robots/r/image");
  EXPECT_THAT(answer.head, HasSubstr("Content-Type: image/jpeg"));
  const EncodedFrame frame = plain_frame(2);
  EXPECT_EQ(answer.body, std::string(frame.jpeg.begin(), frame.jpeg.end()));
}

TEST_F(HttpServerTest, SessionsAreReadFromTheDisk) {
  const RobotClient robot = stream();
  EXPECT_EQ(get("/api/sessions").body, "{\"names\":[\"r\"]}\n");
  EXPECT_EQ(get("/api/sessions/r").body, "{\"names\":[\"s\"]}\n");
  EXPECT_THAT(get("/api/sessions/r/s").body, HasSubstr("\"calibration\":null"));
  EXPECT_EQ(get("/sessions/r/s/times.txt").body, read_file(session() / "times.txt"));
  EXPECT_EQ(get("/sessions/r/s/images/000002.jpg").body,
            read_file(session() / "images/000002.jpg"));
  robot.send(wire::encode(wire::Bye{{3, 1}}));
  ASSERT_TRUE(robot.bye());
  EXPECT_THAT(get("/sessions/r/s/drops.csv").body, HasSubstr("\n1,policy,"));
}

TEST_F(HttpServerTest, AFileOfManyPiecesComesWhole) {
  const RobotClient robot = stream();
  std::string lines;
  while (lines.size() < 10 * ServedFile::kPieceBytes + 7) lines += std::to_string(lines.size());
  write_file(session() / "camera.txt", lines);
  EXPECT_EQ(get("/sessions/r/s/camera.txt").body, lines);
}

TEST_F(HttpServerTest, NoPathLeadsElsewhere) {
  const RobotClient robot = stream();
  write_file(folder_ / "data/r/secret.txt", "x");
  fs::create_symlink("/etc/passwd", session() / "camera.txt");
  for (const char* path :
       {"/sessions/../x/times.txt", "/sessions/r/../times.txt", "/sessions/r/s/../secret.txt",
        "/sessions/r/s/secret.txt", "/sessions/r/s/camera.txt", "/sessions/r/s/images/..",
        "/sessions/r/s/images/..jpg", "/sessions/r/s/images/.jpg", "/sessions/r/s/images/1",
        "/sessions/r/%2e%2e/times.txt", "/sessions/r/s/images/%2e%2e.jpg", "/api/sessions/..",
        "/api/sessions/r/..", "/api/sessions/r/s/images", "/robots/../image", "/robots/r",
        "/metrics/x", "/favicon.ico"}) {
    EXPECT_EQ(get(path).status, 404) << path;
  }
}

TEST_F(HttpServerTest, WithoutFilesThereAreNoSessionsToSee) {
  settings_.sinks.files_enabled = false;
  settings_.sinks.slam.command = "cat >/dev/null";
  const RobotClient robot = stream();
  EXPECT_EQ(get("/api/sessions").status, 404);
  EXPECT_EQ(get("/robots/r/image").status, 200);
}

TEST_F(HttpServerTest, AConnectionServesRequestAfterRequest) {
  const HttpClient client = browse();
  for (int i = 0; i < 3; ++i) EXPECT_EQ(client.get("/healthz").status, 200);
  client.send(
      "HEAD /metrics HTTP/1.1\r\nHost: [::1]:80\r\n\r\nGET /no HTTP/1.1\r\n"
      "Host: 127.0.0.1:1\r\nConnection: close\r\n\r\n");
  EXPECT_EQ(client.read(true).status, 200);
  EXPECT_EQ(client.read().status, 404);
  EXPECT_TRUE(client.is_closed());
}

TEST_F(HttpServerTest, OnlyReadingIsAllowed) {
  const HttpClient client = browse();
  client.send("DELETE /sessions/r/s HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const HttpAnswer answer = client.read();
  EXPECT_EQ(answer.status, 405);
  EXPECT_THAT(answer.head, HasSubstr("Allow: GET, HEAD\r\n"));
}

TEST_F(HttpServerTest, AForeignNameIsNotServedOnLoopback) {
  for (const char* host : {"evil.example", "evil.example:80", "localhost.evil.example", ""}) {
    const HttpClient client = browse();
    client.send("GET / HTTP/1.1\r\nHost: " + std::string(host) + "\r\n\r\n");
    EXPECT_EQ(client.read().status, 421) << host;
  }
}

TEST_F(HttpServerTest, NonsenseIsAnsweredAndTheConnectionClosed) {
  const HttpClient client = browse();
  client.send("\x16\x03\x01\x02\x03\x04\r\n\r\n");
  EXPECT_EQ(client.read().status, 400);
  EXPECT_TRUE(client.is_closed());
}

TEST_F(HttpServerTest, ARequestInDropsIsCutWhenItsTimeIsOver) {
  const HttpClient client = browse();
  const std::string_view drops = "GET / HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\n";
  const auto is_cut = [&] {
    pollfd events{client.fd(), POLLIN, 0};
    return ::poll(&events, 1, 500) > 0;
  };
  std::size_t sent = 0;
  do {
    client.send(drops.substr(sent++, 1));
  } while (!is_cut() && sent < drops.size());
  EXPECT_LT(sent, drops.size()) << "no end of the connection, 0.5 s after the last of all bytes";
  EXPECT_TRUE(client.is_closed());
}

TEST_F(HttpServerTest, WhoDoesNotReadIsCutAndOthersAreServed) {
  const RobotClient robot = stream();
  write_file(session() / "camera.txt", std::string(64 << 20, 'x'));
  const HttpClient slow = browse();
  slow.send("GET /sessions/r/s/camera.txt HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_EQ(get("/healthz").status, 200);
  robot.send_frame(plain_frame(3));
  EXPECT_TRUE(robot.acked(4));
  // Each waits its turn between the answer's pieces, so by then nothing more of that can be sent.
  const HttpClient other = browse();
  for (int i = 0; i < 200; ++i) ASSERT_EQ(other.get("/healthz").status, 200);
  static_assert(HttpServer::kPieceTime <= HttpServer::kRequestTime);
  const HttpClient clock = browse();  // is cut no sooner
  clock.send("GET");
  EXPECT_TRUE(clock.is_closed());
  EXPECT_EQ(slow.read().status, 0) << "all of it came, or nothing ended";
}

/// C4
TEST_F(HttpServerTest, WhoAsksIsAnsweredAlsoBesideManyWhoOnlyConnect) {
  std::vector<HttpClient> half;
  for (std::size_t i = 0; i < 3 * HttpServer::kMaxConnections; ++i) {
    half.push_back(browse());
    half.back().send("GET /heal");
    if (i % 8 != 0) continue;
    ASSERT_EQ(get("/healthz").status, 200) << "after " << i;
  }
  EXPECT_TRUE(half.front().is_closed());
  half.back().send("thz HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_EQ(half.back().read().status, 200);
}

TEST_F(HttpServerTest, AnAddressInUseIsNamed) {
  start();
  Settings second = settings_;
  second.http_address->port = server_->http_port();
  try {
    RunningServer taken(second);
    FAIL() << "listens twice";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("serve http on 127.0.0.1:"));
    EXPECT_THAT(error.what(), HasSubstr("Address already in use"));
  }
}

}  // namespace
}  // namespace orbbuf::test
