// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <csignal>

#include "testing/certificates.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

/// The real programs, each with its own `[tls]`.
class Tls : public testing::Test {
 protected:
  std::unique_ptr<Server> server(Overrides overrides = {},
                                 const std::string& listen = "127.0.0.1:0") {
    const auto tls = Certificates::overrides(keys_.server());
    overrides.insert(overrides.end(), tls.begin(), tls.end());
    return std::make_unique<Server>(folder_ / "out", overrides, listen);
  }
  static std::unique_ptr<Process> robot(const TlsSettings& tls, const std::string& address,
                                        const std::string& id = "turtlebot1") {
    Overrides overrides = tls.is_on() ? Certificates::overrides(tls) : Overrides{};
    for (const char* one : {"source.frames=50", "source.realtime=false", "source.width=160",
                            "source.height=120", "link.drain_timeout=0 s"}) {
      overrides.emplace_back(one);
    }
    if (id == "turtlebot1") overrides.back() = "link.drain_timeout=60 s";
    return std::make_unique<Process>(robot_command(id, address, overrides));
  }

  TemporaryFolder folder_;
  const Certificates keys_;
};

TEST_F(Tls, AStreamIsDeliveredWhole) {
  const auto open = server({"listen.robots=[\"turtlebot1\"]"});
  const auto sender = robot(keys_.robot(), open->address());
  EXPECT_EQ(sender->wait(), 0) << sender->output();
  EXPECT_EQ(sender->count_lines("over TLS"), 1);
  expect_exactly_once(read_record(folder_ / "out", "turtlebot1"), 50);
}

TEST_F(Tls, ARobotIsNobodyButItsCertificatesName) {
  const auto open = server();
  const auto impostor = robot(keys_.robot(), open->address(), "turtlebot2");
  EXPECT_TRUE(
      open->process().wait_for_line("the certificate is for \"turtlebot1\", not for this robot"));
  EXPECT_TRUE(impostor->wait_for_line("not for this robot"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out" / "turtlebot2"));
}

TEST_F(Tls, ARobotThatIsNotOnTheListIsRefused) {
  const auto open = server({"listen.robots=[\"front\", \"rear\"]"});
  const auto stranger = robot(keys_.robot(), open->address());
  EXPECT_TRUE(stranger->wait_for_line("turtlebot1 is not among listen.robots"));
  // It tries on, several times a second, and the server says so once.
  EXPECT_TRUE(open->process().wait_for_line("turtlebot1 is not among listen.robots"));
  EXPECT_EQ(open->process().count_lines("turtlebot1 is not among listen.robots"), 1);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out" / "turtlebot1"));
}

TEST_F(Tls, ARobotRefusesAServerOfAnotherCa) {
  const auto open = server();
  const Certificates others;
  const auto sender = robot(others.robot(), open->address());
  EXPECT_TRUE(sender->wait_for_line("the certificate of \"orbbuf-server\" was rejected"));
  EXPECT_TRUE(open->process().wait_for_line("the peer rejected the handshake"));
}

TEST_F(Tls, ARobotRefusesAServerOfAnotherName) {
  keys_.make("server", "IP:127.0.0.1", "DNS:elsewhere");
  const auto open = server();
  const auto by_address = robot(keys_.robot(), open->address());
  EXPECT_TRUE(by_address->wait_for_line("was rejected: IP address mismatch"));
  const std::string port = open->address().substr(open->address().rfind(':'));
  const auto by_name = robot(keys_.robot(), "localhost" + port);
  EXPECT_EQ(by_name->wait(), 0) << by_name->output();
}

TEST_F(Tls, AScopeDoesNotKeepARobotFromCheckingTheServersAddress) {
  keys_.make("server", "IP:127.0.0.1", "IP:::1");
  const auto open = server({}, "[::1]:0");
  const std::string port = open->address().substr(open->address().rfind(':'));
  const auto sender = robot(keys_.robot(), "[::1%lo]" + port);
  EXPECT_EQ(sender->wait(), 0) << sender->output();
  keys_.make("server", "IP:127.0.0.1", "IP:::2");
  open->process().signal(SIGTERM);  // it has the folder
  EXPECT_EQ(open->process().wait(), 0) << open->process().output();
  const auto other = server({}, "[::1]:0");
  const auto deceived =
      robot(keys_.robot(), "[::1%lo]" + other->address().substr(other->address().rfind(':')));
  EXPECT_TRUE(deceived->wait_for_line("was rejected: IP address mismatch")) << deceived->output();
}

TEST_F(Tls, ReloadedCertificatesAreForNewConnections) {
  auto first = server();
  const std::string address = first->address();
  Overrides overrides = Certificates::overrides(keys_.robot());
  overrides.insert(overrides.end(), {"source.width=160", "source.height=120"});
  Process sender(robot_command("turtlebot1", address, overrides));
  ASSERT_TRUE(sender.wait_for_line("connected to")) << sender.output();
  const std::string certificate = read_file(keys_.robot().certificate);
  write_file(keys_.robot().certificate, "not PEM");
  sender.signal(SIGHUP);
  ASSERT_TRUE(sender.wait_for_line("the certificates read before stay in use")) << sender.output();
  write_file(keys_.robot().certificate, certificate);
  sender.signal(SIGHUP);
  ASSERT_TRUE(sender.wait_for_line("SIGHUP: read the certificates again")) << sender.output();
  keys_.make("robot", "robot=turtlebot1", "robot=turtlebot2");
  for (const auto file : {&TlsSettings::certificate, &TlsSettings::key}) {
    std::filesystem::rename(keys_.of("turtlebot2").*file, keys_.robot().*file);
  }
  sender.signal(SIGHUP);
  ASSERT_TRUE(sender.wait_for_lines("SIGHUP: read the certificates again", 2)) << sender.output();
  EXPECT_EQ(sender.count_lines("connected to"), 1) << "a connection was lost: " << sender.output();

  first->process().signal(SIGTERM);
  EXPECT_EQ(first->process().wait(), 0);
  EXPECT_EQ(sender.count_lines("the certificate is for \"turtlebot2\""), 0);
  const auto second = server({}, address);
  EXPECT_TRUE(sender.wait_for_line("the certificate is for \"turtlebot2\", not for this robot"));
}

TEST_F(Tls, APlainRobotHearsThatTheServerSpeaksTls) {
  const auto open = server();
  const auto sender = robot({}, open->address());
  EXPECT_TRUE(sender->wait_for_line("the server says: this server speaks TLS")) << sender->output();
}

TEST_F(Tls, APlainServerIsNotTrusted) {
  Server plain(folder_ / "out");
  const auto sender = robot(keys_.robot(), plain.address());
  EXPECT_TRUE(sender->wait_for_line("no TLS: "));
  EXPECT_TRUE(plain.process().wait_for_line("the peer speaks TLS"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out" / "turtlebot1"));
}

TEST_F(Tls, AServerOnTheNetworkWantsTlsOrToBeToldOtherwise) {
  const Finished refused = run({kOrbbufServer, "--set", "listen.address=0.0.0.0:0"});
  EXPECT_EQ(refused.status, 1);
  EXPECT_NE(refused.output.find("listen.insecure = true"), std::string::npos) << refused.output;
  Server warned(folder_ / "out", {"listen.insecure=true"}, "0.0.0.0:0");
  EXPECT_TRUE(warned.process().wait_for_line("any host on the network can act as any robot"));
}

}  // namespace
}  // namespace orbbuf::test
