// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_list.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {}  // namespace
}  // namespace orbbuf
