// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <string_view>

namespace orbbuf {

inline constexpr std::array<std::string_view, 5> kLogLevels = {"trace", "debug", "info", "warn",
                                                               "error"};

/// Sends spdlog's default logger to stderr, synchronously, but without waiting if nothing reads
/// stderr (NonBlockingSink); a pipe or terminal gets O_NONBLOCK. `level`: one of kLogLevels. Lines
/// carry time, level and thread name; under systemd (stderr is the journal, per $JOURNAL_STREAM) an
/// sd-daemon(3) `<N>` prefix instead of time and level. Throws std::invalid_argument for another
/// level. Call once, from main().
void set_up_log(std::string_view level);

/// `text` with '?' for every byte that is not printable ASCII, for texts from outside.
std::string printable(std::string text);

/// Names the calling thread, at most 15 characters, for the log and for tools such as top -H. Not
/// for the first thread: its name is the process's name, and the log calls it `main`.
void name_this_thread(const char* name);

}  // namespace orbbuf
