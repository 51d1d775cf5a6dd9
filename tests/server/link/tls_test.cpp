// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <optional>

#include "testing/captured_log.hpp"
#include "testing/certificates.hpp"
#include "testing/process.hpp"
#include "testing/robot_client.hpp"
#include "tests/server/http/http_client.hpp"
#include "tests/server/running_server.hpp"

namespace orbbuf {
namespace {

using test::Certificates;
using test::HttpClient;
using test::RobotClient;
using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;

/// A server with TLS, and openssl's own client as whoever comes.
class TlsServer : public testing::Test {
 protected:
  TlsServer() {
    settings_.sinks.files_path = folder_ / "data";
    settings_.listen.tls = keys_.server();
    settings_.http_address = Address{"127.0.0.1", 0};
    server_ = std::make_unique<test::RunningServer>(settings_);
  }

  /// openssl s_client: a handshake with these keys and arguments; it goes when the server does.
  void come(const TlsSettings& tls, const std::vector<std::string>& arguments = {}) const {
    std::vector<std::string> command = {
        "openssl", "s_client",       "-connect", "127.0.0.1:" + std::to_string(server_->port()),
        "-CAfile", tls.ca.string(),  "-cert",    tls.certificate.string(),
        "-key",    tls.key.string(), "-ign_eof"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    test::run(command);
  }
  /// What openssl s_client sees of the live page's /healthz with the certificate of `tls`, if any.
  std::string look(const std::optional<TlsSettings>& tls) const {
    std::string command =
        R"(printf 'GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n' | )";
    command += "openssl s_client -quiet -CAfile " + keys_.robot().ca.string();
    command += " -connect 127.0.0.1:" + std::to_string(server_->http_port());
    if (tls) command += " -cert " + tls->certificate.string() + " -key " + tls->key.string();
    return test::run({"sh", "-c", command}).output;
  }
  /// What the server has warned of by now.
  std::vector<std::string> warnings() {
    server_->stop();
    return log_.lines("warning ");
  }

  test::TemporaryFolder folder_;
  test::CapturedLog log_;
  const Certificates keys_;
  Settings settings_;
  std::unique_ptr<test::RunningServer> server_;
};

TEST_F(TlsServer, ACertificateOfAnotherCaIsRefused) {
  const Certificates strangers;
  come(strangers.robot());
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("in certificate chain"));
}

TEST_F(TlsServer, AnExpiredCertificateIsRefused) {
  keys_.expire("turtlebot1");
  come(keys_.robot());
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0],
              HasSubstr("the certificate of \"turtlebot1\" was rejected: certificate has expired"));
}

TEST_F(TlsServer, AServersCertificateIsNotARobots) {
  come(keys_.server());
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("certificate purpose"));
}

TEST_F(TlsServer, Tls12IsRefused) {
  come(keys_.robot(), {"-tls1_2"});
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("does not support TLS 1.3"));
}

TEST_F(TlsServer, WhoeverShowsNoCertificateIsRefused) {
  test::run({"openssl", "s_client", "-connect", "127.0.0.1:" + std::to_string(server_->port()),
             "-ign_eof"});
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("the peer sent no certificate"));
}

TEST_F(TlsServer, APlainRobotIsRefused) {
  const RobotClient robot(server_->port());
  robot.send_hello("turtlebot1", "s");
  const auto told = robot.error();
  ASSERT_TRUE(told) << "the robot got no message that it can read";
  EXPECT_EQ(told->code, wire::ErrorCode::kRefused);
  EXPECT_THAT(told->text, HasSubstr("this server speaks TLS"));
  EXPECT_TRUE(robot.is_closed());
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("the peer does not use TLS"));
}

TEST_F(TlsServer, ReadsTheCertificatesAgain) {
  const auto replace = std::filesystem::copy_options::overwrite_existing;
  std::filesystem::copy_file(Certificates().server().ca, keys_.server().ca, replace);
  server_->reload_tls();
  come(keys_.robot());
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("unable to get local issuer certificate"));
}

TEST_F(TlsServer, ThePageReadsTheCertificatesAgain) {
  const auto replace = std::filesystem::copy_options::overwrite_existing;
  const Certificates others;
  for (const auto file : {&TlsSettings::certificate, &TlsSettings::key, &TlsSettings::ca}) {
    std::filesystem::copy_file(others.server().*file, keys_.server().*file, replace);
  }
  server_->reload_tls();
  EXPECT_THAT(look(others.robot()), HasSubstr("\r\n\r\nok\n"));
}

TEST_F(TlsServer, KeepsItsCertificatesIfTheNewOnesCannotBeUsed) {
  test::write_file(keys_.server().ca, "not PEM");
  server_->reload_tls();
  EXPECT_THAT(log_.lines("error "), SizeIs(1));
  come(Certificates().robot());
  EXPECT_THAT(warnings(), SizeIs(1));
}

TEST_F(TlsServer, ThePageIsForWhoeverShowsACertificateOfTheCa) {
  EXPECT_THAT(look(keys_.robot()), HasSubstr("\r\n\r\nok\n"));
  EXPECT_THAT(look(std::nullopt), Not(HasSubstr("HTTP/1.1")));
  EXPECT_THAT(look(Certificates().robot()), Not(HasSubstr("HTTP/1.1")));
  EXPECT_EQ(HttpClient(server_->http_port()).get("/healthz").status, 0);  // plain HTTP
}

TEST_F(TlsServer, WhoeverNeverShakesHandsIsDisconnected) {
  server_->stop();
  settings_.listen.hello_timeout = std::chrono::milliseconds(50);
  server_ = std::make_unique<test::RunningServer>(settings_);
  const RobotClient silent(server_->port());
  EXPECT_TRUE(silent.is_closed());
  const auto said = warnings();
  ASSERT_THAT(said, SizeIs(1));
  EXPECT_THAT(said[0], HasSubstr("no hello within 0.05 s"));
}

}  // namespace
}  // namespace orbbuf
