// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/core.h>

#include <array>
#include <chrono>
#include <string>
#include <string_view>

namespace orbbuf {

inline constexpr std::array<std::string_view, 5> kLogLevels = {"trace", "debug", "info", "warn",
                                                               "error"};

/// Of a line of the log. An error needs a person; a warning was recovered from.
enum class LogLevel { kTrace, kDebug, kInfo, kWarn, kError };

/// Logs one line, if lines of this level are logged. Thread-safe. The headers of spdlog are left to
/// log.cpp: a file that logs takes a third of the time to compile.
void write_log(LogLevel level, fmt::string_view format, fmt::format_args values);

template <class... Values>
void log_at(LogLevel level, fmt::format_string<Values...> format, Values&&... values) {
  write_log(level, format, fmt::make_format_args(values...));
}
template <class... Values>
void log_debug(fmt::format_string<Values...> format, Values&&... values) {
  write_log(LogLevel::kDebug, format, fmt::make_format_args(values...));
}
template <class... Values>
void log_info(fmt::format_string<Values...> format, Values&&... values) {
  write_log(LogLevel::kInfo, format, fmt::make_format_args(values...));
}
template <class... Values>
void log_warn(fmt::format_string<Values...> format, Values&&... values) {
  write_log(LogLevel::kWarn, format, fmt::make_format_args(values...));
}
template <class... Values>
void log_error(fmt::format_string<Values...> format, Values&&... values) {
  write_log(LogLevel::kError, format, fmt::make_format_args(values...));
}

/// Whether lines of this level are logged.
bool is_logged(LogLevel level);

/// Sends the log to stderr, synchronously, but without waiting if nothing reads
/// stderr (NonBlockingSink); a pipe or terminal gets O_NONBLOCK. `level`: one of kLogLevels. Lines
/// carry time, level and thread name; under systemd (stderr is the journal, per $JOURNAL_STREAM) an
/// sd-daemon(3) `<N>` prefix instead of time and level. Throws std::invalid_argument for another
/// level. Call once, from main().
void set_up_log(std::string_view level);

/// Logs from this level on: one of kLogLevels, else throws std::invalid_argument.
void set_log_level(std::string_view level);

/// `text` with '?' for every byte that is not printable ASCII, for texts from outside.
std::string printable(std::string text);

/// Names the calling thread, at most 15 characters, for the log and for tools such as top -H. Not
/// for the first thread: its name is the process's name, and the log calls it `main`.
void name_this_thread(const char* name);

/// Limits a message that could be logged with every frame: lets the first one through, and then
/// one per `interval`. Thread-bound.
class LogLimit {
 public:
  using Moment = std::chrono::steady_clock::time_point;

  explicit LogLimit(std::chrono::nanoseconds interval) : interval_(interval) {}

  bool lets_through(Moment now = std::chrono::steady_clock::now()) {
    if (now < next_) return false;
    next_ = now + interval_;
    return true;
  }

 private:
  std::chrono::nanoseconds interval_;
  Moment next_ = Moment::min();
};

}  // namespace orbbuf
