// SPDX-License-Identifier: Apache-2.0
// A fleet of real servers and a real etcd, and the commands `drain` and `join`.
#include <fmt/core.h>
#include <gmock/gmock.h>

#include <csignal>
#include <regex>

#include "common/wire.hpp"
#include "testing/certificates.hpp"
#include "testing/real_etcd.hpp"
#include "testing/robot_client.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::test {
namespace {

using testing::ContainsRegex;
using testing::HasSubstr;

class FleetTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!RealEtcd::is_installed()) GTEST_SKIP() << "etcd is not installed (etcd-server)";
    etcd_ = std::make_unique<RealEtcd>();
  }

  /// Server `a` or `b`, or both again on their ports.
  std::unique_ptr<Server> start(const std::string& name, const Overrides& more = {}) const {
    const std::size_t first = name == "a" ? 0 : 2;
    const std::string page = "127.0.0.1:" + std::to_string(ports_[first + 1]);
    Overrides overrides{"fleet.etcd=[\"" + etcd_->endpoint() + "\"]",
                        "fleet.name=" + name,
                        "fleet.address=" + address(name),
                        "fleet.http=" + page,
                        "http.address=" + page,
                        "status.socket=" + socket(name),
                        "session.drain_timeout=60 s"};
    overrides.insert(overrides.end(), more.begin(), more.end());
    auto server = std::make_unique<Server>(folder_ / name, overrides, address(name));
    EXPECT_TRUE(server->process().wait_for_line(name + " has joined"));
    return server;
  }
  std::uint16_t port(const std::string& name) const { return ports_[name == "a" ? 0 : 2]; }
  std::string address(const std::string& name) const {
    return "127.0.0.1:" + std::to_string(port(name));
  }
  std::string socket(const std::string& name) const {
    return (folder_ / (name + ".socket")).string();
  }

  Process robot(const std::string& server, Overrides overrides = {}) const {
    for (const char* one : {"source.frames=1000000", "source.width=160", "source.height=120"}) {
      overrides.emplace_back(one);
    }
    return Process(robot_command(kRobot, server, overrides));
  }
  /// One more of the robot's lines, one a second.
  static void stream(Process& robot) {
    const int lines = robot.count_lines("] captured ");
    ASSERT_TRUE(robot.wait_for_lines("] captured ", lines + 1)) << robot.output();
  }
  /// A program at that server that keeps what it reads.
  Overrides slam(const std::string& name) const {
    return {"slam.command=cat > " + (folder_ / name).string() + ".slam", "slam.format=mjpeg",
            "slam.resume=backlog"};
  }
  std::vector<Sequence> read_by_slam(const std::string& name) const {
    const std::string text = read_file(folder_ / (name + ".slam"));
    const std::regex note("seq=([0-9]+)");
    std::vector<Sequence> read;
    for (std::sregex_iterator at(text.begin(), text.end(), note), end; at != end; ++at) {
      read.push_back(std::stoull((*at)[1].str()));
    }
    return read;
  }
  Finished drain(const std::string& name) const {
    return run({kOrbbufServer, "drain", socket(name)});
  }
  Finished join(const std::string& session, std::vector<std::string> arguments) const {
    std::vector<std::string> command{kOrbbufServer, "join",   session,          "--output",
                                     out_.string(), "--etcd", etcd_->endpoint()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    std::filesystem::remove_all(out_);
    return run(command);
  }
  /// Of times.txt, in the order of its lines.
  std::vector<Sequence> joined() const {
    std::vector<Sequence> frames;
    for (const std::string& line : read_lines(out_ / "times.txt")) {
      frames.push_back(std::stoull(line));
    }
    return frames;
  }

  const TemporaryFolder folder_;
  const std::filesystem::path out_ = folder_ / "out";
  const std::vector<std::uint16_t> ports_ = free_ports(4);
  std::unique_ptr<RealEtcd> etcd_;
};

TEST_F(FleetTest, ADrainMovesRobotAndSlamProgramAndJoinMakesOneSession) {
  const auto a = start("a", slam("a"));
  const auto b = start("b", slam("b"));
  Process robot = this->robot(address("a"));
  ASSERT_TRUE(robot.wait_for_line("connected to " + address("a"))) << robot.output();
  stream(robot);
  const Finished drained = drain("a");
  EXPECT_EQ(drained.status, 0) << drained.output;
  ASSERT_TRUE(robot.wait_for_line("connected to " + address("b"))) << robot.output();
  stream(robot);
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  const auto captured = closing_stats(robot).at("captured");
  ASSERT_TRUE(b->process().wait_for_line("the robot ended the session"));
  const std::string session = read_record(folder_ / "a", kRobot).folder.filename().string();

  const Finished joining = join(std::string(kRobot) + "/" + session, {});
  EXPECT_EQ(joining.status, 0) << joining.output;
  EXPECT_THAT(joining.output, ContainsRegex(session + "\\.e[0-9]+: fetched from b, 127.0.0.1:"));
  const auto frames = joined();
  const std::size_t lines = read_lines(out_ / "drops.csv").size();  // the first is the head
  EXPECT_EQ(frames.size() + lines - (lines > 0 ? 1 : 0), captured);

  // The program at b has each of them, in order.
  EXPECT_EQ(read_by_slam("b"), frames);
  EXPECT_EQ(drain("a").status, 0);  // nothing is left
  const Finished none = drain("b");
  EXPECT_EQ(none.status, 1);
  EXPECT_THAT(none.output, HasSubstr("no other server"));
}

TEST_F(FleetTest, TheProgramOfTheNextOwnerGetsTheFramesOfAServerThatWasKilledAndIsBack) {
  auto a = start("a");
  const auto b = start("b", slam("b"));
  Process robot = this->robot("[\"" + address("a") + "\", \"" + address("b") + "\"]");
  ASSERT_TRUE(robot.wait_for_line("connected to " + address("a"))) << robot.output();
  stream(robot);
  a->process().signal(SIGKILL);
  ASSERT_TRUE(robot.wait_for_line("connected to " + address("b"))) << robot.output();
  a = start("a");
  stream(robot);
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  ASSERT_TRUE(b->process().wait_for_line("the robot ended the session"));
  const std::string session = read_record(folder_ / "a", kRobot).folder.filename().string();
  const Finished joining = join(std::string(kRobot) + "/" + session, {});
  EXPECT_EQ(joining.status, 0) << joining.output;
  EXPECT_EQ(read_by_slam("b"), joined());
  EXPECT_EQ(b->process().count_lines("are passed over"), 0) << b->process().output();
}

/// B3
TEST_F(FleetTest, ASecondServerOfOneNameEndsAndTheFirstGoesOn) {
  const auto a = start("a", {"fleet.lease=2 s"});
  const Finished twin =
      run({kOrbbufServer, "--set", "listen.address=127.0.0.1:0", "--set",
           "files.path=" + (folder_ / "twin").string(), "--set",
           "fleet.etcd=[\"" + etcd_->endpoint() + "\"]", "--set", "fleet.name=a", "--set",
           "fleet.address=127.0.0.1:1", "--set", "fleet.lease=2 s", "--set", "status.socket="});
  EXPECT_EQ(twin.status, 1) << twin.output;
  EXPECT_THAT(twin.output, HasSubstr("fleet.name: another server of the fleet, " + address("a") +
                                     ", has the name a, too"));
  const RobotClient robot(port("a"));
  EXPECT_TRUE(robot.hello("robot", "s"));
}

/// C1: the robot cannot resolve where it is sent.
TEST_F(FleetTest, DrainNamesTheRobotThatReachesNoOtherServerAndFails) {
  const auto a = start("a");
  const auto b = start("b", {"fleet.address=no-such-server.invalid:1"});
  Process robot = this->robot(address("a"));
  ASSERT_NO_FATAL_FAILURE(stream(robot));
  const Finished drained = drain("a");
  EXPECT_EQ(drained.status, 1) << drained.output;
  EXPECT_THAT(drained.output, ContainsRegex("do not reach another server.* turtlebot1/"));
}

TEST_F(FleetTest, DrainSaysThatNoServerListens) {
  const Finished drained = drain("a");
  EXPECT_EQ(drained.status, 1);
  EXPECT_THAT(drained.output, ContainsRegex("drain: no server answers: .*a.socket: No such file"));
}

TEST_F(FleetTest, UnderTlsARobotGoesToTheServerThatIsNamedOverTls) {
  const Certificates keys;
  const auto server_keys = Certificates::overrides(keys.server());
  const auto a = start("a", server_keys);
  const auto b = start("b", server_keys);
  Process robot = this->robot(address("a"), Certificates::overrides(keys.robot()));
  ASSERT_TRUE(robot.wait_for_line("connected to " + address("a"))) << robot.output();
  stream(robot);
  const Finished drained = drain("a");
  EXPECT_EQ(drained.status, 0) << drained.output;
  ASSERT_TRUE(robot.wait_for_line("moves this robot to " + address("b"))) << robot.output();
  ASSERT_TRUE(robot.wait_for_line("connected to " + address("b"))) << robot.output();
  stream(robot);
  robot.signal(SIGTERM);
  EXPECT_EQ(robot.wait(), 0) << robot.output();
  EXPECT_FALSE(read_record(folder_ / "b", kRobot).delivered.empty());
  EXPECT_EQ(b->process().count_lines("with TLS, listening"), 1);
}

/// A session of which `a` has the beginning, and `b` the end and a late frame of the beginning.
class LateInFleet : public FleetTest {
 protected:
  void SetUp() override {
    FleetTest::SetUp();
    if (IsSkipped()) return;
    a_ = start("a");
    b_ = start("b");
    RobotClient at_a(port("a"));
    ASSERT_TRUE(at_a.hello("robot", "s"));
    send(at_a, {0, 1, 3});
    at_a.send_drops(0, {{2, 2 * kFrameNs, DropReason::kPolicy}});
    ASSERT_TRUE(at_a.acked(4));
    at_a.close();
    ASSERT_EQ(drain("a").status, 0);
    at_b_.emplace(port("b"));
    ASSERT_TRUE(at_b_->hello("robot", "s"));
    send(*at_b_, {4, 5});
    ASSERT_TRUE(at_b_->acked(6));
    wire::Account account;
    account.session_id = "s";
    account.captured = 6;
    account.held = 1;
    account.first_held = 2;
    at_b_->send_account(0, account);
    at_b_->send_late(0, "s", *jpeg_frame_ptr(2, 16, 16));
    ASSERT_TRUE(at_b_->acked(1, wire::kLate));
  }
  static void send(const RobotClient& robot, const std::vector<Sequence>& frames) {
    for (const Sequence frame : frames) robot.send_frame(*jpeg_frame_ptr(frame, 16, 16));
  }
  /// The robot has sent all: b merges.
  void end() {
    wire::Account account;
    account.session_id = "s";
    account.captured = 6;
    at_b_->send_account(1, account);
    at_b_->send(wire::encode(wire::Report{{6, 0, 0, 1, 5, 0, 0}, 25, 1000, 2'000'000, 40'000}));
    at_b_->send(wire::encode(wire::Bye{{6, 1}}));
    ASSERT_TRUE(b_->process().wait_for_line("1 late frames have completed the session"))
        << b_->process().output();
  }
  void expect_all(const Finished& joining) const {
    EXPECT_EQ(joining.status, 0) << joining.output;
    EXPECT_EQ(joined(), (std::vector<Sequence>{0, 1, 2, 3, 4, 5}));
    for (const Sequence frame : joined()) {
      EXPECT_EQ(read_file(out_ / "images" / fmt::format("{:06}.jpg", frame)),
                as_text(jpeg_frame_ptr(frame, 16, 16)->jpeg));
    }
  }

  std::unique_ptr<Server> a_;
  std::unique_ptr<Server> b_;
  std::optional<RobotClient> at_b_;
};

TEST_F(LateInFleet, JoinFindsLateFramesThatCameToAnotherServerInItsFolder) {
  end();
  a_.reset();
  b_.reset();
  expect_all(run({kOrbbufServer, "join", "robot/s", (folder_ / "a").string(),
                  (folder_ / "b").string(), "--output", out_.string()}));
}

TEST_F(LateInFleet, JoinFetchesThemFromTheOtherServersPage) {
  end();
  expect_all(join("robot/s", {}));
}

TEST_F(LateInFleet, JoinFetchesThemAlsoBeforeTheyAreMerged) {
  const Finished joining = join("robot/s", {});
  EXPECT_EQ(joined(), (std::vector<Sequence>{0, 1, 2, 3, 4, 5})) << joining.output;
}

TEST_F(LateInFleet, AFolderOfLateFramesIsNotTakenForTheSegmentOfThatName) {
  end();
  expect_all(join("robot/s", {(folder_ / "b").string()}));
}

TEST_F(LateInFleet, WhatIsHereIsNotFetched) {
  end();
  const Finished joining = join("robot/s", {(folder_ / "a").string(), (folder_ / "b").string()});
  expect_all(joining);
  EXPECT_THAT(joining.output, testing::Not(HasSubstr("fetched")));
}

}  // namespace
}  // namespace orbbuf::test
