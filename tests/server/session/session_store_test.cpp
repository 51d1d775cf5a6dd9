// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_store.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "server/session/views.hpp"
#include "testing/captured_log.hpp"
#include "tests/server/session/stepped_child.hpp"
#include "tests/server/session/stored_session.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using Late = SessionStore::Late;
using test::account;
using test::as_text;
using test::dropped;
using test::kArrivedNs;
using test::plain_frame;
using test::plain_pair;
using test::read_file;
using test::reduced_pair;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class SessionStoreTest : public test::StoredSession {};

TEST_F(SessionStoreTest, LaysFramesOutAsDsoReadsThem) {
  const auto store = open(Durability::kAck, "Pinhole 1 2 3\n");
  deliver(*store, {0, 7, 1'234'567});
  EXPECT_THAT(names(), ElementsAre("camera.txt", "images", "journal.000000", "times.txt"));
  EXPECT_THAT(names("images"), ElementsAre("000000.jpg", "000007.jpg", "1234567.jpg"));
  EXPECT_EQ(image(7), as_text(plain_frame(7).jpeg));
  EXPECT_EQ(read_file(folder_ / "times.txt"),
            "0 0.000000000 8.500000\n7 0.280000000 8.500000\n1234567 49382.680000000 8.500000\n");
  EXPECT_EQ(read_file(folder_ / "camera.txt"), "Pinhole 1 2 3\n");
}

TEST_F(SessionStoreTest, SamplesAreInTheirFileAsTheyCome) {
  const SessionInfo info{"robot", "session", "", {{4, "imu0", "imu"}}};
  const auto take = [](SessionStore& store, std::uint64_t number) {
    const std::vector<Sample> one{{static_cast<std::int64_t>(10 * number), {1, 2, 3}, {4, 5, 6}}};
    EXPECT_FALSE(store.write_items({4, number, number + 1, wire::encode_samples(one)}));
  };
  const auto lines = [this](std::initializer_list<int> times) {
    std::string all(kEurocImuHeader);
    for (const int time : times) all += std::to_string(time) + ",1,2,3,4,5,6\n";
    EXPECT_EQ(read_file(folder_ / "imu0/data.csv"), all);
  };
  {
    const auto store = SessionStore::open(folder_, info, Durability::kAck);
    take(*store.value(), 0);
    lines({0});
    take(*store.value(), 1);
    lines({0, 10});
    fs::remove_all(folder_ / "imu0");
    EXPECT_FALSE(make_views(folder_, Views::kAllButTimes));  // whoever follows it keeps it
    EXPECT_FALSE(fs::exists(folder_ / "imu0"));
  }
  const auto again = SessionStore::open(folder_, info, Durability::kAck);
  take(*again.value(), 2);
  lines({0, 10, 20});
  EXPECT_FALSE(again.value()->finish(true));
  take(*again.value(), 3);
  lines({0, 10, 20, 30});
}

TEST_F(SessionStoreTest, MessagesOfATopicAreInTheirFile) {
  const SessionInfo info{"robot", "session", "", {{4, "odom", "ros2"}}};
  const auto publisher = std::make_shared<const TopicPublisher>(
      TopicPublisher{1, "/odom", "nav_msgs::msg::dds_::Odometry_", ""});
  const auto message = [&](std::int64_t time_ns, std::uint8_t byte) {
    return Sample{
        time_ns,
        {},
        {},
        std::make_shared<const TopicMessage>(TopicMessage{publisher, time_ns, {0, 1, 0, 0, byte}})};
  };
  const auto store = SessionStore::open(folder_, info, Durability::kAck);
  const std::vector<Sample> first{message(5, 0xA0), message(3, 0xA1)};
  EXPECT_FALSE(store.value()->write_items({4, 0, 2, wire::encode_samples(first)}));
  // The first two again, and one that is new.
  const std::vector<Sample> late{first[0], first[1], message(6, 0xA2)};
  EXPECT_FALSE(store.value()->write_late({4, 0, wire::encode_samples(late)}));
  EXPECT_FALSE(store.value()->finish(true));
  EXPECT_FALSE(make_views(folder_, Views::kAll));
  EXPECT_EQ(read_file(folder_ / "topics/odom.csv"),
            std::string(kMessageHeader) +
                "5,/odom,nav_msgs::msg::dds_::Odometry_,00010000a0\n"
                "3,/odom,nav_msgs::msg::dds_::Odometry_,00010000a1\n"
                "6,/odom,nav_msgs::msg::dds_::Odometry_,00010000a2\n");
}

TEST_F(SessionStoreTest, RightImagesOfStereoFramesHaveTheirOwnFolder) {
  const auto store = open();
  write(*store, plain_pair(0, 10, 20));
  write(*store, plain_pair(7, 30, 40));
  EXPECT_THAT(names("images"), ElementsAre("000000.jpg", "000007.jpg"));
  EXPECT_EQ(names("images_right"), names("images"));
  EXPECT_EQ(image(7), as_text(plain_pair(7, 30, 40).left()));
  EXPECT_EQ(read_file(folder_ / "images_right/000007.jpg"), as_text(plain_pair(7, 30, 40).right()));
  expect_whole();
}

TEST_F(SessionStoreTest, NothingIsMadeBeforeTheFirstWrite) {
  const auto store = open();
  EXPECT_EQ(store->position(), wire::Position{});
  EXPECT_FALSE(store->note({{}, 1}));
  EXPECT_FALSE(store->finish(true));
  EXPECT_FALSE(store->close());
  EXPECT_FALSE(fs::exists(folder_));
}

TEST_F(SessionStoreTest, RecordsAllThatIsKnownOfAFrame) {
  const auto store = open();
  EncodedFrame frame = plain_pair(3, 30, 40);
  frame.width_px = 640;
  frame.height_px = 480;
  frame.quality = 50;
  frame.whole_bytes = 40'123;
  frame.whole_crc = 0x0A1B2C3D;
  write(*store, frame);
  const auto frames = read().frames;
  ASSERT_EQ(frames.size(), 1U);
  RecordedFrame expected;
  expected.sequence = 3;
  expected.capture_time_ns = frame.capture_time_ns;
  expected.arrived_ns = kArrivedNs;
  expected.exposure_ns = frame.exposure_ns;
  expected.width_px = 640;
  expected.height_px = 480;
  expected.bytes = 70;
  expected.left_bytes = 30;
  expected.crc = crc32(frame.left());
  expected.crc_right = crc32(frame.right());
  expected.whole_bytes = 40'123;
  expected.whole_crc = 0x0A1B2C3D;
  expected.quality = 50;
  EXPECT_EQ(frames.front(), expected);
}

TEST_F(SessionStoreTest, GoesOnBehindWhatItHas) {
  record({3, 9});
  EXPECT_EQ(next(), 10U);
  const auto store = open();
  EXPECT_FALSE(store->write_items(dropped(0, {{10, 1, DropReason::kBusy}, {11, 2}})));
  deliver(*store, {12});
  write(*store, plain_frame(9, 50));  // a repeat
  EXPECT_EQ(open()->position(), (wire::Position{13, 2}));
  EXPECT_THAT(listed(), ElementsAre(3, 9, 12));
  EXPECT_EQ(image(9), as_text(plain_frame(9).jpeg));
}

TEST_F(SessionStoreTest, OfALongSessionTheNewestSegmentTellsThePosition) {
  {
    const auto store = open(Durability::kAck, std::string(16'000, 'c'));
    for (Sequence i = 0; i < 500; ++i) {
      EXPECT_FALSE(store->write_items({5, i, i + 1, std::vector<std::uint8_t>(4000)}));
      if (i % 10 == 0) deliver(*store, {i});
    }
  }
  ASSERT_THAT(journal::segments_in(folder_).value(), ElementsAre(0, 1));
  fs::remove(journal(0));  // it is not read
  const auto store = open();
  EXPECT_EQ(store->position()[5], 500U);
  EXPECT_EQ(store->position()[wire::kFrames], 491U);
  EXPECT_EQ(store->summary().totals.live, 50U);
  EXPECT_EQ(store->summary().info.calibration, std::string(16'000, 'c'));
}

TEST_F(SessionStoreTest, ANewCalibrationReplacesTheOld) {
  deliver(*open(Durability::kAck, "old"), {0});
  deliver(*open(), {1});
  EXPECT_EQ(read_file(folder_ / "camera.txt"), "old");
  deliver(*open(Durability::kAck, "new"), {2});
  EXPECT_EQ(read_file(folder_ / "camera.txt"), "new");
  EXPECT_EQ(open()->summary().info.calibration, "new");
}

TEST_F(SessionStoreTest, SaysOnceThatTheFramesHaveAnotherSizeThanTheCalibration) {
  const test::CapturedLog log;
  for (const char* size : {"640 480", "752 480"}) {
    const auto store =
        open(Durability::kAck, fmt::format("Pinhole 9 9 5 5 0\n{0}\ncrop\n{0}\n", size));
    for (int i = 0; i < 2; ++i) {
      EncodedFrame frame = plain_frame(store->position()[wire::kFrames]);
      frame.width_px = 640;
      frame.height_px = 480;
      EXPECT_FALSE(store->write(frame, kArrivedNs));
    }
  }
  EXPECT_THAT(log.lines("the calibration is of images of "),
              ElementsAre("warning " + folder_.string() +
                          ": the calibration is of images of 752x480 pixels, and the frames have "
                          "640x480"));
}

TEST_F(SessionStoreTest, KeepsTheLastReportWhenTheServerDies) {
  const RecordedReport first{{1, 0, 0, 0, 0, 0, 0}, 5};
  const RecordedReport last{{500, 0, 0, 3, 440, 0, 0}, 3'600'000'000'000};
  {
    const auto store = open();
    EXPECT_FALSE(store->note(first));  // before there is a folder
    deliver(*store, {0});
  }
  EXPECT_EQ(open()->summary().closing, (SessionClosing{false, first.stats, 5}));
  EXPECT_FALSE(open()->note(last));
  EXPECT_EQ(open()->summary().closing, (SessionClosing{false, last.stats, last.clock_offset_ns}));
}

TEST_F(SessionStoreTest, IsOpenUntilItIsFinishedAndFromTheNextFrameOn) {
  {
    const auto store = open();
    deliver(*store, {0});
    EXPECT_FALSE(store->finish(true));
    EXPECT_TRUE(store->summary().is_closed);
  }
  EXPECT_TRUE(open()->summary().has_ended());
  const auto store = open();
  deliver(*store, {1});
  EXPECT_FALSE(store->summary().has_ended());
  EXPECT_FALSE(store->summary().is_closed);
  EXPECT_THAT(listed(), ElementsAre(0, 1));
}

TEST_F(SessionStoreTest, EachRecordTellsWhatIsOnTheDevice) {
  const auto store = open();
  deliver(*store, {0});
  const auto place = store->written();
  deliver(*store, {1});
  store->set_kept(place);
  deliver(*store, {2});
  std::vector<journal::Place> kept;
  RecordReader reader(folder_);
  while (const auto entry = reader.next().value()) kept.push_back(entry->record.kept);
  EXPECT_THAT(kept, ElementsAre(journal::Place{}, journal::Place{}, journal::Place{}, place));
}

TEST_F(SessionStoreTest, NothingThatIsNotWrittenCountsAsKept) {
  const auto store = open();
  deliver(*store, {0});
  const auto place = store->written();
  store->set_kept({7, 1000});  // of a folder that was removed since
  deliver(*store, {1});
  RecordReader reader(folder_, place);
  EXPECT_EQ(reader.next().value()->record.kept, place);
}

TEST_F(SessionStoreTest, OnAFullDiskNothingOfAFrameRemains) {
  const auto store = open();
  write(*store, plain_pair(0, 10, 10));
  const auto bytes = fs::file_size(journal());
  for (const auto& [limit, frame] : {std::pair<rlim_t, EncodedFrame>{1000, plain_pair(1, 5000, 10)},
                                     {1000, plain_pair(1, 10, 5000)},
                                     {bytes + 20, plain_pair(1, 10, 10)}}) {
    {
      const test::ResourceLimit full(RLIMIT_FSIZE, limit);
      const auto error = store->write(frame, kArrivedNs);
      ASSERT_TRUE(error);
      EXPECT_THAT(error->text, HasSubstr("File too large"));
    }
    EXPECT_THAT(names("images"), ElementsAre("000000.jpg"));
    EXPECT_THAT(names("images_right"), ElementsAre("000000.jpg"));
    EXPECT_EQ(fs::file_size(journal()), bytes);
    EXPECT_THAT(names(), testing::Not(testing::Contains(HasSubstr("incoming"))));
  }
  write(*store, plain_pair(1, 10, 10));
  EXPECT_EQ(next(), 2U);
}

TEST_F(SessionStoreTest, AFrameWhoseLineDoesNotFitIsAcceptedAndListedLater) {
  const test::CapturedLog log;
  record({0});
  fs::remove(folder_ / "times.txt");
  fs::create_directory(folder_ / "times.txt");
  const auto store = open();
  deliver(*store, {1, 2});
  EXPECT_THAT(log.lines("times.txt is not complete for now"), testing::SizeIs(1));
  fs::remove(folder_ / "times.txt");
  deliver(*store, {3});
  EXPECT_THAT(listed(), ElementsAre(0, 1, 2, 3));
}

TEST_F(SessionStoreTest, AFolderThatWasRemovedComesBackWithTheNextTry) {
  const auto store = open(Durability::kAck, "camera");
  deliver(*store, {0});
  fs::remove_all(folder_);
  EXPECT_TRUE(store->write(plain_frame(1), kArrivedNs));
  deliver(*store, {1});
  EXPECT_THAT(numbers(), ElementsAre(1));
  EXPECT_THAT(listed(), ElementsAre(1));
  EXPECT_EQ(read_file(folder_ / "camera.txt"), "camera");
  EXPECT_EQ(store->summary().totals.live, 1U);
  fs::remove_all(folder_);
  EXPECT_FALSE(store->write_items(dropped(0, {{2, 1}})));
  EXPECT_EQ(open()->position(), (wire::Position{2, 1}));
}

TEST_F(SessionStoreTest, AFileInPlaceOfTheFolderIsAnError) {
  fs::create_directories(folder_.parent_path());
  test::write_file(folder_, "a file where the folder should be");
  const auto store = SessionStore::open(folder_, {"robot", "session", ""}, Durability::kAck);
  if (store) {
    EXPECT_TRUE(store.value()->write(plain_frame(0), kArrivedNs));
  }
}

TEST_F(SessionStoreTest, LateFramesStandWithTheOthersAndAreListedInTheEnd) {
  const auto store = open();
  deliver(*store, {0, 1, 5});
  EXPECT_EQ(late(*store, plain_frame(4)), Late::kNew);
  EXPECT_EQ(late(*store, plain_pair(2, 30, 40)), Late::kNew);
  EXPECT_EQ(image(4), as_text(plain_frame(4).jpeg));
  EXPECT_EQ(read_file(folder_ / "images_right/000002.jpg"), as_text(plain_pair(2, 30, 40).right()));
  EXPECT_THAT(listed(), ElementsAre(0, 1, 5));
  EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 4, 5));
  EXPECT_EQ(store->position()[wire::kFrames], 6U);
  deliver(*store, {6});
  EXPECT_FALSE(store->finish(true));
  EXPECT_THAT(listed(), ElementsAre(0, 1, 2, 4, 5, 6));
  EXPECT_EQ(open()->summary().totals.late, 2U);
  expect_whole();
}

/// In each order of three frames that came live, live and late.
TEST_F(SessionStoreTest, LateFramesComeInAnyOrder) {
  std::vector<Sequence> order = {1, 2, 4, 7};
  do {
    fs::remove_all(folder_);
    const auto store = open();
    deliver(*store, {0, 3});
    for (std::size_t i = 0; i < order.size(); ++i) {
      EXPECT_EQ(late(*store, plain_frame(order[i])), Late::kNew);
      if (i == 1) deliver(*store, {5, 6, 8});
    }
    EXPECT_FALSE(store->close());
    EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8));
    EXPECT_EQ(listed(), numbers());
    EXPECT_EQ(next(), 9U);
  } while (std::ranges::next_permutation(order).found);
}

TEST_F(SessionStoreTest, AFrameIsTakenOnce) {
  {
    const auto store = open();
    deliver(*store, {0, 1});
    write(*store, plain_pair(2, 10, 20));
    EXPECT_EQ(late(*store, plain_frame(1)), Late::kRepeat);
    EXPECT_EQ(late(*store, plain_pair(2, 10, 20)), Late::kRepeat);
    EXPECT_EQ(late(*store, plain_frame(5)), Late::kNew);
    EXPECT_EQ(late(*store, plain_frame(5)), Late::kRepeat);
    deliver(*store, {3});
    EXPECT_EQ(late(*store, plain_frame(3)), Late::kRepeat);
  }
  const auto store = open();
  EXPECT_EQ(late(*store, plain_frame(5)), Late::kRepeat);
  EXPECT_EQ(late(*store, plain_frame(0)), Late::kRepeat);
  EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 3, 5));
}

TEST_F(SessionStoreTest, AFrameThatCameLateIsNotOverwrittenByTheLiveStream) {
  const auto store = open();
  deliver(*store, {0});
  EXPECT_EQ(late(*store, plain_frame(4)), Late::kNew);
  write(*store, plain_frame(4));
  write(*open(), plain_frame(4, 50));
  EXPECT_EQ(image(4), as_text(plain_frame(4).jpeg));
  EXPECT_THAT(numbers(), ElementsAre(0, 4));
  EXPECT_THAT(names("orphans/images"), testing::SizeIs(1));
  deliver(*store, {5});
  EXPECT_EQ(next(), 6U);
}

/// A4 of issue 36: whoever can send late frames must not be able to change what was acknowledged.
TEST_F(SessionStoreTest, ALateFrameWithOtherBytesIsSetAside) {
  const test::CapturedLog log;
  {
    const auto store = open();
    deliver(*store, {0, 1});
    EXPECT_EQ(late(*store, plain_frame(1, 50)), Late::kConflict);
    EXPECT_FALSE(store->finish(true));
  }
  const auto store = open();  // of a finished session
  for (int i = 0; i < 2; ++i) EXPECT_EQ(late(*store, plain_frame(0, 60)), Late::kConflict);
  EXPECT_EQ(image(0), as_text(plain_frame(0).jpeg));
  EXPECT_EQ(image(1), as_text(plain_frame(1).jpeg));
  EXPECT_EQ(read_file(folder_ /
                      fmt::format("orphans/images/000000.{:08X}.jpg", plain_frame(0, 60).jpeg_crc)),
            as_text(plain_frame(0, 60).jpeg));
  EXPECT_THAT(names("orphans/images"), testing::SizeIs(2));
  EXPECT_THAT(log.lines("came again with other bytes"), testing::SizeIs(2));
  expect_whole();
}

TEST_F(SessionStoreTest, TheWholeJpegReplacesAFrameThatCameReduced) {
  const auto [reduced, whole] = reduced_pair(3);
  {
    const auto store = open();
    write(*store, reduced);
    deliver(*store, {4});
    EXPECT_EQ(late(*store, whole), Late::kReplaced);
    EXPECT_EQ(late(*store, whole), Late::kRepeat);
    EXPECT_EQ(late(*store, reduced), Late::kConflict);
  }
  EXPECT_EQ(image(3), as_text(whole.jpeg));
  const auto session = read();
  ASSERT_EQ(session.frames.size(), 2U);
  EXPECT_TRUE(session.frames[0].is_replacing);
  EXPECT_EQ(session.frames[0].quality, 80);
  EXPECT_EQ(session.frames[0].whole_bytes, 0U);
  const SessionTotals& totals = session.summary.totals;
  EXPECT_EQ(totals, (SessionTotals{2, 0, 1, 0, 200 + 100}));
  EXPECT_EQ(late(*open(), whole), Late::kRepeat);
  expect_whole();
}

TEST_F(SessionStoreTest, NothingButTheVeryJpegReplacesAReducedFrame) {
  const auto [reduced, whole] = reduced_pair(3);
  const auto store = open();
  write(*store, reduced);
  EncodedFrame other = whole;
  other.jpeg.back() ^= 1;
  EXPECT_EQ(late(*store, other), Late::kConflict);  // though its own checksum field is the old one
  EXPECT_EQ(late(*store, plain_frame(3, 100)), Late::kConflict);
  EXPECT_EQ(image(3), as_text(reduced.jpeg));
  EXPECT_EQ(late(*store, whole), Late::kReplaced);
}

TEST_F(SessionStoreTest, AFrameThatDiffersInMoreThanItsJpegReplacesNone) {
  const auto [reduced, whole] = reduced_pair(3);
  const auto store = open();
  write(*store, reduced);
  const std::vector<void (*)(EncodedFrame&)> changes = {
      [](EncodedFrame& frame) { ++frame.capture_time_ns; },
      [](EncodedFrame& frame) { ++frame.exposure_ns; },
      [](EncodedFrame& frame) { ++frame.width_px; },
      [](EncodedFrame& frame) { ++frame.height_px; },
      [](EncodedFrame& frame) { frame.left_bytes = 100; },
      [](EncodedFrame& frame) { frame.whole_bytes = 300; }};
  for (const auto& change : changes) {
    EncodedFrame other = whole;
    change(other);
    EXPECT_EQ(late(*store, other), Late::kConflict);
  }
  EXPECT_EQ(image(3), as_text(reduced.jpeg));
  EXPECT_FALSE(fs::exists(folder_ / "images_right"));
  EXPECT_THAT(names("orphans/images"), testing::SizeIs(1));  // the same bytes each time
  EXPECT_EQ(late(*store, whole), Late::kReplaced);
}

TEST_F(SessionStoreTest, OnAFullDiskALateFrameLeavesNothing) {
  const auto [reduced, whole] = reduced_pair(0);
  const auto store = open();
  write(*store, reduced);
  deliver(*store, {5});
  const auto bytes = fs::file_size(journal());
  for (const auto limit : {rlim_t{150}, rlim_t{bytes + 20}}) {
    const test::ResourceLimit full(RLIMIT_FSIZE, limit);
    EXPECT_FALSE(store->write_late(plain_frame(3, 200), kArrivedNs));
    EXPECT_FALSE(store->write_late(whole, kArrivedNs));
    EXPECT_THAT(names("images"), ElementsAre("000000.jpg", "000005.jpg"));
  }
  EXPECT_EQ(fs::file_size(journal()), bytes);
  expect_whole();  // also where the image came to be replaced and the record did not
  EXPECT_EQ(late(*store, plain_frame(3, 200)), Late::kNew);
  EXPECT_EQ(late(*store, whole), Late::kReplaced);
  expect_whole();
}

/// A1 of issue 36: the robot died before its first contact.
TEST_F(SessionStoreTest, ASessionMayConsistOfLateFramesOnly) {
  {
    const auto store = open();
    for (const Sequence i : {4U, 2U, 9U}) EXPECT_EQ(late(*store, plain_frame(i)), Late::kNew);
    EXPECT_FALSE(store->take_account(account(12)));
    EXPECT_FALSE(store->close());
  }
  const auto store = open();
  EXPECT_EQ(store->position(), wire::Position{});
  EXPECT_FALSE(store->summary().has_ended());
  EXPECT_EQ(store->summary().captured(), 12U);
  EXPECT_THAT(listed(), ElementsAre(2, 4, 9));
  std::vector<Sequence> unknown;
  for (const DropRecord& drop : read().drops) {
    EXPECT_EQ(drop.reason, DropReason::kUnknown);
    for (Sequence i = drop.sequence; i < drop.end(); ++i) unknown.push_back(i);
  }
  EXPECT_THAT(unknown, ElementsAre(0, 1, 3, 5, 6, 7, 8, 10, 11));
}

TEST_F(SessionStoreTest, AnAccountIsRecordedWhenItSaysSomethingNew) {
  const auto store = open();
  deliver(*store, {0});
  const auto records = [&] {
    std::size_t count = 0;
    RecordReader reader(folder_);
    while (const auto entry = reader.next().value()) {
      count += std::holds_alternative<wire::Account>(entry->record.body) ? 1 : 0;
    }
    return count;
  };
  EXPECT_FALSE(store->take_account(account(5, 2, 1, false)));
  EXPECT_FALSE(store->take_account(account(6, 3, 1, false)));  // it only counts on
  EXPECT_EQ(records(), 1U);
  EXPECT_FALSE(store->take_account(account(7, 0, 0, false)));
  EXPECT_FALSE(store->take_account(account(7)));
  EXPECT_EQ(records(), 3U);
  EXPECT_FALSE(store->take_account(account(7)));  // repeated
  EXPECT_EQ(records(), 3U);
  wire::Account named = account(7);
  named.given_up = {{3, 1, DropReason::kPolicy}};
  EXPECT_FALSE(store->take_account(named));
  EXPECT_EQ(records(), 4U);
  EXPECT_EQ(open()->summary().account, account(7));
}

TEST_F(SessionStoreTest, TheViewsWaitWhileTheRobotHoldsFrames) {
  const auto store = open();
  deliver(*store, {0, 3});
  EXPECT_FALSE(store->take_account(account(4, 2, 1)));
  EXPECT_FALSE(store->finish(true));
  EXPECT_EQ(late(*store, plain_frame(2)), Late::kNew);
  EXPECT_FALSE(store->close());
  EXPECT_THAT(listed(), ElementsAre(0, 3));
  EXPECT_EQ(late(*store, plain_frame(1)), Late::kNew);
  EXPECT_FALSE(store->take_account(account(4)));
  EXPECT_FALSE(store->close());
  EXPECT_THAT(listed(), ElementsAre(0, 1, 2, 3));
  EXPECT_TRUE(store->summary().has_ended());
  const auto journal_bytes = fs::file_size(journal());
  EXPECT_FALSE(store->close());  // nothing was written since
  EXPECT_FALSE(open()->close());
  EXPECT_EQ(fs::file_size(journal()), journal_bytes);
}

TEST_F(SessionStoreTest, ViewsThatAnEndHasNotMadeAreMadeLater) {
  {
    const auto store = open();
    deliver(*store, {0, 1});
    EXPECT_EQ(late(*store, plain_frame(4)), Late::kNew);
    EXPECT_FALSE(store->finish(true));
    deliver(*store, {2});
    const fs::path in_the_way = folder_ / "times.txt.tmp";
    fs::create_directory(in_the_way);
    EXPECT_FALSE(store->finish(true));
    EXPECT_FALSE(fs::exists(folder_ / "session.txt"));  // it would say that all views are made
    fs::remove(in_the_way);
  }
  const auto store = open();
  EXPECT_FALSE(store->close());
  EXPECT_THAT(listed(), ElementsAre(0, 1, 2, 4));
  EXPECT_TRUE(fs::exists(folder_ / "session.txt"));
  EXPECT_TRUE(store->summary().has_ended());
  fs::remove(folder_ / "times.txt");
  fs::create_directory(folder_ / "times.txt");
  EXPECT_FALSE(store->finish(true));
  EXPECT_FALSE(fs::exists(folder_ / "session.txt"));
  fs::remove(folder_ / "times.txt");
  EXPECT_FALSE(store->close());
  EXPECT_THAT(listed(), ElementsAre(0, 1, 2, 4));
}

TEST_F(SessionStoreTest, AFolderThatWasMovedIsLeftAlone) {
  const auto store = open();
  deliver(*store, {0});
  const auto moved = parent_ / "robot" / "moved";
  fs::rename(folder_, moved);
  const auto bytes = fs::file_size(journal::segment_path(moved, 0));
  EXPECT_FALSE(store->note({{}, 1}));
  EXPECT_EQ(fs::file_size(journal::segment_path(moved, 0)), bytes);
  deliver(*store, {1});
  EXPECT_THAT(numbers(), ElementsAre(1));
}

TEST_F(SessionStoreTest, APartLeavesAFinishedSessionFinished) {
  {
    const auto store = open();
    deliver(*store, {0});
    EXPECT_FALSE(store->finish(true));
    EXPECT_FALSE(store->note_part({1, {}, store->written()}));
    const auto bytes = fs::file_size(journal());
    EXPECT_FALSE(store->close());
    EXPECT_EQ(fs::file_size(journal()), bytes);
  }
  const auto bytes = fs::file_size(journal());
  EXPECT_FALSE(open()->close());
  EXPECT_EQ(fs::file_size(journal()), bytes);
}

TEST_F(SessionStoreTest, AFrameThatOnlyAPartHasIsARepeat) {
  const auto store = open();
  deliver(*store, {0});
  EXPECT_EQ(late(*store, plain_frame(5)), Late::kNew);
  EXPECT_FALSE(store->note_part({1, {}, store->written(), true}));
  EXPECT_EQ(late(*store, plain_frame(0, 50)), Late::kConflict);  // its image is not removed yet
  for (const Sequence i : {0U, 5U}) fs::remove(folder_ / session_image(i));
  EXPECT_EQ(late(*store, plain_frame(0)), Late::kRepeat);
  EXPECT_EQ(late(*store, plain_frame(5)), Late::kRepeat);
  write(*store, plain_frame(5));
  EXPECT_THAT(names("orphans/images"), testing::SizeIs(1));
}

TEST_F(SessionStoreTest, APartOfTheRecordingIsNoted) {
  const auto store = open();
  deliver(*store, {0});
  const RecordedPart part{3, {0, 100}, {1, 200}};
  EXPECT_FALSE(store->note_part(part));
  EXPECT_EQ(open()->summary().part, part);
}

TEST_F(SessionStoreTest, AFrameCostsAtMostSixSystemCalls) {
  const auto calls_of = [&](Sequence frames) {
    std::size_t calls = 0;
    test::step_child(
        [&] {
          folder_ = parent_ / "robot" / std::to_string(frames);
          const auto store = open();
          for (Sequence i = 0; i < frames; ++i) {
            if (store->write(plain_frame(i, 30'000), kArrivedNs)) return false;
          }
          return true;
        },
        [&](std::size_t call) {
          calls = call;
          return false;
        });
    return calls;
  };
  constexpr Sequence kFrames = 100;
  EXPECT_EQ((calls_of(10 + kFrames) - calls_of(10)) / kFrames, 6U);
}

}  // namespace
}  // namespace orbbuf
