// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_format.hpp"

#include <gtest/gtest.h>

#include "tests/daemon/record/record_fixture.hpp"

namespace orbbuf::record_format {
namespace {

using test::capture_time;
using test::drop;

std::vector<std::uint8_t> sample_account() {
  DropRanges drops;
  drops.add(drop(3));
  drops.add({5, 50, DropReason::kBusy, 4, 10, 140});
  wire::Writer out(0);
  put(out, {"r/s", true, false, 20, 200, 15, 12}, drops);
  return out.bytes();
}

TEST(RecordFormat, AnAccountComesBack) {
  const auto bytes = sample_account();
  wire::Reader in(bytes);
  DropRanges drops;
  const auto account = take_account(in, drops);
  ASSERT_TRUE(account);
  EXPECT_EQ(in.left(), 0U);
  EXPECT_EQ(account->name, "r/s");
  EXPECT_TRUE(account->has_ended);
  EXPECT_FALSE(account->is_settled);
  EXPECT_EQ(account->captured, 20U);
  EXPECT_EQ(account->last_capture_time_ns, 200);
  EXPECT_EQ(account->confirmed, 15U);
  EXPECT_EQ(account->settled_below, 12U);
  ASSERT_EQ(drops.size(), 2U);
  EXPECT_EQ(drops.take_first(), drop(3));
  EXPECT_EQ(drops.take_first(), (DropRecord{5, 50, DropReason::kBusy, 4, 10, 140}));
}

/// As the specification in the header says.
TEST(RecordFormat, TheBytesOfAnAccount) {
  DropRanges drops;
  drops.add({0x0102, 0x03, DropReason::kFailed, 0x0405, 2, 0x06});
  wire::Writer out(0);
  put(out, {"r/s", false, true, 7, 8, 9, 10}, drops);
  const std::vector<std::uint8_t> expected = {0, 3, 'r', '/', 's',            // name
                                              2,                              // settled
                                              0, 0, 0,   0,   0,   0, 0, 7,   // captured
                                              0, 0, 0,   0,   0,   0, 0, 8,   // capture time
                                              0, 0, 0,   0,   0,   0, 0, 9,   // confirmed
                                              0, 0, 0,   0,   0,   0, 0, 10,  // settled below
                                              0, 0, 0,   0,                   // streams
                                              0, 0, 0,   1,                   // drop records
                                              0, 0, 0,   0,   0,   0, 1, 2,   // number
                                              0, 0, 0,   0,   0,   0, 0, 2,   // frames
                                              0, 0, 0,   0,   0,   0, 0, 3,   // first time
                                              0, 0, 0,   0,   0,   0, 0, 6,   // last time
                                              3, 4, 5};
  EXPECT_EQ(out.bytes(), expected);
}

TEST(RecordFormat, AnAccountThatIsCutIsNone) {
  const auto bytes = sample_account();
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    wire::Reader in(Bytes(bytes).first(size));
    DropRanges drops;
    EXPECT_FALSE(take_account(in, drops)) << size;
  }
}

TEST(RecordFormat, ADropRecordThatCannotBeIsNone) {
  for (const DropRecord& bad : {DropRecord{5, 0, DropReason::kPolicy, 0, 0},
                                DropRecord{5, 0, DropReason::kPolicy, 0, ~0ULL},
                                DropRecord{5, 0, static_cast<DropReason>(0)},
                                DropRecord{5, 0, static_cast<DropReason>(99)}}) {
    wire::Writer out(0);
    put(out, {"r/s"}, {});
    out.bytes().back() = 1;  // one record
    out.put(bad.sequence);
    out.put(bad.frames);
    out.put_zeros(16);
    out.put(static_cast<std::uint8_t>(bad.reason));
    out.put(bad.similarity);
    wire::Reader in(out.bytes());
    DropRanges drops;
    EXPECT_FALSE(take_account(in, drops));
  }
}

TEST(RecordFormat, AFrameComesBack) {
  const auto frame = test::kept_frame(7, 100);
  auto body = frame_head("r/s", *frame);
  const std::size_t head = body.size();
  body.insert(body.end(), frame->jpeg.begin(), frame->jpeg.end());
  const auto parsed = parse_frame(body);
  ASSERT_TRUE(parsed);
  EXPECT_EQ(parsed->first, "r/s");
  EXPECT_TRUE(test::is_same(parsed->second, *frame));
  for (std::size_t size = 0; size <= head; ++size) {
    EXPECT_FALSE(parse_frame(Bytes(body).first(size))) << size;
  }
}

TEST(RecordFormat, ReleasedFramesComeBack) {
  const std::vector<Sequence> numbers = {1, 5, ~0ULL};
  const auto body = encode_released("r/s", numbers);
  EXPECT_EQ(parse_released(body), std::pair(std::string("r/s"), numbers));
  for (std::size_t size = 0; size < body.size(); ++size) {
    EXPECT_FALSE(parse_released(Bytes(body).first(size))) << size;
  }
}

TEST(RecordFormat, AnIndexComesBackAndSaysItsLength) {
  Index index;
  index["r/a"].kept = {{1, 9, 100, 50, KeptFrame::State::kWritten},
                       {2, 9, 150, 60, KeptFrame::State::kWritten}};
  index["r/b"].released = {7, 8};
  const auto body = encode(index);
  EXPECT_EQ(wire::load<std::uint32_t>(&body[body.size() - 4]), body.size() - 4);
  const auto parsed = parse_index(body, 9);
  ASSERT_TRUE(parsed);
  ASSERT_EQ(parsed->size(), 2U);
  const auto& kept = parsed->at("r/a").kept;
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_EQ(kept[1].sequence, 2U);
  EXPECT_EQ(kept[1].segment, 9U);
  EXPECT_EQ(kept[1].offset, 150U);
  EXPECT_EQ(kept[1].bytes, 60U);
  EXPECT_EQ(kept[1].state, KeptFrame::State::kWritten);
  EXPECT_EQ(parsed->at("r/b").released, (std::vector<Sequence>{7, 8}));
  for (std::size_t size = 0; size + 4 < body.size(); ++size) {
    EXPECT_FALSE(parse_index(Bytes(body).first(size), 9)) << size;
  }
}

}  // namespace
}  // namespace orbbuf::record_format
