// SPDX-License-Identifier: Apache-2.0
#include "server/session/records.hpp"

#include <gmock/gmock.h>

#include <limits>
#include <string>

#include "common/byte_order.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;

constexpr journal::Place kKept{3, 0x123456};

RecordedFrame frame(Sequence sequence) {
  RecordedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = -7;
  frame.arrived_ns = 1'763'779'406'123'456'789;
  frame.exposure_ns = 8'500'000;
  frame.width_px = 640;
  frame.height_px = 480;
  frame.bytes = 1000;
  frame.left_bytes = 400;
  frame.crc = 0x0A1B2C3D;
  frame.crc_right = 0x1A1B2C3D;
  frame.whole_bytes = 3000;
  frame.whole_crc = 0x2A1B2C3D;
  frame.quality = 30;
  return frame;
}

RecordedFrame replacing(Sequence sequence) {
  RecordedFrame whole = frame(sequence);
  whole.is_late = whole.is_replacing = true;
  whole.whole_bytes = whole.whole_crc = 0;
  whole.bytes = 3000;
  whole.replaced_bytes = 1000;
  return whole;
}

wire::Account account() {
  wire::Account account;
  account.session_id = "s";
  account.captured = 100;
  account.confirmed = 50;
  account.held = 4;
  account.first_held = 60;
  account.given_up = {{7, 1, DropReason::kPolicy, 3, 2, 9}};
  return account;
}

SessionSummary summary() {
  SessionSummary summary;
  summary.info = {"robot", "session", "Pinhole\n", {{4, "imu0", "imu"}}};
  summary.position = {1300, 40};
  summary.position[31] = 5;
  summary.totals = {1, 2, 3, 4, 5};
  summary.end = 1301;
  summary.late_end = 1299;
  summary.is_closed = true;
  summary.closing = {true, wire::Stats{1, 2, 3, 4, 5, 6, 7}, -9};
  summary.account = account();
  summary.account->given_up.clear();
  summary.part = RecordedPart{2, {0, 13}, {1, 99}};
  summary.removed = {0, 13};
  return summary;
}

std::vector<RecordBody> bodies() {
  return {SessionSummary{},
          summary(),
          frame(123),
          replacing(124),
          RecordedItems{wire::kDrops, 5, 6, wire::encode_drops(account().given_up)},
          RecordedReport{{1, 2, 3, 4, 5, 6, 7}, -9},
          account(),
          RecordedCalibration{"Pinhole\n"},
          RecordedEnd{true},
          RecordedPart{2, {0, 13}, {1, 99}}};
}

TEST(Records, AreReadBackAsTheyWereWritten) {
  for (const RecordBody& body : bodies()) {
    const auto bytes = encode(body, kKept);
    const auto decoded = decode_record(type_of(body), bytes);
    ASSERT_TRUE(decoded) << body.index();
    EXPECT_EQ(*decoded, (SessionRecord{kKept, body})) << body.index();
  }
}

TEST(Records, OfAnotherLengthAreNone) {
  for (const RecordBody& body : bodies()) {
    auto bytes = encode(body, kKept);
    const bool is_open_ended = std::holds_alternative<RecordedItems>(body);
    for (std::size_t size = 0; size < bytes.size() && !is_open_ended; ++size) {
      EXPECT_FALSE(decode_record(type_of(body), std::span(bytes).first(size))) << body.index();
    }
    bytes.push_back(0);
    EXPECT_EQ(decode_record(type_of(body), bytes).has_value(), is_open_ended) << body.index();
  }
  EXPECT_FALSE(decode_record(8, encode(RecordedEnd{}, kKept)));
}

TEST(Records, OfALaterVersionAreNone) {
  auto bytes = encode(summary(), kKept);
  ++bytes[8];
  EXPECT_FALSE(decode_record(0, bytes));
}

/// The format is a file format: it may not change by accident.
TEST(Records, AFrameIsTheseBytes) {
  RecordedFrame one = frame(0x0102);
  one.capture_time_ns = 1;
  one.arrived_ns = 2;
  const auto bytes = encode(one, kKept);
  EXPECT_EQ(bytes,
            (std::vector<std::uint8_t>{0,    0,    3,    0,    0,    0x12, 0x34, 0x56,  // kept
                                       0,    30,   2,    0x80, 1,    0xE0,  // flags, quality, size
                                       0,    0,    0,    0,    0,    0,    1,    2,  // number
                                       0,    0,    0,    0,    0,    0,    0,    1,  // captured
                                       0,    0,    0,    0,    0,    0,    0,    2,  // arrived
                                       0,    0x81, 0xB3, 0x20, 0,    0,    3,    0xE8,
                                       0,    0,    1,    0x90,  // exposure, bytes, left
                                       0x0A, 0x1B, 0x2C, 0x3D, 0x1A, 0x1B, 0x2C, 0x3D,  // checksums
                                       0,    0,    0x0B, 0xB8, 0x2A, 0x1B, 0x2C, 0x3D}));  // whole
}

TEST(Records, AddUpToASummary) {
  SessionSummary sum;
  RecordedFrame live = frame(10);
  add(live, sum);
  add(replacing(10), sum);
  RecordedFrame late = frame(4);
  late.is_late = true;
  late.bytes = 70;
  add(late, sum);
  add(RecordedItems{wire::kDrops, 0, 1, wire::encode_drops(account().given_up)}, sum);
  add(RecordedItems{5, 0, 9, {1, 2, 3}}, sum);
  EXPECT_EQ(sum.totals, (SessionTotals{1, 1, 1, 2, 3000 + 70}));
  EXPECT_EQ(sum.position[wire::kFrames], 11U);
  EXPECT_EQ(sum.position[wire::kDrops], 1U);
  EXPECT_EQ(sum.position[5], 9U);
  EXPECT_EQ(sum.end, 11U);
  EXPECT_EQ(sum.late_end, 11U);
  EXPECT_EQ(sum.captured(), 11U);
  add(RecordedReport{{20, 0, 0, 0, 0, 0, 0}, 4}, sum);
  EXPECT_EQ(sum.captured(), 20U);
  add(account(), sum);
  EXPECT_EQ(sum.captured(), 100U);
  EXPECT_TRUE(sum.is_held());
  EXPECT_TRUE(sum.account->given_up.empty());
  EXPECT_FALSE(sum.has_ended());
  add(RecordedEnd{true}, sum);
  EXPECT_TRUE(sum.has_ended());
}

TEST(Records, TheLastPartNeedNotBeTheOneThatIsTheOnlyCopy) {
  SessionSummary sum;
  add(RecordedPart{1, {}, {0, 100}}, sum);
  EXPECT_FALSE(sum.has_removed());
  add(RecordedPart{2, {0, 100}, {1, 200}, true}, sum);
  add(RecordedPart{3, {1, 200}, {1, 300}}, sum);
  EXPECT_EQ(sum.removed, (journal::Place{1, 200}));
  EXPECT_EQ(sum.part->number, 3U);
}

TEST(Records, ARobotsReportDoesNotMoveTheKnownEnd) {
  SessionSummary sum;
  add(frame(10), sum);
  add(RecordedReport{{std::numeric_limits<std::uint64_t>::max(), 0, 0, 0, 0, 0, 0}, 0}, sum);
  EXPECT_EQ(sum.known_end(), 11U);
  add(account(), sum);
  EXPECT_EQ(sum.known_end(), 100U);
}

TEST(RecordReader, WhatCannotBeUnderstoodIsDamage) {
  const test::TemporaryFolder folder;
  journal::Writer out(folder.path(), 1U << 20, false, [] { return encode(SessionSummary{}, {}); });
  const std::vector<std::uint8_t> junk = {1, 2, 3};
  ASSERT_TRUE(out.append(1, {junk}));
  ASSERT_TRUE(out.append(type_of(RecordedEnd{}), {encode(RecordedEnd{}, {})}));
  RecordReader reader(folder.path());
  std::vector<std::size_t> types;
  while (const auto entry = reader.next().value()) types.push_back(entry->record.body.index());
  EXPECT_THAT(types, ElementsAre(0, 6));
  EXPECT_EQ(reader.damaged_bytes(), journal::kHeadBytes + 3);
}

}  // namespace
}  // namespace orbbuf
