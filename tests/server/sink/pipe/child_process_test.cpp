// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/child_process.hpp"

#include <sys/resource.h>

#include <cstdlib>
#include <string_view>
#include <utility>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"

namespace orbbuf {
namespace {

class ChildProcessTest : public test::EventLoop {
 protected:
  ChildProcess command(const std::string& text, Restart restart = Restart::kAlways,
                       std::vector<std::string> environment = {}) {
    return {main_, "r s", text, std::move(environment), restart};
  }
  /// The command's next start; false if there is none now.
  bool start(ChildProcess& child) {
    auto end = child.connect([this] { ++gone_; });
    EXPECT_TRUE(end);
    input_ = std::move(end).value();
    return static_cast<bool>(input_);
  }
  std::string out() const { return (folder_ / "out").string(); }
  std::string output() const { return test::read_file(folder_ / "out"); }
  bool run_until_reaped() {
    return run_until([] { return has_no_children(); });
  }
  void give(const UniqueFd& end, std::string_view text) {
    EXPECT_EQ(::write(end.get(), text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }

  test::TemporaryFolder folder_;
  UniqueFd input_;
  int gone_ = 0;
};

TEST_F(ChildProcessTest, ReadsItsStandardInputToTheEndAndIsReaped) {
  const test::CapturedLog log;
  auto child = command("cat > " + out());
  {
    auto end = child.connect([] {});
    ASSERT_TRUE(end && end.value());
    give(end.value(), "frames");
  }
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(output(), "frames");
  EXPECT_EQ(log.lines("exited with status 0").size(), 1U);
}

TEST_F(ChildProcessTest, HasTheSessionInItsEnvironmentAndNoDescriptorOfOurs) {
  const UniqueFd secret(::dup(STDOUT_FILENO));
  auto child = command("echo $ORBBUF_ROBOT $HOME > " + out() + "; ls /proc/self/fd >> " + out(),
                       Restart::kAlways, {"ORBBUF_ROBOT=r1", "HOME=/elsewhere"});
  ASSERT_TRUE(child.connect([] {}));
  ASSERT_TRUE(run_until_reaped());
  // 3 is ls reading the folder itself.
  EXPECT_EQ(output(), "r1 /elsewhere\n0\n1\n2\n3\n");
}

TEST_F(ChildProcessTest, HasNotTheHigherPriorityOfTheService) {
  if (::setpriority(PRIO_PROCESS, 0, -1) != 0) GTEST_SKIP() << "cannot raise the priority";
  auto child = command("read line; nice > " + out());
  ASSERT_TRUE(start(child));
  ASSERT_EQ(::setpriority(PRIO_PROCESS, 0, 0), 0);
  give(input_, "\n");
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(output(), "0\n");
}

TEST_F(ChildProcessTest, DiesOfABrokenPipeAsUsualThoughTheServerDoesNot) {
  const test::CapturedLog log;
  auto child = command("yes | head -n 1 > " + out() + "; kill -PIPE $$");
  ASSERT_TRUE(child.connect([] {}));
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(log.lines("was killed by signal 13 (Broken pipe)").size(), 1U);
}

TEST_F(ChildProcessTest, IsStartedAgainOnlyWhenItHasEnded) {
  auto child = command("cat >> " + out());
  auto first = child.connect([] {});
  ASSERT_TRUE(first && first.value());
  auto early = child.connect([] {});
  ASSERT_TRUE(early);
  EXPECT_FALSE(early.value());
  give(first.value(), "one ");
  first.value() = UniqueFd();
  ASSERT_TRUE(run_until_reaped());
  {
    auto second = child.connect([] {});
    ASSERT_TRUE(second && second.value());
    give(second.value(), "two");
  }
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(output(), "one two");
}

TEST_F(ChildProcessTest, ACrashLoopIsOneWarningAndSlowsDown) {
  const test::CapturedLog log;
  auto child = command("exit 3");
  ASSERT_TRUE(start(child));
  ASSERT_TRUE(run_until_reaped());
  ASSERT_TRUE(run_until([&] { return gone_ == 1; }));
  ASSERT_TRUE(start(child));
  ASSERT_TRUE(run_until([&] { return gone_ == 2; }));
  EXPECT_FALSE(start(child)) << "too early";
  EXPECT_EQ(log.lines("warning r s: command \"exit 3\": process").size(), 1U);
}

TEST_F(ChildProcessTest, WaitsLongerAndLongerForOneThatDoesNotRunLong) {
  using std::chrono::seconds;
  Backoff backoff;
  for (const int wait : {0, 2, 4, 8, 16, 30, 30})
    EXPECT_EQ(backoff.after(seconds(1)), seconds(wait));
  EXPECT_EQ(backoff.after(Backoff::kLongRun), seconds(0));
  EXPECT_EQ(backoff.after(seconds(9)), seconds(2));
}

TEST_F(ChildProcessTest, IsNotStartedAgainWhereThatIsNotWanted) {
  const test::CapturedLog log;
  struct Case {
    Restart restart;
    const char* text;
    bool is_started_again;
  };
  for (const auto& [restart, text, is_started_again] :
       {Case{Restart::kAlways, "exit 0", true}, Case{Restart::kOnFailure, "exit 0", false},
        Case{Restart::kOnFailure, "exit 1", true}, Case{Restart::kOnFailure, "kill $$", true},
        Case{Restart::kNever, "exit 1", false}}) {
    auto child = command(text, restart);
    gone_ = 0;
    ASSERT_TRUE(start(child));
    ASSERT_TRUE(run_until([&] { return gone_ == 1; }));
    EXPECT_EQ(start(child), is_started_again) << text;
    ASSERT_TRUE(run_until_reaped());
  }
  EXPECT_EQ(log.lines("; not started again").size(), 2U);
}

TEST_F(ChildProcessTest, WhatItSaysIsInTheLogBeforeItsEnd) {
  const test::CapturedLog log;
  auto child = command("echo one; echo two >&2; printf three");
  ASSERT_TRUE(start(child));
  ASSERT_TRUE(run_until_reaped());
  const auto lines = log.lines("r s: ");
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[0], "info r s: slam: one");
  EXPECT_EQ(lines[1], "info r s: slam: two");
  EXPECT_EQ(lines[2], "info r s: slam: three");
  EXPECT_TRUE(lines[3].ends_with("exited with status 0")) << lines[3];
}

TEST_F(ChildProcessTest, OneThatClosesItsOutputRunsOn) {
  const test::CapturedLog log;
  auto child = command("exec >&- 2>&-; cat > " + out());
  ASSERT_TRUE(start(child));
  give(input_, "frames");
  input_ = UniqueFd();
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(output(), "frames");
}

TEST_F(ChildProcessTest, OneThatChattersIsReadToItsEndAndHardlyHeard) {
  const test::CapturedLog log;
  auto child = command("yes | head -n 100000");
  ASSERT_TRUE(start(child));
  ASSERT_TRUE(run_until_reaped());
  EXPECT_GE(log.lines("slam: y").size(), static_cast<std::size_t>(OutputLog::kBurst));
  EXPECT_LT(log.lines("slam: y").size(), 1000U);
  EXPECT_GE(log.lines("lines left out").size(), 1U);
}

TEST_F(ChildProcessTest, WhatItLeavesBehindHoldsNothingUp) {
  const test::CapturedLog log;
  // Its own child keeps both pipes, as a daemon would. 3: sh gives what it starts with & no input.
  auto child = command("exec 3<&0; sleep 1000 <&3 & echo $! > " + out() + "; echo started");
  ASSERT_TRUE(start(child));
  ASSERT_TRUE(run_until([&] { return gone_ == 1; }));
  EXPECT_TRUE(run_until_reaped());
  EXPECT_EQ(log.lines("slam: started").size(), 1U);
  const pid_t left = std::stoi(output());
  EXPECT_EQ(::kill(left, SIGKILL), 0);
}

/// A variable of this process, for as long as it lives.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) { ::setenv(name, value, 1); }
  ~Variable() { ::unsetenv(name_); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
};

TEST_F(ChildProcessTest, DoesNotInheritWhatSystemdMeansForTheServer) {
  const Variable credentials("CREDENTIALS_DIRECTORY", "/run/credentials/orbbuf-server");
  const Variable notify("NOTIFY_SOCKET", "/run/systemd/notify");
  const Variable other("ORBBUF_TEST", "stays");
  auto child = command("echo \"$CREDENTIALS_DIRECTORY$NOTIFY_SOCKET$ORBBUF_TEST\" > " + out());
  ASSERT_TRUE(child.connect([] {}));
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(output(), "stays\n");
}

TEST_F(ChildProcessTest, OneThatIgnoresTheEndOfItsInputIsEnded) {
  using std::chrono::milliseconds;
  const test::CapturedLog log;
  for (const bool ignores_term : {false, true}) {
    const std::string command = "echo ready; sleep 1000; true";
    const auto patience = ignores_term ? milliseconds(1) : std::chrono::hours(1);
    {
      ChildProcess child(main_, "r s", (ignores_term ? "trap '' TERM; " : "") + command, {},
                         Restart::kAlways, {milliseconds(1), patience});
      ASSERT_TRUE(start(child));
      ASSERT_TRUE(
          run_until([&] { return log.lines("slam: ready").size() == (ignores_term ? 2U : 1U); }));
      input_ = UniqueFd();
    }
    ASSERT_TRUE(run_until_reaped());
    EXPECT_EQ(log.lines(std::string("was killed by signal ") + (ignores_term ? "9" : "15")).size(),
              1U);
  }
  EXPECT_EQ(log.lines("ignores the end of its input; sending SIGTERM").size(), 2U);
  EXPECT_EQ(log.lines("ignores SIGTERM; sending SIGKILL").size(), 1U);
}

TEST_F(ChildProcessTest, OneThatEndsWithItsInputGetsNoSignal) {
  const test::CapturedLog log;
  {
    auto child = command("cat > " + out());
    ASSERT_TRUE(start(child));
    input_ = UniqueFd();
  }
  ASSERT_TRUE(run_until_reaped());
  EXPECT_TRUE(log.lines("ignores").empty());
  EXPECT_EQ(log.lines("exited with status 0").size(), 1U);
}

TEST_F(ChildProcessTest, IsReapedAfterTheSessionHasGone) {
  {
    auto child = command("cat > " + out());
    ASSERT_TRUE(child.connect([] {}));
  }
  ASSERT_TRUE(run_until_reaped());
}

}  // namespace
}  // namespace orbbuf
