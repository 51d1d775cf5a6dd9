// SPDX-License-Identifier: Apache-2.0
// Several servers, in this process, and a real etcd.
#include <gmock/gmock.h>

#include <algorithm>
#include <future>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "server/dataset/join_session.hpp"
#include "server/fleet/etcd_client.hpp"
#include "server/fleet/fetch_segment.hpp"
#include "server/session/session_reader.hpp"
#include "testing/captured_log.hpp"
#include "testing/real_etcd.hpp"
#include "testing/robot_client.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/http/http_client.hpp"
#include "tests/server/running_server.hpp"

namespace orbbuf {
namespace {

using test::RobotClient;
using test::RunningServer;

class HandOverTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::RealEtcd::is_installed()) GTEST_SKIP() << "etcd is not installed (etcd-server)";
    etcd_.emplace();
  }

  std::unique_ptr<RunningServer> start(const std::string& name) {
    Settings settings;
    settings.sinks.files_path = folder_ / name;
    settings.listen.hello_timeout = settings.listen.idle_timeout = std::chrono::minutes(10);
    settings.fleet.etcd = {parse_address(etcd_->endpoint()).value()};
    settings.fleet.name = name;
    settings.fleet.address = name + ":7722";
    settings.fleet.lease = std::chrono::seconds(60);
    settings.sinks.slam.command = slam_;
    settings.sinks.slam.format = PipeFormat::kMjpeg;
    settings.sinks.slam.resume = Resume::kBacklog;
    if (http_port_ != 0) {
      settings.http_address = Address{"127.0.0.1", http_port_};
      settings.fleet.http = to_string(*settings.http_address);
    }
    const auto before = log_.lines(name + " has joined").size();
    auto server = std::make_unique<RunningServer>(settings);
    log_.wait_for(name + " has joined", before + 1);
    return server;
  }
  static void send(const RobotClient& robot, Sequence first, Sequence end) {
    for (Sequence i = first; i < end; ++i) robot.send_frame(*test::jpeg_like_frame_ptr(i));
  }
  /// Returns when no robot is there; its end is when all are elsewhere.
  std::future<std::optional<Error>> drain(RunningServer& server) const {
    auto drained = std::async(std::launch::async, [&server] { return server.drain(); });
    log_.wait_for("drained: no robot is here");
    return drained;
  }
  static nlohmann::json fleet_json(std::uint16_t http_port) {
    const auto answer = test::HttpClient(http_port).get("/fleet.json");
    EXPECT_EQ(answer.status, 200) << answer.body;
    return nlohmann::json::parse(answer.body);
  }
  /// The next servers have a SLAM program that keeps what it reads.
  void begin_slam(const std::string& file) { slam_ = "cat > " + (folder_ / file).string(); }
  /// What it has read when that has the last one: each frame's number and `missed`.
  std::vector<std::string> read_by_slam(const std::string& file, Sequence last) const {
    const std::regex note("(seq|missed)=[0-9]+");
    for (;;) {
      const std::string text = test::read_file(folder_ / file);
      std::vector<std::string> notes;
      for (std::sregex_iterator at(text.begin(), text.end(), note), end; at != end; ++at) {
        const std::string word = at->str();
        notes.push_back(word.starts_with("seq=") ? word.substr(4) : word);
      }
      if (std::ranges::find(notes, std::to_string(last)) != notes.end()) return notes;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  /// A robot that comes, delivers these frames, and leaves.
  static void deliver(const RunningServer& server, Sequence first, Sequence end) {
    const RobotClient robot(server.port());
    ASSERT_TRUE(robot.hello("robot", "s"));
    send(robot, first, end);
    ASSERT_TRUE(robot.acked(end));
  }
  /// All keys of sessions.
  std::vector<KeyValue> snapshot() const {
    boost::asio::io_context io;
    EtcdClient client(io, {{parse_address(etcd_->endpoint()).value()}, {}});
    std::optional<Result<std::vector<KeyValue>>> found;
    client.async_range(KeyRange("/orbbuf/"),
                       [&](auto answer) { found.emplace(std::move(answer)); });
    while (!found) io.run_one();
    std::vector<KeyValue> keys = found->value();
    std::erase_if(keys, [](const KeyValue& key) { return key.key.starts_with(fleet::kServers); });
    return keys;
  }
  /// As a restore of etcd does.
  void restore(const std::vector<KeyValue>& keys) const {
    boost::asio::io_context io;
    EtcdClient client(io, {{parse_address(etcd_->endpoint()).value()}, {}});
    KeyTxn txn;
    for (const KeyValue& key : keys) txn.puts.push_back({key.key, key.value});
    std::optional<bool> is_done;
    client.async_txns({txn}, [&](const auto& answer) { is_done = answer.value().front().is_done; });
    while (!is_done) io.run_one();
    ASSERT_TRUE(*is_done);
  }
  /// The folder of the only later segment that the server has of it.
  std::string segment_at(const std::string& server) const {
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / server / "robot")) {
      const std::string name = entry.path().filename();
      if (name.starts_with("s.e")) found.push_back(server + "/robot/" + name);
    }
    EXPECT_EQ(found.size(), 1U) << server;
    return found.at(0);
  }
  std::uint64_t epoch_at(const std::string& server) const {
    return read_summary(folder_ / segment_at(server))->info.segment.epoch;
  }
  std::vector<Sequence> frames_in(const std::string& folder) const {
    std::vector<Sequence> sequences;
    const auto session = read_session(folder_ / folder);
    if (!session) return sequences;
    for (const auto& frame : session.value().frames) sequences.push_back(frame.sequence);
    return sequences;
  }

  test::TemporaryFolder folder_;
  test::CapturedLog log_;
  std::string slam_;
  std::uint16_t http_port_ = 0;  // of the next server's page; 0: none
  std::optional<test::RealEtcd> etcd_;
};

TEST_F(HandOverTest, WhatAnEndedServerHasAcknowledgedStaysItsAndTheNextGoesOnThere) {
  auto a = start("a");
  {
    const RobotClient robot(a->port());
    ASSERT_EQ(robot.hello("robot", "s"), wire::Position{});
    send(robot, 0, 3);
    ASSERT_TRUE(robot.acked(3));
  }
  a->stop();
  const auto b = start("b");
  const RobotClient robot(b->port());
  ASSERT_EQ(robot.hello("robot", "s"), (wire::Position{3, 0}));
  send(robot, 3, 5);
  ASSERT_TRUE(robot.acked(5));
  EXPECT_EQ(frames_in("a/robot/s"), (std::vector<Sequence>{0, 1, 2}));
  EXPECT_EQ(frames_in(segment_at("b")), (std::vector<Sequence>{3, 4}));
  const auto summary = read_summary(folder_ / segment_at("b"));
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->info.segment.from, (wire::Position{3, 0}));
  EXPECT_GT(summary->info.segment.epoch, 1U);
}

TEST_F(HandOverTest, ARobotThatComesIsTakenAlsoWhenItsOwnerLives) {
  const auto a = start("a");
  const auto b = start("b");
  const RobotClient at_a(a->port());
  ASSERT_TRUE(at_a.hello("robot", "s"));
  send(at_a, 0, 2);
  ASSERT_TRUE(at_a.acked(2));
  const RobotClient again(b->port());
  EXPECT_EQ(again.hello("robot", "s"), (wire::Position{2, 0}));

  send(at_a, 2, 3);  // the old owner still has its connection
  std::optional<wire::Ack> ack = at_a.whole_ack();
  while (ack) {
    EXPECT_EQ(ack->position[wire::kFrames], 2U);  // it has received it, and acknowledges nothing
    ack = at_a.whole_ack();
  }
  log_.wait_for("another server has this session");
  send(again, 2, 4);
  EXPECT_TRUE(again.acked(4));
  EXPECT_EQ(frames_in(segment_at("b")), (std::vector<Sequence>{2, 3}));
}

TEST_F(HandOverTest, AServerThatIsStartedAgainGoesOnInItsFolder) {
  auto a = start("a");
  ASSERT_NO_FATAL_FAILURE(deliver(*a, 0, 2));
  a->stop();
  a = start("a");
  const RobotClient robot(a->port());
  ASSERT_EQ(robot.hello("robot", "s"), (wire::Position{2, 0}));
  send(robot, 2, 3);
  ASSERT_TRUE(robot.acked(3));
  EXPECT_EQ(frames_in("a/robot/s"), (std::vector<Sequence>{0, 1, 2}));
}

TEST_F(HandOverTest, WithoutEtcdFramesAreReceivedAndNotAcknowledgedAndNewSessionsWait) {
  const auto a = start("a");
  const RobotClient robot(a->port());
  ASSERT_TRUE(robot.hello("robot", "s"));
  etcd_->kill();
  send(robot, 0, 3);
  std::optional<wire::Ack> ack;
  do {
    ack = robot.whole_ack();
    ASSERT_TRUE(ack);
    EXPECT_EQ(ack->position[wire::kFrames], 0U);
  } while (ack->received != Sequence{3});
  const RobotClient other(a->port());
  other.send_hello("other", "s");
  const auto error = other.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, wire::ErrorCode::kRefused);
  EXPECT_THAT(error->text, testing::HasSubstr("the fleet's etcd does not answer"));
  etcd_->start();
  EXPECT_TRUE(robot.acked(3));
}

/// C1: two says nothing more.
TEST_F(HandOverTest, ADrainSendsTheRobotsAwayOneByOneAndTheOtherTakesThemAtOnce) {
  const auto a = start("a");
  const auto b = start("b");
  const RobotClient one(a->port());
  const RobotClient two(a->port());
  ASSERT_TRUE(one.hello("one", "s"));
  ASSERT_TRUE(two.hello("two", "s"));
  send(one, 0, 5);
  auto drained = drain(*a);
  std::optional<wire::Ack> ack = one.whole_ack();
  EXPECT_TRUE(ack);
  const RobotClient moved(b->port());
  const auto position = moved.hello("one", "s");
  ASSERT_TRUE(position);
  EXPECT_GE(5U, (*position)[wire::kFrames]);
  const auto error = drained.get();
  ASSERT_TRUE(error) << "two did not go";
  EXPECT_THAT(error->text, testing::EndsWith("right? two/s"));
  const RobotClient two_moved(b->port());
  EXPECT_TRUE(two_moved.hello("two", "s"));
  EXPECT_FALSE(a->drain()) << "now it has";
  const RobotClient late(a->port());
  late.send_hello("three", "s");
  const auto sent = late.error();
  ASSERT_TRUE(sent);
  EXPECT_EQ(sent->code, wire::ErrorCode::kMoved);
  EXPECT_EQ(sent->text, "b:7722");
}

TEST_F(HandOverTest, TheSegmentsAreFoundInEtcdAndFetchedFromTheServersPages) {
  auto a = start("a");
  ASSERT_NO_FATAL_FAILURE(deliver(*a, 0, 2));
  a->stop();
  http_port_ = test::free_ports(1)[0];
  const auto b = start("b");
  const RobotClient robot(b->port());
  ASSERT_TRUE(robot.hello("robot", "s"));
  send(robot, 2, 4);
  ASSERT_TRUE(robot.acked(4));
  const auto found =
      fleet::find_session({parse_address(etcd_->endpoint()).value()}, {"robot", "s"});
  ASSERT_TRUE(found) << found.error().text;
  ASSERT_EQ(found.value().segments.size(), 2U);
  EXPECT_EQ(found.value().segments[0].segment, (fleet::Segment{"a", 1, {}}));
  EXPECT_EQ(found.value().segments[0].http, "");  // it does not live
  EXPECT_EQ(found.value().segments[1].segment, (fleet::Segment{"b", epoch_at("b"), {2, 0}}));
  const auto page = parse_address(found.value().segments[1].http);
  ASSERT_TRUE(page);
  const std::filesystem::path there = folder_ / segment_at("b");
  const auto error =
      fleet::fetch_segment(page.value(), "robot", there.filename(), folder_ / "fetched");
  EXPECT_FALSE(error) << error->text;
  EXPECT_EQ(frames_in("fetched"), (std::vector<Sequence>{2, 3}));
  for (const char* const file : {"journal.000000", "images/000003.jpg"}) {
    EXPECT_EQ(test::read_file(folder_.path() / "fetched" / file), test::read_file(there / file));
  }
}

TEST_F(HandOverTest, TheNextOwnersProgramGetsAllFramesInOrderFromEveryServer) {
  auto a = start("a");
  ASSERT_NO_FATAL_FAILURE(deliver(*a, 0, 5));
  a->stop();
  http_port_ = test::free_ports(1)[0];
  const auto b = start("b");
  ASSERT_NO_FATAL_FAILURE(deliver(*b, 5, 9));
  http_port_ = 0;
  begin_slam("read.mjpeg");
  a = start("a");
  log_.wait_for("connection lost", 2);
  EXPECT_FALSE(b->drain());
  const RobotClient robot(a->port());
  ASSERT_EQ(robot.hello("robot", "s"), (wire::Position{9, 0}));
  send(robot, 9, 10);
  EXPECT_EQ(read_by_slam("read.mjpeg", 9),
            (std::vector<std::string>{"0", "1", "2", "3", "4", "5", "6", "7", "8", "9"}));
  send(robot, 10, 12);
  EXPECT_EQ(read_by_slam("read.mjpeg", 11).size(), 12U);
  EXPECT_TRUE(robot.acked(12));
  EXPECT_EQ(log_.lines("are passed over").size(), 0U);
}

TEST_F(HandOverTest, FramesOfADeadServerAreMissedByTheProgramAndHoldNothing) {
  auto a = start("a");
  ASSERT_NO_FATAL_FAILURE(deliver(*a, 0, 3));
  a->stop();
  begin_slam("read.mjpeg");
  const auto b = start("b");
  const RobotClient robot(b->port());
  ASSERT_TRUE(robot.hello("robot", "s"));
  send(robot, 3, 5);
  EXPECT_TRUE(robot.acked(5));
  EXPECT_EQ(log_.lines("are passed over").size(), 0U);  // it still waits for that server
  EXPECT_EQ(read_by_slam("read.mjpeg", 4), (std::vector<std::string>{"3", "missed=3", "4"}));
  EXPECT_EQ(log_.lines("robot/s: frames 0 to 2 are passed over: segment s of server a: the server "
                       "does not live, or has no page")
                .size(),
            1U);
}

TEST_F(HandOverTest, AMoveDoesNotWaitForAProgramThatCatchesUp) {
  auto a = start("a");
  ASSERT_NO_FATAL_FAILURE(deliver(*a, 0, 3));
  a->stop();
  begin_slam("read.mjpeg");
  const auto b = start("b");  // whose program waits for a
  const auto c = start("c");
  const RobotClient robot(b->port());
  ASSERT_TRUE(robot.hello("robot", "s"));
  send(robot, 3, 5);
  EXPECT_TRUE(robot.acked(5));
  const auto begun = std::chrono::steady_clock::now();
  auto drained = drain(*b);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::milliseconds(1500));
  EXPECT_TRUE(RobotClient(c->port()).hello("robot", "s"));
  EXPECT_FALSE(drained.get());
}

TEST_F(HandOverTest, ThePageTellsOfAllServersAndSessions) {
  const auto ports = test::free_ports(2);
  http_port_ = ports[0];
  auto a = start("a");
  http_port_ = ports[1];
  const auto b = start("b");
  std::future<std::optional<Error>> drained;
  {
    const RobotClient robot(a->port());
    ASSERT_TRUE(robot.hello("robot", "s"));
    send(robot, 0, 3);
    ASSERT_TRUE(robot.acked(3));
    const auto overview = fleet_json(b->http_port());
    EXPECT_EQ(overview["etcd"][0], etcd_->endpoint());
    ASSERT_EQ(overview["servers"].size(), 2U);
    EXPECT_EQ(overview["servers"][0]["name"], "a");
    EXPECT_EQ(overview["servers"][0]["address"], "a:7722");
    EXPECT_EQ(overview["servers"][0]["http"], "127.0.0.1:" + std::to_string(ports[0]));
    EXPECT_EQ(overview["servers"][0]["draining"], false);
    ASSERT_EQ(overview["sessions"].size(), 1U);
    EXPECT_EQ(overview["sessions"][0]["server"], "a");
    EXPECT_EQ(overview["sessions"][0]["epoch"], 1);
    EXPECT_EQ(overview["sessions"][0]["next"][0], 3);
    drained = drain(*a);
  }
  const RobotClient robot(b->port());
  ASSERT_TRUE(robot.hello("robot", "s"));
  EXPECT_FALSE(drained.get());
  auto overview = fleet_json(b->http_port());
  while (overview["sessions"][0]["server"] == "a") {  // what was read for the first one
    std::this_thread::yield();
    overview = fleet_json(b->http_port());
  }
  EXPECT_EQ(overview["servers"][0]["draining"], true);
  const auto& session = overview["sessions"][0];
  EXPECT_EQ(session["robot"], "robot");
  EXPECT_EQ(session["session"], "s");
  EXPECT_EQ(session["server"], "b");
  EXPECT_EQ(session["ended"], false);
  ASSERT_EQ(session["segments"].size(), 2U);
  EXPECT_EQ(session["segments"][1]["server"], "b");
  EXPECT_GT(session["segments"][1]["epoch"], 1);
  EXPECT_EQ(session["segments"][1]["next"][0], 3);
  const auto page = test::HttpClient(b->http_port()).get("/fleet");
  EXPECT_EQ(page.status, 200);
  EXPECT_THAT(page.body, testing::HasSubstr(R"(<a href="/fleet" data-nav="fleet">Fleet</a>)"));
}

/// B4: etcd knows nothing of what b has, nor of the epoch that it gave out.
TEST_F(HandOverTest, AfterARestoreOfEtcdNoEpochComesAgainAndNothingOnADiskIsLost) {
  auto a = start("a");
  ASSERT_NO_FATAL_FAILURE(deliver(*a, 0, 3));
  a->stop();
  const auto before = snapshot();
  auto b = start("b");
  ASSERT_NO_FATAL_FAILURE(deliver(*b, 3, 5));
  b->stop();
  ASSERT_NO_FATAL_FAILURE(restore(before));

  b = start("b");
  {
    const RobotClient robot(b->port());
    ASSERT_EQ(robot.hello("robot", "s"), (wire::Position{5, 0})) << "its journal knows";
    send(robot, 5, 6);
    ASSERT_TRUE(robot.acked(6));
  }
  b->stop();
  ASSERT_NO_FATAL_FAILURE(restore(before));

  const auto c = start("c");
  const RobotClient robot(c->port());
  ASSERT_EQ(robot.hello("robot", "s"), (wire::Position{3, 0})) << "it knows what etcd does";
  robot.send_drops(
      0, {{3, 0, DropReason::kLost}, {4, 0, DropReason::kLost}, {5, 0, DropReason::kLost}});
  send(robot, 6, 7);
  ASSERT_TRUE(robot.acked(7));
  EXPECT_GT(epoch_at("c"), epoch_at("b"));
  const auto joined =
      join_session({folder_ / "a/robot/s", folder_ / segment_at("b"), folder_ / segment_at("c")},
                   folder_ / "out");
  ASSERT_TRUE(joined) << joined.error().text;
  EXPECT_EQ(joined.value().problems, std::vector<std::string>());
  EXPECT_EQ(frames_in("out"), (std::vector<Sequence>{0, 1, 2, 3, 4, 5, 6}));
  EXPECT_TRUE(test::read_lines(folder_ / "out/drops.csv").empty());
}

TEST_F(HandOverTest, WithoutEtcdThePageSaysSo) {
  http_port_ = test::free_ports(1)[0];
  const auto a = start("a");
  etcd_->kill();
  const auto answer = test::HttpClient(a->http_port()).get("/fleet.json");
  EXPECT_EQ(answer.status, 503);
  EXPECT_THAT(answer.body, testing::HasSubstr("etcd"));
}

TEST_F(HandOverTest, ADrainNeedsAnotherServer) {
  const auto a = start("a");
  const auto error = a->drain();
  ASSERT_TRUE(error);
  EXPECT_THAT(error->text, testing::HasSubstr("no other server"));
}

TEST_F(HandOverTest, ASessionIdThatNamesASegmentIsRefused) {
  const auto a = start("a");
  const RobotClient robot(a->port());
  robot.send_hello("robot", "s.e7");
  const auto error = robot.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, wire::ErrorCode::kRefused);
}

}  // namespace
}  // namespace orbbuf
