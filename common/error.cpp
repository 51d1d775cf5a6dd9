// SPDX-License-Identifier: Apache-2.0
#include "common/error.hpp"

#include <cerrno>
#include <stdexcept>
#include <system_error>

namespace orbbuf {

Error system_error(std::string_view attempt, int error_number) {
  // strerror() is not thread-safe; the category's message() is.
  return {std::string(attempt) + ": " + std::generic_category().message(error_number)};
}

void throw_system_error(std::string_view attempt) {
  throw std::runtime_error(system_error(attempt, errno).text);
}

}  // namespace orbbuf
