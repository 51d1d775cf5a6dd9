// SPDX-License-Identifier: Apache-2.0
// What the two programs say for themselves: options, configuration errors, start-up errors.
#include "tests/e2e/programs.hpp"

#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <csignal>

#include "testing/certificates.hpp"
#include "testing/source_folder.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

TEST(Programs, VersionAndHelpNeedNoConfiguration) {
  EXPECT_EQ(run({kOrbbufd, "--version"}).output, "orbbufd " ORBBUF_VERSION "\n");
  EXPECT_EQ(run({kOrbbufServer, "--version"}).output, "orbbuf-server " ORBBUF_VERSION "\n");
  for (const char* program : {kOrbbufd, kOrbbufServer}) {
    const Finished help = run({program, "--help"});
    EXPECT_EQ(help.status, 0);
    for (const char* option : {"--config", "--set", "--check-config", "--version"}) {
      EXPECT_NE(help.output.find(option), std::string::npos) << option;
    }
  }
}

TEST(Programs, CheckConfigAcceptsTheSamples) {
  const std::string config = kSourceFolder + std::string("/config/");
  EXPECT_EQ(run({kOrbbufd, "--check-config", "--config", config + "orbbufd.toml"}).status, 0);
  EXPECT_EQ(
      run({kOrbbufServer, "--check-config", "--config", config + "orbbuf-server.toml"}).status, 0);
}

TEST(Programs, TypoInTheConfigurationNamesFileLineAndKey) {
  const TemporaryFolder folder;
  const std::string file = (folder / "c.toml").string();
  write_file(file, "[log]\nlevel = \"info\"\n\n[link]\nstal_timeout = \"1 s\"\n");
  const Finished robot = run({kOrbbufd, "--config", file});
  EXPECT_EQ(robot.status, 1);
  EXPECT_NE(robot.output.find(file + ":5: link.stal_timeout: "), std::string::npos) << robot.output;
  EXPECT_NE(robot.output.find("link.stall_timeout"), std::string::npos) << robot.output;
  write_file(file, "[listen]\naddress = 7722\n");
  const Finished server = run({kOrbbufServer, "--config", file});
  EXPECT_EQ(server.status, 1);
  EXPECT_NE(server.output.find(file + ":2: listen.address: "), std::string::npos) << server.output;
}

TEST(Programs, AnErrorBeforeTheConfigurationIsReadHasTheFormOfTheLog) {
  for (const char* program : {kOrbbufd, kOrbbufServer}) {
    for (const char* config : {"--set=no.such=1", "--config=/no/such.toml"}) {
      const Finished refused = run({program, config});
      EXPECT_EQ(refused.status, 1);
      EXPECT_EQ(refused.output.find("Z error [main] "),
                std::string("2026-11-29T10:00:00.000").size())
          << refused.output;
    }
  }
}

void expect_keys_checked(const char* program, const TlsSettings& tls) {
  std::vector<std::string> command{program, "--check-config"};
  for (const std::string& one : Certificates::overrides(tls)) command.push_back("--set=" + one);
  EXPECT_EQ(run(command).status, 0);
  std::filesystem::permissions(tls.key, std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  const Finished refused = run(command);
  EXPECT_EQ(refused.status, 1);
  EXPECT_NE(refused.output.find("other users have access to it"), std::string::npos)
      << refused.output;
}

TEST(Programs, CheckConfigRefusesTheKeysThatTheStartRefuses) {
  const Certificates keys;
  expect_keys_checked(kOrbbufd, keys.robot());
  expect_keys_checked(kOrbbufServer, keys.server());
}

TEST(Programs, FolderThatCannotBeReadIsNamedWithTheReason) {
  const Finished robot = run(robot_command("r", "127.0.0.1:1", replay("/nowhere")));
  EXPECT_EQ(robot.status, 1);
  EXPECT_NE(robot.output.find("/nowhere"), std::string::npos) << robot.output;
  EXPECT_NE(robot.output.find("No such file or directory"), std::string::npos) << robot.output;
}

TEST(Programs, CameraThatIsNotThereIsNamedWithTheReason) {
#ifdef ORBBUF_V4L2
  const std::string reason = "/dev/video-none: No such file";
#else
  const std::string reason = "orbbufd was built without V4L2";
#endif
  const std::vector<std::string> camera = {"--set", "source.kind=v4l2", "--set",
                                           "source.device=/dev/video-none"};
  for (const char* verb : {"--probe", "--set=log.level=info"}) {
    std::vector<std::string> command = {kOrbbufd, verb};
    command.insert(command.end(), camera.begin(), camera.end());
    const Finished robot = run(command);
    EXPECT_EQ(robot.status, 1);
    EXPECT_NE(robot.output.find(reason), std::string::npos) << robot.output;
  }
}

TEST(Programs, PortThatIsTakenIsNamedWithTheReason) {
  const TemporaryFolder out;
  Server server(out.path());
  const Finished second = run({kOrbbufServer, "--set", "listen.address=" + server.address()});
  EXPECT_EQ(second.status, 1);
  EXPECT_NE(second.output.find(server.address()), std::string::npos) << second.output;
  EXPECT_NE(second.output.find("in use"), std::string::npos) << second.output;
}

TEST(Programs, WrongPortIsSaidOnceAndTriedOn) {
  using boost::asio::ip::tcp;
  boost::asio::io_context io;
  // Nobody listens there, and nobody else is given the port.
  const tcp::socket taken(io, tcp::endpoint(boost::asio::ip::address_v4::loopback(), 0));
  const std::string address = "127.0.0.1:" + std::to_string(taken.local_endpoint().port());
  // All frames fit and none is skipped, however slow the machine; then a second of trying on.
  Process robot(robot_command("r", address,
                              {"link.drain_timeout=1 s", "source.frames=50",
                               "source.realtime=false", "buffer.capacity=100"}));
  EXPECT_EQ(robot.wait(), 3) << "frames that were not delivered, nor kept: " << robot.output();
  EXPECT_EQ(robot.count_lines("50 frames are lost, neither delivered nor kept"), 1);
  EXPECT_EQ(robot.count_lines("no connection to " + address + ": "), 1) << robot.output();
  EXPECT_EQ(robot.count_lines("Connection refused"), 1) << robot.output();
  EXPECT_EQ(closing_stats(robot).at("dropped"), 50U);
}

TEST(Programs, AStopSaysWhatItWaitsForAndASecondOneLosesItUnlessItIsKept) {
  const TemporaryFolder folder;
  for (const bool has_spool : {false, true}) {
    Overrides overrides{"source.frames=1000000", "source.width=160", "source.height=120",
                        "link.drain_timeout=60 s"};
    if (has_spool) overrides.push_back("spool.path=" + (folder / "spool").string());
    Process robot(robot_command("r", "127.0.0.1:1", overrides));
    ASSERT_TRUE(robot.wait_for_line("no connection to")) << robot.output();
    ASSERT_TRUE(robot.wait_for_line("captured ")) << robot.output();
    robot.signal(SIGINT);
    const auto said = robot.wait_for_line("signal 2: stopping; ");
    ASSERT_TRUE(said) << robot.output();
    EXPECT_NE(said->find(" frames, for at most 60 s; a second signal"), std::string::npos) << *said;
    EXPECT_NE(said->find(has_spool ? "leaves them in the spool" : "loses them"), std::string::npos);
    robot.signal(SIGINT);
    EXPECT_EQ(robot.wait(), has_spool ? 0 : 3) << robot.output();
  }
}

TEST(Programs, ASecondServerOnTheSameFolderRefusesToStart) {
  const TemporaryFolder folder;
  const Server first(folder / "data");
  const Finished second = run({kOrbbufServer, "--set", "listen.address=127.0.0.1:0", "--set",
                               "files.path=" + (folder / "data").string()});
  EXPECT_EQ(second.status, 1);
  EXPECT_NE(second.output.find((folder / "data").string() + ": another orbbuf-server uses it"),
            std::string::npos)
      << second.output;
}

TEST(Programs, TheServerReadsTheListOfRobotsAgainOnSighup) {
  const TemporaryFolder folder;
  const auto config = folder / "server.toml";
  write_file(config, "[listen]\nrobots = [\"a\"]\n");
  Process server({kOrbbufServer, "--config", config, "--set", "listen.address=127.0.0.1:0", "--set",
                  "files.path=" + (folder / "data").string()});
  const auto line = server.wait_for_line("listening on ");
  ASSERT_TRUE(line) << server.output();
  const std::string address = line->substr(line->rfind(' ') + 1);
  Process robot(robot_command("b", address, {"source.frames=10"}));
  ASSERT_TRUE(robot.wait_for_line("b is not among listen.robots")) << robot.output();
  write_file(config, "[listen]\nrobots = [\"a\", \"b\"]\n");
  server.signal(SIGHUP);
  EXPECT_EQ(robot.wait(), 0) << robot.output();

  write_file(config, "[listen\n");
  server.signal(SIGHUP);
  ASSERT_TRUE(server.wait_for_line("SIGHUP: listen.robots stays as it was: ")) << server.output();
}

TEST(Programs, TheServerLivesOnAfterSighup) {
  const TemporaryFolder folder;
  Server server(folder / "data");
  server.process().signal(SIGHUP);
  ASSERT_TRUE(server.process().wait_for_line("SIGHUP: no [tls]"));
  server.process().signal(SIGHUP);
  ASSERT_TRUE(server.process().wait_for_lines("SIGHUP: no [tls]", 2));
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(), 0);
}

TEST(Programs, BothLiveOnAfterSignalsThatMeanNothingToThem) {
  const TemporaryFolder folder;
  Server server(folder / "data");
  Process robot(robot_command(kRobot, server.address(), {"source.frames=1000000"}));
  ASSERT_TRUE(robot.wait_for_line("connected to")) << robot.output();
  for (Process* const process : {&robot, &server.process()}) {
    for (const int signal : {SIGUSR1, SIGUSR2, SIGTERM}) process->signal(signal);
    EXPECT_EQ(process->wait(), 0) << process->output();
  }
}

}  // namespace
}  // namespace orbbuf::test
