// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/outcome/basic_result.hpp>
#include <boost/outcome/policy/terminate.hpp>
#include <string>
#include <string_view>

namespace orbbuf {

/// Why something expected to fail now and then did: what was tried, on what, and why, in one line.
struct Error {
  std::string text;
};

/// A value or an Error, for running code, which never throws across a module. Reading the side that
/// is not there terminates: check first.
template <class T>
using Result = boost::outcome_v2::basic_result<T, Error, boost::outcome_v2::policy::terminate>;

/// `attempt: reason`, where the reason is the system's text for `error_number` (an errno value).
Error system_error(std::string_view attempt, int error_number);

/// Start-up only: throws std::runtime_error with the text of system_error(attempt, errno).
[[noreturn]] void throw_system_error(std::string_view attempt);

}  // namespace orbbuf
