// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "server/recording/late_list.hpp"

namespace orbbuf {
namespace {}  // namespace
}  // namespace orbbuf
