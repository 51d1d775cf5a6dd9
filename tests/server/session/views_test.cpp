// SPDX-License-Identifier: Apache-2.0
#include "server/session/views.hpp"

#include <gmock/gmock.h>

#include "common/sample.hpp"
#include "tests/server/session/stored_session.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::account;
using test::dropped;
using test::plain_frame;
using test::plain_pair;
using test::read_file;
using test::reduced_pair;
using testing::ElementsAre;
using testing::HasSubstr;

class ViewsTest : public test::StoredSession {
 protected:
  void make(Views views = Views::kAll) {
    const auto error = make_views(folder_, views);
    EXPECT_FALSE(error) << error->text;
  }
};

TEST_F(ViewsTest, EachImageHasAChecksum) {
  const auto store = open();
  auto pair = plain_pair(0, 9, 9);
  const std::string left = "123456789";  // whose CRC-32 is CBF43926 by definition
  std::ranges::copy(left, pair.jpeg.begin());
  std::fill(pair.jpeg.begin() + 9, pair.jpeg.end(), '\0');
  write(*store, pair);
  write(*store, plain_frame(7));
  make();
  EXPECT_EQ(read_file(folder_ / "checksums.sfv"),
            fmt::format("images/000000.jpg CBF43926\nimages_right/000000.jpg E60914AE\n"
                        "images/000007.jpg {:08X}\n",
                        plain_frame(7).jpeg_crc));
}

TEST_F(ViewsTest, HaveWhatIsKnownOfTheFrames) {
  const auto [reduced, whole] = reduced_pair(2);
  const auto store = open();
  deliver(*store, {0});
  write(*store, reduced);
  write(*store, reduced_pair(3, 20).reduced);
  late(*store, whole);
  EXPECT_FALSE(store->write_items(
      dropped(0, {{1, 160'000'000, DropReason::kPolicy}, {4, -1, DropReason::kBusy, 0, 2, 99}})));
  make();
  EXPECT_EQ(
      read_file(folder_ / "quality.csv"),
      fmt::format("sequence,quality,whole_bytes,whole_crc\n2,80,0,00000000\n3,20,200,{:08X}\n",
                  reduced_pair(3).whole.jpeg_crc));
  EXPECT_EQ(read_file(folder_ / "drops.csv"),
            "sequence,reason,capture_time_s\n1,policy,0.160000000\n4,busy,-0.000000001\n"
            "5,busy,0.000000099\n");
  EXPECT_EQ(listed(), numbers());
}

TEST_F(ViewsTest, HaveTheSamplesOfEachSensorAndHowManyWereLost) {
  auto opened = SessionStore::open(
      folder_, {"robot", "session", "", {{4, "imu0", "imu"}, {5, "imu_b", "imu"}}},
      Durability::kAck);
  ASSERT_TRUE(opened);
  SessionStore& store = *opened.value();
  const auto write_samples = [&](std::uint64_t first, const std::vector<Sample>& samples) {
    EXPECT_FALSE(
        store.write_items({4, first, first + samples.size(), wire::encode_samples(samples)}));
  };
  write_samples(0, {{10, {1, 2, 3}, {4, 5, 6}}, {20, {}, {}}});
  write_samples(5, {{70, {0.5, 0, 0}, {}}});
  make();
  EXPECT_EQ(read_file(folder_ / "imu0/data.csv"),
            std::string(kEurocImuHeader) + "10,1,2,3,4,5,6\n20,0,0,0,0,0,0\n70,0.5,0,0,0,0,0\n");
  EXPECT_EQ(read_file(folder_ / "imu_b/data.csv"), kEurocImuHeader);
  EXPECT_THAT(
      read_file(folder_ / "session.txt"),
      HasSubstr("imu0 delivered 3 on_robot 0 missing 3\nimu_b delivered 0 on_robot 0 lost 0\n"));
}

TEST_F(ViewsTest, HaveLateSamplesAmongTheOthersEachOnce) {
  const wire::StreamDeclaration stream{4, "imu0", "imu"};
  const auto samples = [](std::initializer_list<std::int64_t> times) {
    std::vector<Sample> all;
    for (const auto time : times) all.push_back({time, {}, {}});
    return wire::encode_samples(all);
  };
  auto opened = SessionStore::open(folder_, {"robot", "session", ""}, Durability::kAck);
  ASSERT_TRUE(opened);
  SessionStore& store = *opened.value();
  EXPECT_FALSE(store.write_late(wire::Items{4, 0, samples({1})}));
  EXPECT_EQ(store.summary().totals.late_items, 0U) << "of a stream that nobody named";
  wire::Account account;
  account.session_id = "session";
  account.is_final = true;
  account.streams = {{stream, 8, 5}};
  EXPECT_FALSE(store.take_account(account));
  EXPECT_FALSE(store.write_items({4, 0, 2, samples({0, 10})}));
  EXPECT_FALSE(store.write_items({4, 4, 5, samples({40})}));
  make();
  EXPECT_THAT(read_file(folder_ / "session.txt"),
              HasSubstr("imu0 delivered 3 on_robot 5 lost 0\n"));
  EXPECT_FALSE(store.write_late(wire::Items{4, 1, samples({10, 20, 30, 40})}));
  EXPECT_FALSE(store.write_late(wire::Items{4, 1, samples({10, 20, 30, 40})}));
  EXPECT_FALSE(store.write_late(wire::Items{4, 5, samples({50})}));
  EXPECT_EQ(store.position()[4], 5U);
  EXPECT_EQ(store.summary().totals.late_items, 2U);
  account.streams.front().held = 0;
  EXPECT_FALSE(store.take_account(account));
  make();
  EXPECT_EQ(read_file(folder_ / "imu0/data.csv"),
            std::string(kEurocImuHeader) +
                "0,0,0,0,0,0,0\n10,0,0,0,0,0,0\n20,0,0,0,0,0,0\n"
                "30,0,0,0,0,0,0\n40,0,0,0,0,0,0\n50,0,0,0,0,0,0\n");
  EXPECT_THAT(read_file(folder_ / "session.txt"),
              HasSubstr("imu0 delivered 6 on_robot 0 lost 2\n"));
}

TEST_F(ViewsTest, AStrangersRecordOfManyFramesMakesNoLongFile) {
  const auto store = open();
  deliver(*store, {0, 1});
  EXPECT_FALSE(
      store->write_items(dropped(0, {{2, 0, DropReason::kBusy, 0, std::uint64_t{1} << 62, 99}})));
  make();
  EXPECT_EQ(std::ranges::count(read_file(folder_ / "drops.csv"), '\n'), 1 + 1000 + 2 * 100);
  EXPECT_THAT(read_file(folder_ / "session.txt"), HasSubstr("\nbusy 4611686018427387904\n"));
}

TEST_F(ViewsTest, ASessionIsSummedUpForPeople) {
  const auto [reduced, whole] = reduced_pair(1);
  const auto store = open();
  deliver(*store, {0});
  write(*store, reduced);
  late(*store, whole);
  late(*store, plain_frame(3));
  EXPECT_FALSE(store->write_items(dropped(0, {{2, 1, DropReason::kPolicy}})));
  EXPECT_FALSE(store->note({{9, 0, 0, 0, 0, 0, 0}, -5}));
  EXPECT_FALSE(store->take_account(account(10, 2, 7)));
  make();
  EXPECT_EQ(read_file(folder_ / "session.txt"),
            "robot robot\nsession session\nstate open\ncaptured 10\nlive 2\nlate 1\nreplaced 1\n"
            "on_robot 2\npolicy 1\nbusy 0\nfailed 0\nshutdown 0\nrefused 0\nunknown 3\nlost 0\n"
            "clock_offset_ns -5\n");
  EXPECT_FALSE(store->finish(true));
  EXPECT_THAT(read_file(folder_ / "session.txt"), HasSubstr("state ended\n"));
}

TEST_F(ViewsTest, WhereThereIsNothingThereIsNoFile) {
  const auto store = open();
  deliver(*store, {0});
  EXPECT_FALSE(store->write_items(dropped(0, {{1, 1, DropReason::kPolicy}})));
  make();
  EXPECT_THAT(names(), ElementsAre("checksums.sfv", "drops.csv", "images", "journal.000000",
                                   "session.txt", "times.txt"));
  late(*store, plain_frame(1));
  make();
  EXPECT_FALSE(fs::exists(folder_ / "drops.csv"));
}

TEST_F(ViewsTest, OfASessionThatIsOpenItsTimesAreLeftAlone) {
  const auto store = open();
  deliver(*store, {0});
  late(*store, plain_frame(2));
  test::write_file(folder_ / "images/000001.jpg", "being written");
  make(Views::kAllButTimes);
  deliver(*store, {3});
  EXPECT_THAT(listed(), ElementsAre(0, 3));
  EXPECT_TRUE(fs::exists(folder_ / "images/000001.jpg"));
}

TEST_F(ViewsTest, OnAFullDiskTheOldOnesStay) {
  {
    const auto store = open();
    for (Sequence i = 0; i < 50; ++i) write(*store, plain_frame(i, 10));
    make();
    deliver(*store, {60});
  }
  const auto times = read_file(folder_ / "times.txt");
  const auto all = names();
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 100);
    EXPECT_TRUE(make_views(folder_, Views::kAll));
  }
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_EQ(names(), all);
}

TEST_F(ViewsTest, AreMadeOfASessionOnly) { EXPECT_TRUE(make_views(folder_, Views::kAll)); }

}  // namespace
}  // namespace orbbuf
