// SPDX-License-Identifier: Apache-2.0
#include "server/sink/child_process.hpp"

#include <string_view>

#include "tests/server/captured_log.hpp"
#include "tests/server/sink/event_loop.hpp"
#include "tests/support/temporary_folder.hpp"

namespace orbbuf {
namespace {

class ChildProcessTest : public test::EventLoop {
 protected:
  ChildProcess command(const std::string& text, std::vector<std::string> environment = {}) {
    return {main_, text, std::move(environment)};
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
};

TEST_F(ChildProcessTest, ReadsItsStandardInputToTheEndAndIsReaped) {
  const test::CapturedLog log;
  auto child = command("cat > " + out());
  {
    auto end = child.open();
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
                       {"ORBBUF_ROBOT=r1", "HOME=/elsewhere"});
  ASSERT_TRUE(child.open());
  ASSERT_TRUE(run_until_reaped());
  // 3 is ls reading the folder itself.
  EXPECT_EQ(output(), "r1 /elsewhere\n0\n1\n2\n3\n");
}

TEST_F(ChildProcessTest, DiesOfABrokenPipeAsUsualThoughTheServerDoesNot) {
  const test::CapturedLog log;
  auto child = command("yes | head -n 1 > " + out() + "; kill -PIPE $$");
  ASSERT_TRUE(child.open());
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(log.lines("was killed by signal 13 (Broken pipe)").size(), 1U);
}

TEST_F(ChildProcessTest, IsStartedAgainOnlyWhenItHasEnded) {
  auto child = command("cat >> " + out());
  auto first = child.open();
  ASSERT_TRUE(first && first.value());
  auto early = child.open();
  ASSERT_TRUE(early);
  EXPECT_FALSE(early.value());
  give(first.value(), "one ");
  first.value() = UniqueFd();
  ASSERT_TRUE(run_until_reaped());
  {
    auto second = child.open();
    ASSERT_TRUE(second && second.value());
    give(second.value(), "two");
  }
  ASSERT_TRUE(run_until_reaped());
  EXPECT_EQ(output(), "one two");
}

TEST_F(ChildProcessTest, ACrashLoopIsOneWarning) {
  const test::CapturedLog log;
  auto child = command("exit 3");
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(child.open());
    ASSERT_TRUE(run_until_reaped());
    run_ready();
  }
  EXPECT_EQ(log.lines("warning command \"exit 3\": process").size(), 1U);
}

TEST_F(ChildProcessTest, IsReapedAfterTheSessionHasGone) {
  {
    auto child = command("cat > " + out());
    ASSERT_TRUE(child.open());
  }
  ASSERT_TRUE(run_until_reaped());
}

}  // namespace
}  // namespace orbbuf
