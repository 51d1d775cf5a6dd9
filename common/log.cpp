// SPDX-License-Identifier: Apache-2.0
#include "common/log.hpp"

#include <fcntl.h>
#include <pthread.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <stdexcept>

#include "common/format.hpp"
#include "common/non_blocking_sink.hpp"
#include "common/unique_fd.hpp"

#if FMT_VERSION < 100000
template void fmt::detail::vformat_to<char>(fmt::detail::buffer<char>&, fmt::string_view,
                                            fmt::format_args, fmt::detail::locale_ref);
#endif

namespace orbbuf {
namespace {

/// As sd-daemon(3) has them; in the order of LogLevel, which is spdlog's.
constexpr std::array<std::string_view, kLogLevels.size()> kJournalPrefixes = {"<7>", "<7>", "<6>",
                                                                              "<4>", "<3>"};

/// `critical`, which we do not use, goes as an error.
std::size_t place_of(spdlog::level::level_enum level) {
  return std::min(static_cast<std::size_t>(level), kLogLevels.size() - 1);
}

void append(spdlog::memory_buf_t& to, std::string_view text) {
  to.append(text.data(), text.data() + text.size());
}

/// A part of the pattern: what `Append` appends.
template <void (*Append)(const spdlog::details::log_msg&, spdlog::memory_buf_t&)>
class Flag : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm& /*time*/,
              spdlog::memory_buf_t& to) override {
    Append(message, to);
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<Flag>(); }
};

void append_level(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) {
  append(to, kLogLevels.at(place_of(message.level)));
}

void append_journal_prefix(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) {
  append(to, kJournalPrefixes.at(place_of(message.level)));
}

/// The calling thread is the one that logs, since the logger is synchronous. The first one goes by
/// the program's name in the kernel, for pgrep and top, and by "main" in the log.
void append_thread_name(const spdlog::details::log_msg& /*message*/, spdlog::memory_buf_t& to) {
  if (gettid() == getpid()) return append(to, "main");
  std::array<char, 16> name{};
  if (pthread_getname_np(pthread_self(), name.data(), name.size()) == 0) append(to, name.data());
}

/// systemd.exec(5): $JOURNAL_STREAM holds DEVICE:INODE of the stream that it has set up. A stderr
/// redirected since then does not match.
bool is_stderr_the_journal() {
  const char* const stream = std::getenv("JOURNAL_STREAM");
  struct stat status {};
  if (stream == nullptr || fstat(STDERR_FILENO, &status) != 0) return false;
  return stream == std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino);
}

/// Opens a pipe or terminal again, as stderr, so that O_NONBLOCK is ours alone and not also that of
/// the processes that we have stderr from. Libraries that write to stderr do not wait then either.
/// The rest is left as it is, or what we may not open.
void unblock_stderr() {
  struct stat status {};
  if (fstat(STDERR_FILENO, &status) != 0) return;
  if (!S_ISFIFO(status.st_mode) && isatty(STDERR_FILENO) == 0) return;
  const UniqueFd own(open("/proc/self/fd/2", O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  if (own) dup2(own.get(), STDERR_FILENO);
}

spdlog::level::level_enum level_from(LogLevel level) {
  return static_cast<spdlog::level::level_enum>(level);
}
static_assert(static_cast<int>(LogLevel::kTrace) == spdlog::level::trace &&
              static_cast<int>(LogLevel::kError) == spdlog::level::err);

spdlog::level::level_enum level_from(std::string_view word) {
  const auto* const found = std::ranges::find(kLogLevels, word);
  if (found != kLogLevels.end()) {
    return static_cast<spdlog::level::level_enum>(found - kLogLevels.begin());
  }
  throw std::invalid_argument("unknown log level '" + std::string(word) + "'");
}

}  // namespace

void write_log(LogLevel level, fmt::string_view format, fmt::format_args values) {
  if (!is_logged(level)) return;
  const std::string line = fmt::vformat(format, values);
  spdlog::default_logger_raw()->log(level_from(level), spdlog::string_view_t(line));
}

bool is_logged(LogLevel level) { return spdlog::should_log(level_from(level)); }

void set_log_level(std::string_view level) { spdlog::set_level(level_from(level)); }

void set_up_log(std::string_view level) {
  const auto threshold = level_from(level);
  auto formatter = std::make_unique<spdlog::pattern_formatter>(spdlog::pattern_time_type::utc);
  formatter->add_flag<Flag<append_level>>('L');
  formatter->add_flag<Flag<append_thread_name>>('N');
  formatter->add_flag<Flag<append_journal_prefix>>('J');
  formatter->set_pattern(is_stderr_the_journal() ? "%J[%N] %v"
                                                 : "%Y-%m-%dT%H:%M:%S.%eZ %L [%N] %v");
  unblock_stderr();
  auto logger =
      std::make_shared<spdlog::logger>("", std::make_shared<NonBlockingSink>(STDERR_FILENO));
  logger->set_formatter(std::move(formatter));
  logger->set_level(threshold);
  spdlog::set_default_logger(std::move(logger));
}

std::string printable(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

void name_this_thread(const char* name) {
  constexpr std::size_t kMaxChars = 15;  // the kernel's limit; longer names are refused, not cut
  pthread_setname_np(pthread_self(), std::string(name).substr(0, kMaxChars).c_str());
}

}  // namespace orbbuf
