// SPDX-License-Identifier: Apache-2.0
#include "common/error.hpp"

#include <gtest/gtest.h>

#include <cerrno>
#include <stdexcept>

namespace orbbuf {
namespace {

Result<int> half_of(int number) {
  if (number % 2 != 0) return Error{"cannot halve: odd"};
  return number / 2;
}

TEST(Error, SystemErrorSaysWhatWasTriedAndWhy) {
  EXPECT_EQ(system_error("cannot open /dev/video9", ENOENT).text,
            "cannot open /dev/video9: No such file or directory");
}

TEST(Error, ThrownSystemErrorHasTheTextOfErrno) {
  errno = EADDRINUSE;
  try {
    throw_system_error("cannot listen on port 7722");
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "cannot listen on port 7722: Address already in use");
  }
}

TEST(Error, ResultIsAValueOrAnError) {
  EXPECT_EQ(half_of(4).value(), 2);
  EXPECT_EQ(half_of(3).error().text, "cannot halve: odd");
}

}  // namespace
}  // namespace orbbuf
