// SPDX-License-Identifier: Apache-2.0
#include "common/log.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <thread>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

using testing::AnyOf;
using testing::MatchesRegex;

/// Sends stderr to a file, as long as it lives.
class Log : public testing::Test {
 protected:
  Log() {
    const int file = ::open(path().c_str(), O_CREAT | O_WRONLY | O_APPEND | O_CLOEXEC, 0600);
    ::dup2(file, STDERR_FILENO);
    ::close(file);
    ::unsetenv("JOURNAL_STREAM");
  }
  ~Log() override {
    ::dup2(stderr_, STDERR_FILENO);
    ::close(stderr_);
  }

  static void pretend_journal(ino_t offset) {
    struct stat status {};
    ::fstat(STDERR_FILENO, &status);
    const std::string stream =
        std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino + offset);
    ::setenv("JOURNAL_STREAM", stream.c_str(), 1);
  }
  std::filesystem::path path() const { return folder_ / "stderr"; }
  std::string output() const { return test::read_file(path()); }

 private:
  test::TemporaryFolder folder_;
  int stderr_ = ::dup(STDERR_FILENO);
};

TEST_F(Log, LineHasTimeLevelThreadAndMessage) {
  set_up_log("info");
  log_info("connected to {}", "server:7722");
  EXPECT_THAT(output(), MatchesRegex("[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}"
                                     "\\.[0-9]{3}Z info \\[main\\] connected to server:7722\n"));
}

std::string utc_hour() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 16> date_and_hour{};
  std::strftime(date_and_hour.data(), date_and_hour.size(), "%Y-%m-%dT%H", &utc);
  return date_and_hour.data();
}

TEST_F(Log, TimeIsUtc) {
  ::setenv("TZ", "Pacific/Kiritimati", 1);  // 14 hours ahead
  ::tzset();
  set_up_log("info");
  const auto begin = utc_hour();
  log_info("x");
  const auto end = utc_hour();
  ::unsetenv("TZ");
  ::tzset();
  EXPECT_THAT(output().substr(0, 13), AnyOf(begin, end));
}

TEST_F(Log, LevelsBelowTheChosenOneAreSilent) {
  set_up_log("warn");
  log_info("quiet");
  log_warn("loud");
  log_error("louder");
  EXPECT_THAT(output(),
              MatchesRegex("[^ ]* warn \\[main\\] loud\n[^ ]* error \\[main\\] louder\n"));
}

TEST_F(Log, LevelsHaveTheNamesOfTheConfiguration) {
  set_up_log("trace");
  log_at(LogLevel::kTrace, "x");
  log_debug("x");
  EXPECT_THAT(output(), MatchesRegex("[^ ]* trace \\[main\\] x\n[^ ]* debug \\[main\\] x\n"));
}

TEST_F(Log, UnknownLevelIsRefused) {
  EXPECT_THROW(set_up_log("verbose"), std::invalid_argument);
  EXPECT_THROW(set_log_level("verbose"), std::invalid_argument);
}

TEST_F(Log, LevelMayBeChosenAnew) {
  set_up_log("info");
  set_log_level("error");
  EXPECT_FALSE(is_logged(LogLevel::kWarn));
  EXPECT_TRUE(is_logged(LogLevel::kError));
  log_warn("quiet");
  log_error("{} of {}", 1, "two");
  EXPECT_THAT(output(), MatchesRegex("[^ ]* error \\[main\\] 1 of two\n"));
}

TEST_F(Log, ThreadThatLogsIsNamed) {
  set_up_log("info");
  std::thread([] {
    name_this_thread("worker");
    log_info("x");
  }).join();
  EXPECT_THAT(output(), MatchesRegex("[^ ]* info \\[worker\\] x\n"));
}

TEST_F(Log, LongThreadNameIsCut) {
  std::array<char, 16> name{};
  std::thread([&] {
    name_this_thread("a-very-long-thread-name");
    pthread_getname_np(pthread_self(), name.data(), name.size());
  }).join();
  EXPECT_STREQ(name.data(), "a-very-long-thr");
}

TEST_F(Log, JournalGetsItsPrefixInsteadOfTimeAndLevel) {
  pretend_journal(0);
  set_up_log("debug");
  log_debug("d");
  log_info("i");
  log_warn("w");
  log_error("e");
  EXPECT_EQ(output(), "<7>[main] d\n<6>[main] i\n<4>[main] w\n<3>[main] e\n");
}

TEST_F(Log, RedirectedStderrIsNotTheJournal) {
  pretend_journal(1);
  set_up_log("info");
  log_info("x");
  EXPECT_THAT(output(), MatchesRegex("[^ ]*Z info \\[main\\] x\n"));
}

TEST_F(Log, PrintableIsWhatEveryTerminalShows) {
  EXPECT_EQ(printable("HD Cam ~1"), "HD Cam ~1");
  EXPECT_EQ(printable("a\nb\x1B\x7F\xC3\xA9"), "a?b????");
}

}  // namespace
}  // namespace orbbuf
