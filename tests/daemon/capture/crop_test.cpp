// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/crop.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

TEST(Crop, IsReadAsItIsWritten) {
  EXPECT_EQ(parse_crop("640x480+320+120"), (Crop{640, 480, 320, 120}));
  EXPECT_EQ(to_string(Crop{640, 480, 0, 120}), "640x480+0+120");
  EXPECT_EQ(parse_crop(to_string(Crop{99999, 1, 0, 99999})), (Crop{99999, 1, 0, 99999}));
}

TEST(Crop, NothingElseIs) {
  for (const auto* const text :
       {"", "640", "640x480", "640x480+1", "640x480+1+", "640x480+1+2+", "640x480+1+2 ",
        "0x480+1+2", "640x0+1+2", "-640x480+1+2", "640x480+-1+2", "640x480-1-2", "640,480,1,2",
        "100000x1+0+0", "640x480+1+99999999999", " 640x480+1+2", "640X480+1+2"}) {
    EXPECT_FALSE(parse_crop(text)) << text;
  }
}

}  // namespace
}  // namespace orbbuf
