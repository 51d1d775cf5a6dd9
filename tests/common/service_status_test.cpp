// SPDX-License-Identifier: Apache-2.0
#include "common/service_status.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <string>

#include "common/log.hpp"
#include "testing/notify_socket.hpp"

namespace orbbuf {
namespace {

using ::testing::ElementsAre;

class ServiceStatusTest : public ::testing::Test {
 protected:
  ServiceStatusTest() { ::setenv("NOTIFY_SOCKET", manager_.path().c_str(), 1); }
  ~ServiceStatusTest() override {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
  }

  test::NotifySocket manager_;
  ServiceStatus service_;
};

TEST_F(ServiceStatusTest, EachMessageIsOneDatagram) {
  service_.ready();
  service_.status("two words");
  service_.feed();
  service_.stopping();
  EXPECT_THAT(manager_.until("STOPPING"),
              ElementsAre("READY=1", "STATUS=two words", "WATCHDOG=1", "STOPPING=1"));
}

TEST_F(ServiceStatusTest, WhatIsKnownIsNotToldAgainButTheWatchdogIsFedEachTime) {
  service_.ready();
  service_.ready();
  service_.status("a");
  service_.status("a");
  service_.status("b");
  service_.feed();
  service_.feed();
  service_.stopping();
  EXPECT_THAT(manager_.until("STOPPING"), ElementsAre("READY=1", "STATUS=a", "STATUS=b",
                                                      "WATCHDOG=1", "WATCHDOG=1", "STOPPING=1"));
}

TEST_F(ServiceStatusTest, TheWatchdogIsOnlyForTheProcessThatItNames) {
  EXPECT_EQ(service_.watchdog(), std::chrono::seconds(0)) << "there is none";
  ::setenv("WATCHDOG_USEC", "30000000", 1);
  EXPECT_EQ(service_.watchdog(), std::chrono::seconds(30));
  ::setenv("WATCHDOG_PID", std::to_string(::getpid()).c_str(), 1);
  EXPECT_EQ(service_.watchdog(), std::chrono::seconds(30));
  ::setenv("WATCHDOG_PID", std::to_string(::getppid()).c_str(), 1);
  EXPECT_EQ(service_.watchdog(), std::chrono::seconds(0));
}

TEST_F(ServiceStatusTest, AManagerThatIsGoneIsNoMatterAndIsLoggedOnce) {
  ::setenv("NOTIFY_SOCKET", (manager_.path() + "-gone").c_str(), 1);
  set_up_log("info");
  ::testing::internal::CaptureStderr();
  service_.ready();
  service_.feed();
  const std::string log = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(log.find("cannot notify systemd of \"READY=1\": No such file or directory"),
            std::string::npos)
      << log;
  EXPECT_EQ(log.find("WATCHDOG"), std::string::npos) << log;
  ::unsetenv("NOTIFY_SOCKET");
  service_.stopping();
}

}  // namespace
}  // namespace orbbuf
