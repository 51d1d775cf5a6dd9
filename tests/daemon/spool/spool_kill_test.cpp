// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>

#include "common/unique_fd.hpp"
#include "daemon/spool/spool.hpp"
#include "tests/daemon/spool/spool_fixture.hpp"

namespace orbbuf::test {
namespace {

/// A process that spools frames 0, 1, 2, ... until it is killed.
class SpoolingProcess {
 public:
  SpoolingProcess(const SpoolSettings& settings, const std::string& session_id) {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
    written_ = UniqueFd(ends[0]);
    const UniqueFd to_parent(ends[1]);
    pid_ = ::fork();
    if (pid_ == 0) run(settings, session_id, to_parent.get());
  }
  ~SpoolingProcess() { kill(); }
  SpoolingProcess(const SpoolingProcess&) = delete;
  SpoolingProcess& operator=(const SpoolingProcess&) = delete;

  /// Until `count` more frames are in its files.
  void wait_for(int count) {
    for (std::array<char, 1> byte{}; count > 0; --count) {
      if (::read(written_.get(), byte.data(), 1) != 1) throw std::runtime_error("the child ended");
      ++found_;
    }
  }
  /// How many frames were in its files for certain.
  std::uint64_t kill() {
    if (pid_ <= 0) return found_;
    ::kill(pid_, SIGKILL);
    ::waitpid(std::exchange(pid_, -1), nullptr, 0);
    for (std::array<char, 1> byte{}; ::read(written_.get(), byte.data(), 1) == 1;) ++found_;
    return found_;
  }

 private:
  [[noreturn]] static void run(const SpoolSettings& settings, const std::string& session_id,
                               int to_parent) {
    WatchedSpool spool(settings, session_id);
    Sequence skipped = 0;
    for (const auto& [session, frames, first] : spool->held()) skipped += frames;
    while (skipped-- > 0) spool.next();
    for (Sequence sequence = 0;; ++sequence) {
      spool->add(spool_frame(sequence, 1 + sequence * 7919 % 50'000));
      spool.next();  // it was read from the file
      if (::write(to_parent, ".", 1) != 1) std::_Exit(1);
    }
  }

  UniqueFd written_;
  pid_t pid_ = -1;
  std::uint64_t found_ = 0;
};

using SpoolKillTest = SpoolTest;

TEST_F(SpoolKillTest, AllFramesThatWereWrittenAreFoundAfterAKill) {
  std::vector<std::uint64_t> written;
  for (const int count : {0, 1, 50, 200}) {
    SpoolingProcess process(settings(), "killed-" + std::to_string(written.size()));
    process.wait_for(count);
    written.push_back(process.kill());
  }
  WatchedSpool spool(settings(), "after");
  for (std::size_t kill = 0; kill < written.size(); ++kill) {
    const std::string session = "killed-" + std::to_string(kill);
    std::uint64_t held = 0;  // perhaps one more, of which the parent does not know
    for (const auto& [session_id, frames, first] : spool->held()) {
      if (session_id == session) held = frames;
    }
    EXPECT_GE(held, written[kill]);
    EXPECT_LE(held, written[kill] + 1);
    for (Sequence sequence = 0; sequence < held; ++sequence) {
      const SpooledFrame spooled = spool.next();
      ASSERT_EQ(spooled.session_id, session);
      ASSERT_TRUE(is_same(*spooled.frame, *spool_frame(sequence, 1 + sequence * 7919 % 50'000)));
    }
  }
  EXPECT_FALSE(spool->next());
  EXPECT_EQ(spool->stats().damaged, 0U);
}

TEST_F(SpoolKillTest, ATailTornByAPowerCutCostsTheLastFrameOnly) {
  {
    SpoolingProcess process(settings(), "cut");
    process.wait_for(30);
  }
  const auto file = segments().back();
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 1);
  WatchedSpool spool(settings(), "after");
  const auto held = spool->held();
  ASSERT_EQ(held.size(), 1U);
  EXPECT_GE(held[0].frames, 29U);
  EXPECT_EQ(spool.take(held[0].frames), numbers(0, held[0].frames));
  EXPECT_EQ(spool->stats().damaged, 0U);
}

}  // namespace
}  // namespace orbbuf::test
