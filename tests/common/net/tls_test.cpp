// SPDX-License-Identifier: Apache-2.0
#include "common/net/tls.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "testing/captured_log.hpp"
#include "testing/certificates.hpp"
#include "tests/common/config_fixture.hpp"

namespace orbbuf {
namespace {

using test::Certificates;
using testing::HasSubstr;
namespace fs = std::filesystem;

class TlsConfig : public ConfigFixture {
 protected:
  std::string error_with_lines(const std::string& lines) {
    return error_of([&] {
      auto config = read("[tls]\n" + lines);
      load_tls(config, tls_);
    });
  }
  TlsSettings tls_;
};

TEST_F(TlsConfig, IsOffByDefault) {
  EXPECT_EQ(error_with_lines(""), "");
  EXPECT_FALSE(tls_.is_on());
  EXPECT_EQ(make_tls_context(tls_), nullptr);
}

TEST_F(TlsConfig, PathsAreTakenFromTheFilesFolder) {
  EXPECT_EQ(error_with_lines("certificate = 'a.crt'\nkey = '/k'\nca = 'b/ca.crt'\n"), "");
  EXPECT_EQ(tls_,
            (TlsSettings{file().parent_path() / "a.crt", "/k", file().parent_path() / "b/ca.crt"}));
}

TEST_F(TlsConfig, WantsAllThreeOrNone) {
  EXPECT_THAT(error_with_lines("certificate = 'a'\nca = 'b'\n"), HasSubstr("tls.key: required"));
  EXPECT_THAT(error_with_lines("certificate = 'a'\nkey = 'b'\n"), HasSubstr("tls.ca: required"));
  EXPECT_THAT(error_with_lines("key = 'b'\n"), HasSubstr("tls.certificate: required"));
}

TEST_F(TlsConfig, CredentialsAreSystemds) {
  const std::string lines = "certificate = 'a'\nkey = 'credential:robot.key'\nca = 'b'\n";
  ::unsetenv("CREDENTIALS_DIRECTORY");
  EXPECT_THAT(error_with_lines(lines), HasSubstr("FILE:3: tls.key: no credentials"));
  ::setenv("CREDENTIALS_DIRECTORY", "/run/credentials/orbbufd.service", 1);
  EXPECT_EQ(error_with_lines(lines), "");
  EXPECT_EQ(tls_.key, "/run/credentials/orbbufd.service/robot.key");
  EXPECT_THAT(error_with_lines("key = 'credential:../x'\n"), HasSubstr("credential:NAME"));
  ::unsetenv("CREDENTIALS_DIRECTORY");
}

/// The text of the error that these settings are refused with.
std::string refusal(const TlsSettings& tls) {
  try {
    make_tls_context(tls);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(TlsContext, TakesWhatTheDocumentsCommandsMake) {
  const Certificates made;
  EXPECT_EQ(refusal(made.server()), "");
  EXPECT_EQ(refusal(made.robot()), "");
}

TEST(TlsContext, FilesThatCannotBeUsedAreNamed) {
  const Certificates made;
  TlsSettings tls = made.robot();
  tls.certificate = "/nowhere/a.crt";
  EXPECT_EQ(refusal(tls),
            "cannot use the TLS certificate /nowhere/a.crt: No such file or directory");
  tls = made.robot();
  tls.key = tls.certificate;
  fs::permissions(tls.key, fs::perms::owner_read);
  EXPECT_THAT(refusal(tls), HasSubstr("cannot use the TLS key " + tls.key.string()));
  tls = made.robot();
  tls.key = made.server().key;
  EXPECT_THAT(refusal(tls), HasSubstr("key values mismatch"));
  tls = made.robot();
  tls.ca = made.robot().key;
  EXPECT_THAT(refusal(tls), HasSubstr("cannot use the TLS CA certificate " + tls.ca.string()));
}

TEST(TlsContext, AKeyThatEverybodyCanReadIsRefused) {
  const Certificates made;
  fs::permissions(made.robot().key, fs::perms::others_read, fs::perm_options::add);
  EXPECT_THAT(refusal(made.robot()), HasSubstr("chmod 600"));
}

TEST(TlsContext, OurOwnCertificateMustBeInDate) {
  const Certificates made;
  made.expire("turtlebot1");
  EXPECT_THAT(refusal(made.robot()), HasSubstr("it has expired"));
  const test::CapturedLog log;
  EXPECT_TRUE(make_tls_context(made.robot(), true)) << "a robot goes on";
  EXPECT_EQ(log.lines("it has expired; no server will take it").size(), 1U);
}

}  // namespace
}  // namespace orbbuf
