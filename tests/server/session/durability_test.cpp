// SPDX-License-Identifier: Apache-2.0
#include "server/session/durability.hpp"

#include <gtest/gtest.h>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

TEST(Durability, AFileSystemOfThisMachineIsNotWeak) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(weak_file_system(folder.path()), std::nullopt);
}

TEST(Durability, WhatIsNotThereIsNotWeak) {
  EXPECT_EQ(weak_file_system("/not/there"), std::nullopt);
}

TEST(Durability, WeakFileSystemsAreKnownByTheirNumbers) {  // as stat -f -c %t has them
  EXPECT_EQ(weak_kind(0x65735546), "FUSE");
  EXPECT_EQ(weak_kind(0x6969), "NFS");
  EXPECT_EQ(weak_kind(0xFF534D42), "SMB");
  EXPECT_EQ(weak_kind(0xEF53), std::nullopt);  // ext4
}

}  // namespace
}  // namespace orbbuf
