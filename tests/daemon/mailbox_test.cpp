// SPDX-License-Identifier: Apache-2.0
#include "daemon/mailbox.hpp"

#include <gtest/gtest.h>

#include <thread>

namespace orbbuf {
namespace {

TEST(Mailbox, LatestWinsAndTheWriterLearnsWhatWasOverwritten) {
  Mailbox<int> mailbox(1);
  EXPECT_FALSE(mailbox.put(1));
  EXPECT_EQ(mailbox.put(2), 1);
  EXPECT_EQ(mailbox.take(), 2);
  EXPECT_FALSE(mailbox.put(3));
}

TEST(Mailbox, ABurstHasASlotForEachAndThenTheOldestGoes) {
  Mailbox<int> mailbox(3);
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(mailbox.put(i));
  EXPECT_EQ(mailbox.put(3), 0);
  for (int i = 1; i <= 3; ++i) EXPECT_EQ(mailbox.take(), i);
  EXPECT_TRUE(mailbox.take_would_wait());
}

TEST(Mailbox, WhatIsInTheSlotCanBeTakenAfterClosing) {
  Mailbox<int> mailbox(1);
  mailbox.put(1);
  mailbox.close();
  EXPECT_EQ(mailbox.take(), 1);
  EXPECT_EQ(mailbox.take(), std::nullopt);
}

TEST(Mailbox, ReaderWouldWaitOnlyWhileItIsOpenAndEmpty) {
  Mailbox<int> mailbox(1);
  EXPECT_TRUE(mailbox.take_would_wait());
  mailbox.put(1);
  EXPECT_FALSE(mailbox.take_would_wait());
  mailbox.take();
  EXPECT_TRUE(mailbox.take_would_wait());
  mailbox.close();
  EXPECT_FALSE(mailbox.take_would_wait());
}

TEST(Mailbox, ReaderIsWokenByPutAndByClose) {
  Mailbox<int> mailbox(1);
  std::jthread writer([&] {
    mailbox.put(7);
    std::stop_source never;
    mailbox.wait_until_empty(never.get_token());
    mailbox.close();
  });
  EXPECT_EQ(mailbox.take(), 7);
  EXPECT_EQ(mailbox.take(), std::nullopt);
}

TEST(Mailbox, WaitingForAnEmptySlotEndsWhenStopIsRequested) {
  Mailbox<int> mailbox(1);
  std::stop_source stop;
  EXPECT_TRUE(mailbox.wait_until_empty(stop.get_token()));
  mailbox.put(1);
  std::jthread stopper([&] { stop.request_stop(); });
  EXPECT_FALSE(mailbox.wait_until_empty(stop.get_token()));
}

TEST(Mailbox, EveryItemIsEitherTakenOrReportedAsOverwritten) {
  constexpr int kItems = 100'000;
  Mailbox<int> mailbox(3);
  int overwritten = 0;
  std::jthread writer([&] {
    for (int i = 0; i < kItems; ++i) overwritten += mailbox.put(i).has_value();
    mailbox.close();
  });
  int taken = 0;
  int last = -1;
  while (const auto item = mailbox.take()) {
    EXPECT_GT(*item, last);
    last = *item;
    ++taken;
  }
  writer.join();
  EXPECT_EQ(taken + overwritten, kItems);
  EXPECT_EQ(last, kItems - 1);
}

}  // namespace
}  // namespace orbbuf
