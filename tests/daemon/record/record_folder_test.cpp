// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_folder.hpp"

#include <gmock/gmock.h>

#include <limits>

#include "common/as_bytes.hpp"
#include "testing/captured_log.hpp"
#include "tests/daemon/record/record_fixture.hpp"

namespace orbbuf::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr Sequence kAll = std::numeric_limits<Sequence>::max();

/// Writes a journal by hand, as Record does.
class RecordFolderTest : public RecordTest {
 protected:
  RecordFolderTest() { std::filesystem::create_directories(path()); }

  void account(Sequence captured) {
    wire::Writer out(0);
    record_format::put(out, {"robot/one", false, false, captured}, {});
    ASSERT_TRUE(writer_.append(record_format::kAccount, {out.bytes()}));
    captured_ = captured;
  }
  journal::Place frame(Sequence sequence, std::size_t bytes = 1000) {
    const auto frame = kept_frame(sequence, bytes);
    const auto head = record_format::frame_head("robot/one", *frame);
    const auto place = writer_.append(record_format::kFrame, {head, frame->jpeg}).value();
    index_["robot/one"].kept.push_back({sequence, place.segment,
                                        static_cast<std::uint32_t>(place.offset),
                                        static_cast<std::uint32_t>(bytes)});
    return place;
  }
  void release(Sequence sequence) {
    ASSERT_TRUE(writer_.append(record_format::kReleased,
                               {record_format::encode_released("robot/one", {sequence})}));
    index_["robot/one"].released.push_back(sequence);
  }
  void end_segment(bool has_index = true) {
    if (has_index) {
      ASSERT_TRUE(writer_.append(record_format::kIndex, {record_format::encode(index_)}));
    }
    index_.clear();
    writer_.end_segment();
  }
  /// Reads it; the numbers of the frames that are held, in session "two".
  std::vector<Sequence> read() {
    state_.emplace("robot", "two");
    end_ = RecordFolder(path()).read(*state_).value();
    state_->begin();
    std::vector<Sequence> held;
    places_.clear();
    while (const auto taken = state_->take_next(kAll)) {
      held.push_back(taken->id.sequence);
      places_.push_back(taken->place);
    }
    return held;
  }
  /// By the journal.
  Sequence captured() {
    for (const auto& account : state_->take_accounts()) {
      if (account.session_id == "one") return account.captured;
    }
    return 0;
  }

  Sequence captured_ = 0;
  record_format::Index index_;
  journal::Writer writer_{path(), ~std::uint64_t{0}, false, [this] {
                            RecordState state("robot", "one");
                            state.begin();
                            state.note({captured_, 0, 0, 0});
                            return state.checkpoint();
                          }};
  std::optional<RecordState> state_;
  RecordFolder::End end_;
  std::vector<KeptFrame> places_;
};

TEST_F(RecordFolderTest, NothingHasNoFrames) {
  EXPECT_THAT(read(), IsEmpty());
  EXPECT_EQ(end_.place, journal::Place());
  EXPECT_EQ(end_.checkpoint_bytes, 0U);
}

TEST_F(RecordFolderTest, AFolderThatCannotBeReadIsAnErrorAndNotAnEmptyOne) {
  write_file(folder_ / "file", "a file");
  RecordState state("robot", "two");
  EXPECT_FALSE(RecordFolder(folder_ / "file").read(state));
}

TEST_F(RecordFolderTest, ReadsTheNewestSegmentAndTheIndexesOfTheOthers) {
  account(5);
  frame(1);
  frame(2);
  end_segment();
  frame(3);
  release(1);
  end_segment();
  account(9);
  frame(4);
  release(3);
  EXPECT_THAT(read(), ElementsAre(2, 4));
  EXPECT_EQ(captured(), 9U);
  EXPECT_EQ(end_.place, writer_.end());
  EXPECT_GT(end_.checkpoint_bytes, 0U);
  EXPECT_EQ(end_.index.at("robot/one").kept.size(), 1U);
  EXPECT_THAT(end_.index.at("robot/one").released, ElementsAre(3));
  EXPECT_TRUE(is_same(*RecordFolder(path()).read_frame(places_[0]).value(), *kept_frame(2)));
}

/// What lies between the checkpoint and the index of a complete segment is not read.
TEST_F(RecordFolderTest, OfACompleteSegmentOnlyTheIndexIsRead) {
  account(5);
  const auto place = frame(1, 2 << 20);
  end_segment();
  frame(2);
  auto content = read_file(segment(0));
  std::fill(content.begin() + static_cast<std::ptrdiff_t>(place.offset),
            content.begin() + static_cast<std::ptrdiff_t>(place.offset) + (1 << 20), 'x');
  write_file(segment(0), content);
  EXPECT_THAT(read(), ElementsAre(1, 2));
  EXPECT_EQ(RecordFolder(path()).read_frame(places_[0]).value(), nullptr) << "it is damaged";
}

TEST_F(RecordFolderTest, ASegmentWithoutAnIndexIsReadWhole) {
  account(5);
  frame(1);
  frame(2);
  release(1);
  end_segment(false);
  frame(3);
  EXPECT_THAT(read(), ElementsAre(2, 3));
}

TEST_F(RecordFolderTest, ABadByteInAnIndexCostsNothing) {
  account(5);
  frame(1);
  end_segment();
  frame(2);
  const auto good = read_file(segment(0));
  for (std::size_t i = 1; i < 80; ++i) {
    auto content = good;
    content[good.size() - i] = static_cast<char>(content[good.size() - i] ^ 0x55);
    write_file(segment(0), content);
    EXPECT_THAT(read(), ElementsAre(1, 2)) << i;
  }
}

TEST_F(RecordFolderTest, WithABadCheckpointTheOneBeforeCounts) {
  account(5);
  frame(1);
  end_segment();
  account(9);
  frame(2);
  auto content = read_file(segment(1));
  content[20] = static_cast<char>(content[20] ^ 1);
  write_file(segment(1), content);
  const CapturedLog log;
  EXPECT_THAT(read(), ElementsAre(1, 2));
  EXPECT_EQ(captured(), 9U);
  EXPECT_EQ(end_.place, writer_.end());
  EXPECT_EQ(log.lines("are damaged").size(), 1U);
}

TEST_F(RecordFolderTest, WithoutAnyCheckpointTheRecordsCount) {
  account(5);
  frame(1);
  auto content = read_file(segment(0));
  content[20] = static_cast<char>(content[20] ^ 1);
  write_file(segment(0), content);
  EXPECT_THAT(read(), ElementsAre(1));
  EXPECT_EQ(captured(), 5U);
}

TEST_F(RecordFolderTest, ASegmentThatAPowerCutLeftEmptyIsNone) {
  account(5);
  frame(1);
  write_file(segment(1), "");
  EXPECT_THAT(read(), ElementsAre(1));
  EXPECT_EQ(end_.place, (journal::Place{1, 0}));
  EXPECT_EQ(end_.checkpoint_bytes, 0U);
  EXPECT_TRUE(end_.index.empty());
}

TEST_F(RecordFolderTest, AFrameInAnotherPlaceIsNotRead) {
  account(5);
  const auto place = frame(1);
  frame(2);
  const KeptFrame wrong{2, place.segment, static_cast<std::uint32_t>(place.offset), 1000};
  EXPECT_EQ(RecordFolder(path()).read_frame(wrong).value(), nullptr);
  EXPECT_EQ(RecordFolder(path()).read_frame({1, 7, 0, 1000}).value(), nullptr);
}

TEST_F(RecordFolderTest, AFolderIsLockedOnce) {
  RecordFolder one(folder_ / "new" / "folder");
  EXPECT_FALSE(one.lock());
  EXPECT_FALSE(one.lock());  // by itself it is again
  RecordFolder other(folder_ / "new" / "folder");
  const auto error = other.lock();
  ASSERT_TRUE(error);
  EXPECT_TRUE(error->is_taken);
  EXPECT_THAT(error->text, HasSubstr("another orbbufd uses it"));
}

TEST_F(RecordFolderTest, AFileInPlaceOfTheFolderCannotBeLocked) {
  write_file(folder_ / "file", "a file");
  const auto error = RecordFolder(folder_ / "file").lock();
  ASSERT_TRUE(error);
  EXPECT_FALSE(error->is_taken);
  EXPECT_THAT(error->text, HasSubstr((folder_ / "file").string()));
}

}  // namespace
}  // namespace orbbuf::test
