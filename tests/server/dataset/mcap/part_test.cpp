// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/part.hpp"

#include <gmock/gmock.h>

#include "testing/captured_log.hpp"
#include "tests/server/dataset/mcap/contents.hpp"
#include "tests/server/dataset/recording.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

class McapPart : public test::Recording {
 protected:
  /// The part from where the last one ends up to now; how many steps it took.
  int make(SessionStore& store, RecordedPart* made = nullptr) {
    const auto& last = store.summary().part;
    mcap::PartMaker maker(
        session_, store.summary(),
        {last ? last->number + 1 : 1, last ? last->to : journal::Place{}, store.written()});
    int steps = 1;
    for (auto is_over = maker.go_on(); is_over && !is_over.value(); is_over = maker.go_on()) {
      ++steps;
    }
    if (made != nullptr) *made = maker.part();
    EXPECT_FALSE(store.note_part(maker.part()));
    return steps;
  }
  static EncodedFrame reduced_from(const EncodedFrame& whole) {
    EncodedFrame reduced = *frame(whole.sequence);
    reduced.quality = 30;
    reduced.whole_bytes = static_cast<std::uint32_t>(whole.jpeg.size());
    reduced.whole_crc = crc32(whole.jpeg);
    return reduced;
  }
  test::McapContents part(const char* name) const { return test::read_mcap(session_ / name); }
};

TEST_F(McapPart, HasWhatCameSinceTheOneBefore) {
  const auto store = begin();
  make(*store);
  for (const Sequence sequence : {10U, 12U}) ASSERT_FALSE(store->write(*frame(sequence), 0));
  test::write_drops(*store, {{11, 0, DropReason::kPolicy}});
  make(*store);
  const auto first = part("s-0001.mcap");
  EXPECT_THAT(first.of("/r/image"), ElementsAre(0, 1, 2, 5, 6, 8, 9));
  EXPECT_THAT(first.of("/r/drops"), ElementsAre(4, 3, 7));
  const auto second = part("s-0002.mcap");
  EXPECT_THAT(second.of("/r/image"), ElementsAre(10, 12));
  EXPECT_THAT(second.of("/r/drops"), ElementsAre(11));
  EXPECT_EQ(fs::exists(session_ / "s-0002.mcap.tmp"), false);
}

TEST_F(McapPart, LateFramesStandBehindTheOthersByTheirNumbers) {
  const auto store = begin();
  for (const Sequence sequence : {7U, 3U}) ASSERT_TRUE(store->write_late(*frame(sequence), 0));
  ASSERT_FALSE(store->write(*frame(10), 0));
  make(*store);
  EXPECT_THAT(part("s-0001.mcap").of("/r/image"), ElementsAre(0, 1, 2, 5, 6, 8, 9, 10, 3, 7));
}

TEST_F(McapPart, HasTheSamplesOfEachSensorByTheirNames) {
  const auto store = test::open_store(session_, {"r", "s", "", {{4, "imu0", "imu"}}});
  ASSERT_FALSE(store->write(*frame(0), 0));
  const std::vector<Sample> samples{{1'000'000'002, {1, 2, 0.5}, {0, 0, 9.81}}, {2, {}, {}}};
  ASSERT_FALSE(store->write_items({4, 7, 9, wire::encode_samples(samples)}));
  make(*store);
  const auto found = part("s-0001.mcap");
  ASSERT_THAT(found.of("/r/imu0"), ElementsAre(7, 8));
  EXPECT_EQ(found.data_of("/r/imu0")[0], R"({"timestamp":{"sec":1,"nsec":2},"frame_id":"r/imu0",)"
                                         R"("angular_velocity":{"x":1,"y":2,"z":0.5},)"
                                         R"("linear_acceleration":{"x":0,"y":0,"z":9.81}})");
  EXPECT_FALSE(mcap::lacks_part(session_));
  ASSERT_FALSE(store->write_items({4, 9, 11, wire::encode_samples(samples)}));
  EXPECT_TRUE(mcap::lacks_part(session_));
}

TEST_F(McapPart, TakesTheWholeJpegIfItIsThere) {
  const auto store = open();
  const auto whole = test::jpeg_frame_ptr(0, 128, 128);
  ASSERT_FALSE(store->write(reduced_from(*whole), 0));
  ASSERT_EQ(store->write_late(*whole, 0).value(), SessionStore::Late::kReplaced);
  make(*store);
  const auto found = part("s-0001.mcap");
  ASSERT_THAT(found.of("/r/image"), ElementsAre(0));
  EXPECT_THAT(found.data_of("/r/image")[0], testing::HasSubstr(test::as_text(whole->jpeg)));
}

TEST_F(McapPart, AWholeJpegThatCameAfterThePartIsInTheNext) {
  const auto store = open();
  const auto whole = test::jpeg_frame_ptr(0, 128, 128);
  ASSERT_FALSE(store->write(reduced_from(*whole), 0));
  RecordedPart first;
  make(*store, &first);
  ASSERT_EQ(store->write_late(*whole, 0).value(), SessionStore::Late::kReplaced);
  ASSERT_FALSE(mcap::remove_images(session_, first));
  RecordedPart second;
  make(*store, &second);
  const auto found = part("s-0002.mcap");
  ASSERT_THAT(found.of("/r/image"), ElementsAre(0));
  EXPECT_THAT(found.data_of("/r/image")[0], testing::HasSubstr(test::as_text(whole->jpeg)));
  ASSERT_FALSE(mcap::remove_images(session_, second));
  EXPECT_FALSE(fs::exists(session_ / "images/000000.jpg"));
}

TEST_F(McapPart, NamesAtMostSoManyDroppedFrames) {
  const auto store = open();
  ASSERT_FALSE(store->write(*frame(0), 0));
  test::write_drops(*store, {{1, 0, DropReason::kBusy, 0, Sequence{1} << 31, 90},
                             {Sequence{1} << 40, 0, DropReason::kBusy}});
  const test::CapturedLog log;
  make(*store);
  const auto drops = part("s-0001.mcap").of("/r/drops");
  ASSERT_EQ(drops.size(), mcap::PartMaker::kMostDrops);
  EXPECT_EQ(drops.back(), mcap::PartMaker::kMostDrops);
  EXPECT_EQ(log.lines("has the first 100000 dropped frames only").size(), 1U);
}

TEST_F(McapPart, AnImageThatCannotBeReadIsAnError) {
  const auto store = begin();
  fs::remove(session_ / "images/000005.jpg");
  fs::create_directory(session_ / "images/000005.jpg");
  mcap::PartMaker maker(session_, store->summary(), {1, {}, store->written()});
  const auto is_over = maker.go_on();
  ASSERT_FALSE(is_over);
  EXPECT_THAT(is_over.error().text, testing::HasSubstr("000005.jpg"));
}

TEST_F(McapPart, IsMadeAMegabyteAtATime) {
  const auto store = open();
  for (Sequence i = 0; i < 30; ++i) {
    ASSERT_FALSE(store->write(test::plain_frame(i, 100'000), 0));
  }
  EXPECT_EQ(make(*store), 3);
  EXPECT_EQ(part("s-0001.mcap").of("/r/image").size(), 30U);
}

TEST_F(McapPart, OneThatWasInterruptedIsMadeAgain) {
  const auto store = open();
  for (Sequence i = 0; i < 30; ++i) {
    ASSERT_FALSE(store->write(test::plain_frame(i, 100'000), 0));
  }
  {
    mcap::PartMaker maker(session_, store->summary(), {1, {}, store->written()});
    EXPECT_FALSE(maker.go_on().value());
    EXPECT_TRUE(fs::exists(session_ / "s-0001.mcap.tmp"));
  }
  EXPECT_FALSE(fs::exists(session_ / "s-0001.mcap.tmp"));
  EXPECT_FALSE(fs::exists(session_ / "s-0001.mcap"));
  test::write_file(session_ / "s-0001.mcap.tmp", "what a kill has left");
  make(*store);
  EXPECT_EQ(part("s-0001.mcap").of("/r/image").size(), 30U);
}

TEST_F(McapPart, WithoutFramesAndDropsThereIsNone) {
  const auto store = begin();
  make(*store);
  ASSERT_FALSE(store->finish(true));
  mcap::PartMaker maker(session_, store->summary(),
                        {2, store->summary().part->to, store->written()});
  EXPECT_TRUE(maker.go_on().value());
  EXPECT_TRUE(maker.is_empty());
  EXPECT_FALSE(fs::exists(session_ / "s-0002.mcap"));
}

TEST_F(McapPart, AnImageThatIsGoneIsPassedOverWithAWarning) {
  const auto store = begin();
  fs::remove(session_ / "images/000005.jpg");
  fs::remove(session_ / "images/000006.jpg");
  const test::CapturedLog log;
  make(*store);
  EXPECT_EQ(log.lines("frame 5 is passed over").size(), 1U);
  EXPECT_EQ(log.lines("2 frames are passed over").size(), 1U);
  EXPECT_THAT(part("s-0001.mcap").of("/r/image"), ElementsAre(0, 1, 2, 8, 9));
}

TEST_F(McapPart, SaysByHowMuchTheRobotsClockWasSet) {
  const auto store = begin();
  ASSERT_FALSE(store->note({{}, 5}));
  make(*store);
  EXPECT_EQ(part("s-0001.mcap").records.at(0x0C), 1);
}

TEST_F(McapPart, ImagesOfAPartCanGoAndThoseOfTheNextStay) {
  const auto store = begin(true);
  RecordedPart part;
  make(*store, &part);
  std::uint64_t bytes = 0;
  for (const char* side : {"images", "images_right"}) {
    for (const auto& image : fs::directory_iterator(session_ / side)) bytes += image.file_size();
  }
  EXPECT_EQ(part.image_bytes, bytes);
  ASSERT_FALSE(store->write(*frame(10, true), 0));
  EXPECT_FALSE(mcap::remove_images(session_, part));
  EXPECT_FALSE(mcap::remove_images(session_, part));
  std::vector<std::string> left;
  for (const char* side : {"images", "images_right"}) {
    for (const auto& image : fs::directory_iterator(session_ / side)) {
      left.push_back(image.path().filename().string());
    }
  }
  EXPECT_THAT(left, ElementsAre("000010.jpg", "000010.jpg"));
  EXPECT_FALSE(mcap::numbers_without_images(session_).value().contains(9));
  part.is_only_copy = true;
  ASSERT_FALSE(store->note_part(part));
  const auto without = mcap::numbers_without_images(session_);
  ASSERT_TRUE(without);
  EXPECT_TRUE(without.value().contains(9));
  EXPECT_FALSE(without.value().contains(10));
}

// A session whose images are removed is met again as it was.
TEST_F(McapPart, WhatOnlyAPartHasIsNotAskedForAgain) {
  {
    const auto store = begin();
    RecordedPart part;
    make(*store, &part);
    part.is_only_copy = true;
    ASSERT_FALSE(store->note_part(part));
    ASSERT_FALSE(mcap::remove_images(session_, part));
  }
  const auto again = open();
  EXPECT_EQ(again->position()[wire::kFrames], 10U);
  EXPECT_EQ(again->summary().totals.image_bytes, 0U);
}

}  // namespace
}  // namespace orbbuf
