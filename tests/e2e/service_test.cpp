// SPDX-License-Identifier: Apache-2.0
// What the two programs tell systemd, and when: readiness, status, and the watchdog's food.
#include <gmock/gmock.h>

#include <chrono>
#include <csignal>

#include "testing/notify_socket.hpp"
#include "testing/scripted_server.hpp"
#include "testing/stopped_thread.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using Clock = std::chrono::steady_clock;

const Overrides kFilm{"source.frames=1000000", "source.width=160", "source.height=120"};

class ServiceTest : public ::testing::Test {
 protected:
  using Words = std::vector<std::string>;

  // Whose manager is not listened to gets none: a few unread messages later it would stand still.
  static Words watched() { return {"env", "WATCHDOG_USEC=4000000"}; }
  static Words watched(const NotifySocket& manager) {
    Words words = watched();
    words.push_back("NOTIFY_SOCKET=" + manager.path());
    return words;
  }
  std::unique_ptr<Server> serve(const Words& where = {}) const {
    return std::make_unique<Server>(folder_ / "out", Overrides{}, "127.0.0.1:0", where);
  }
  static std::unique_ptr<Process> start_robot(const std::string& server, const Words& where,
                                              Overrides overrides = {}) {
    overrides.insert(overrides.end(), kFilm.begin(), kFilm.end());
    return std::make_unique<Process>(robot_command("r", server, overrides, where));
  }

  /// Whether the process has written such a line by now: it stands still while the line is awaited.
  static bool has_said(Process& process, const std::string& text) {
    process.signal(SIGSTOP);
    const bool is_said = process.wait_for_line(text, 10s).has_value();
    process.signal(SIGCONT);
    return is_said;
  }

  /// Whether the watchdog is fed before `limit` has passed.
  static bool is_fed(NotifySocket& manager, std::chrono::milliseconds limit) {
    const auto end = Clock::now() + limit;
    for (auto left = limit; left > 0ms;
         left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now())) {
      if (manager.next(left) == "WATCHDOG=1") return true;
    }
    return false;
  }
  /// Whether it ceases to be fed.
  static bool starves(NotifySocket& manager) {
    for (int fed = 0; fed < 20; ++fed) {
      if (!is_fed(manager, 4s)) return true;
    }
    return false;
  }

  void expect_watched(NotifySocket& manager, const Process& process, const std::string& thread) {
    manager.until("READY=1");
    ASSERT_TRUE(is_fed(manager, 60s));
    {
      const StoppedThread stuck(process.pid(), thread);
      if (!stuck.is_stopped()) GTEST_SKIP() << "ptrace is not permitted";
      EXPECT_TRUE(starves(manager)) << "although " << thread << " stands still";
    }
    EXPECT_TRUE(is_fed(manager, 60s)) << thread << " moves again";
  }

  const TemporaryFolder folder_;
  NotifySocket robot_manager_;
  NotifySocket server_manager_;
};

TEST_F(ServiceTest, TheServerIsReadyWhenItListensAndSaysWhoIsThere) {
  const auto server = serve(watched(server_manager_));
  EXPECT_THAT(server_manager_.until("STATUS"),
              ::testing::ElementsAre(
                  "READY=1", "STATUS=listening on " + server->address() + "; robots connected: 0"));
  const auto robot = start_robot(server->address(), watched());
  EXPECT_THAT(server_manager_.until("STATUS").back(), HasSubstr("robots connected: 1"));
  server->process().signal(SIGTERM);
  EXPECT_EQ(server_manager_.until("STOPPING=1").back(), "STOPPING=1");
  EXPECT_EQ(server->process().wait(), 0) << server->process().output();
}

TEST_F(ServiceTest, TheRobotIsReadyWhenItCapturesAndIsConnected) {
  const auto server = serve();
  const auto robot =
      start_robot(server->address(), watched(robot_manager_), {"link.connect_timeout=60 s"});
  auto messages = robot_manager_.until("READY=1");
  EXPECT_EQ(messages.back(), "READY=1");
  EXPECT_TRUE(has_said(*robot, "connected to")) << "before that";
  const auto is_connected =
      Contains(AllOf(HasSubstr("frames/s captured"), HasSubstr("; link connected")));
  // Told with that already, it is not told again until a figure changes.
  if (!::testing::Value(messages, is_connected)) messages = robot_manager_.until("STATUS");
  EXPECT_THAT(messages, is_connected);
  robot->signal(SIGTERM);
  EXPECT_EQ(robot_manager_.until("STOPPING=1").back(), "STOPPING=1");
  EXPECT_EQ(robot->wait(), 0) << robot->output();
}

TEST_F(ServiceTest, PgrepFindsBothByTheirNames) {
  const auto name_of = [](pid_t process) {
    return read_file("/proc/" + std::to_string(process) + "/comm");
  };
  const auto server = serve();
  const auto robot = start_robot(server->address(), watched());
  ASSERT_TRUE(robot->wait_for_line("connected to"));
  EXPECT_EQ(name_of(robot->pid()), "orbbufd\n");
  EXPECT_EQ(name_of(server->process().pid()), "orbbuf-server\n");
}

TEST_F(ServiceTest, WithoutAServerTheRobotIsReadyOnceItHasTried) {
  ScriptedServer silent;  // takes the connection, but says nothing
  const auto robot =
      start_robot("127.0.0.1:" + std::to_string(silent.port()), watched(robot_manager_),
                  {"link.connect_timeout=5 s", "link.drain_timeout=0 s"});
  auto messages = robot_manager_.until("READY=1");
  EXPECT_THAT(messages, Contains(AllOf(Not(HasSubstr("STATUS=0.0 frames/s captured")),
                                       HasSubstr("link connecting"))))
      << "it captures but has not tried yet";
  EXPECT_EQ(messages.back(), "READY=1");
  EXPECT_TRUE(has_said(*robot, "no answer")) << robot->output();
  EXPECT_TRUE(is_fed(robot_manager_, 60s)) << "a server that is not there is no hang";
  robot->signal(SIGTERM);
  const auto later = robot_manager_.until("STOPPING=1");
  messages.insert(messages.end(), later.begin(), later.end());
  EXPECT_THAT(messages, Contains(HasSubstr("link no connection: no answer")));
}

class RobotWatchdogTest : public ServiceTest, public ::testing::WithParamInterface<const char*> {};

TEST_P(RobotWatchdogTest, IsNotFedWhileAThreadStandsStill) {
  const auto server = serve();
  const auto robot = start_robot(server->address(), watched(robot_manager_));
  expect_watched(robot_manager_, *robot, GetParam());
}

INSTANTIATE_TEST_SUITE_P(Thread, RobotWatchdogTest, ::testing::Values("main", "capture", "worker"),
                         [](const auto& thread) { return thread.param; });

class ServerWatchdogTest : public ServiceTest, public ::testing::WithParamInterface<const char*> {};

TEST_P(ServerWatchdogTest, IsNotFedWhileAThreadStandsStill) {
  const auto server = serve(watched(server_manager_));
  expect_watched(server_manager_, server->process(), GetParam());
}

INSTANTIATE_TEST_SUITE_P(Thread, ServerWatchdogTest, ::testing::Values("main", "files"),
                         [](const auto& thread) { return thread.param; });

TEST_F(ServiceTest, TheRobotSaysWhichThreadStandsStill) {
  const auto server = serve();
  const auto robot = start_robot(server->address(), watched());
  ASSERT_TRUE(robot->wait_for_line("connected to")) << robot->output();
  bool is_said = false;
  // Once more if it was stopped with a lock that main needs (TSan's list of threads, the
  // allocator's): then none can say it.
  for (int tries = 0; tries < 4 && !is_said; ++tries) {
    const StoppedThread stuck(robot->pid(), "capture");
    if (!stuck.is_stopped()) GTEST_SKIP() << "ptrace is not permitted";
    is_said = robot->wait_for_line("thread capture has not responded for ", 20s).has_value();
  }
  EXPECT_TRUE(is_said) << robot->output();
}

}  // namespace
}  // namespace orbbuf::test
