// SPDX-License-Identifier: Apache-2.0
#include "server/session/recovery.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <functional>
#include <map>

#include "tests/server/session/stepped_child.hpp"
#include "tests/server/session/stored_session.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using journal::Place;
using test::as_text;
using test::dropped;
using test::kArrivedNs;
using test::plain_frame;
using test::plain_pair;
using test::read_file;
using test::reduced_pair;
using test::reduced_stereo_pair;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

/// What a kill or a power cut has left of a session is put right when it is opened.
class RecoveryTest : public test::StoredSession {
 protected:
  /// All frames are recorded; those before `kept` are known to be on the device.
  void record_kept(const std::vector<Sequence>& kept, const std::vector<Sequence>& unkept) {
    const auto store = open();
    deliver(*store, kept);
    store->set_kept(store->written());
    deliver(*store, unkept);
  }
  /// Where the record of each frame begins.
  std::vector<Place> places() const {
    std::vector<Place> places;
    RecordReader reader(folder_);
    while (const auto entry = reader.next().value()) {
      if (std::holds_alternative<RecordedFrame>(entry->record.body)) places.push_back(entry->place);
    }
    return places;
  }
  void damage(const Place& place) const {
    std::string bytes = read_file(journal(place.segment));
    bytes.at(place.offset + 20) ^= 1;
    test::write_file(journal(place.segment), bytes);
  }
  void expect_whole_up_to(Sequence next) {
    EXPECT_EQ(this->next(), next);
    expect_whole();
    EXPECT_EQ(listed(), numbers());
    EXPECT_EQ(names("images").size(), numbers().size());
  }
};

TEST_F(RecoveryTest, OfNothingThereIsNothing) {
  const auto recovered = recover_session(folder_, {"robot", "session", ""}, Durability::kAck);
  EXPECT_TRUE(recovered.value().is_new);
  EXPECT_FALSE(fs::exists(folder_));
}

TEST_F(RecoveryTest, WhatWasInTheMiddleOfBeingWrittenBecomesAnOrphan) {
  const test::CapturedLog log;
  record({0});
  const std::string times = read_file(folder_ / "times.txt");
  test::write_file(folder_ / "times.txt", times + "2 0.0800");
  test::write_file(folder_ / "images/000002.jpg", "whole, but not accepted");
  test::write_file(folder_ / "images/notes.txt", "of another program");
  test::write_file(folder_ / "incoming.tmp", "torn");
  test::write_file(folder_ / "incoming_right.tmp", "torn, too");
  EXPECT_EQ(next(), 1U);
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_THAT(names("images"), ElementsAre("000000.jpg", "notes.txt"));
  EXPECT_THAT(names("orphans"), ElementsAre("images", "incoming.tmp", "incoming_right.tmp"));
  EXPECT_EQ(read_file(folder_ / "orphans/images/000002.jpg"), "whole, but not accepted");
  EXPECT_THAT(log.lines("moved 1 images without a record"), SizeIs(1));
}

TEST_F(RecoveryTest, BothImagesOfAPairWithoutARecordBecomeOrphans) {
  write(*open(), plain_pair(0, 10, 10));
  for (const char* image : {"images/000001.jpg", "images_right/000001.jpg"}) {
    test::write_file(folder_ / image, "whole, but not accepted");
  }
  EXPECT_EQ(next(), 1U);
  EXPECT_THAT(names("images"), ElementsAre("000000.jpg"));
  EXPECT_THAT(names("images_right"), ElementsAre("000000.jpg"));
}

TEST_F(RecoveryTest, AnOrphanTakesNoOthersPlace) {
  record({0});
  for (const char* content : {"first", "second"}) {
    test::write_file(folder_ / "images/000001.jpg", content);
    EXPECT_EQ(next(), 1U);
  }
  EXPECT_EQ(read_file(folder_ / "orphans/images/000001.jpg"), "first");
  EXPECT_EQ(read_file(folder_ / "orphans/images/000001.jpg.1"), "second");
}

TEST_F(RecoveryTest, RecordsWithoutWholeImagesAreAskedForAgain) {
  const test::CapturedLog log;
  record({0, 1, 2, 3, 4, 5});
  test::write_file(folder_ / "images/000003.jpg", "");
  fs::remove(folder_ / "images/000005.jpg");
  expect_whole_up_to(3);
  EXPECT_THAT(numbers(), ElementsAre(0, 1, 2));
  EXPECT_EQ(read_file(folder_ / "orphans/images/000004.jpg"), as_text(plain_frame(4).jpeg));
  EXPECT_THAT(log.lines("3 frames at the end are not whole"), SizeIs(1));
  record({3, 4, 5});
  expect_whole_up_to(6);
  EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 3, 4, 5));
}

TEST_F(RecoveryTest, AnImageWithOtherBytesIsNotWhole) {
  record({0, 1});
  test::write_file(folder_ / "images/000001.jpg", std::string(plain_frame(1).jpeg.size(), '\0'));
  expect_whole_up_to(1);
}

/// Too many open files, for one: the robot tries again.
TEST_F(RecoveryTest, AnImageThatCannotBeReadForNowCostsNoFrame) {
  record({0, 1});
  const fs::path image = folder_ / "images/000001.jpg";
  fs::rename(image, folder_ / "aside");
  fs::create_symlink(image.filename(), image);  // to itself: the system opens no such file
  EXPECT_FALSE(SessionStore::open(folder_, {"robot", "session", ""}, Durability::kAck));
  fs::remove(image);
  fs::rename(folder_ / "aside", image);
  EXPECT_EQ(next(), 2U);
}

/// On a damaged sector, for one: the robot is asked for it.
TEST_F(RecoveryTest, AnImageThatOpensAndCannotBeReadIsNotWhole) {
  record({0, 1});
  const fs::path image = folder_ / "images/000001.jpg";
  fs::remove(image);
  fs::create_directory(image);
  EXPECT_EQ(next(), 1U);
}

TEST_F(RecoveryTest, AJournalThatIsAFifoIsNotWaitedFor) {
  record({0, 1});
  fs::remove(journal());
  ASSERT_EQ(::mkfifo(journal().c_str(), 0600), 0);
  EXPECT_FALSE(SessionStore::open(folder_, {"robot", "session", ""}, Durability::kAck));
}

TEST_F(RecoveryTest, BothImagesOfAPairMustBeWhole) {
  {
    const auto store = open();
    for (Sequence i = 0; i < 2; ++i) write(*store, plain_pair(i, 10, 10));
  }
  fs::resize_file(folder_ / "images_right/000001.jpg", 4);
  EXPECT_EQ(next(), 1U);
  EXPECT_THAT(names("images_right"), ElementsAre("000000.jpg"));
}

/// The server was killed between the two renames, or a power cut has undone one of them.
TEST_F(RecoveryTest, AHalfReplacedPairIsCompletedWhereverItsRecordIs) {
  for (const bool is_left_done : {true, false}) {
    for (const bool is_kept : {false, true}) {
      fs::remove_all(folder_);
      const auto [reduced, whole] = reduced_stereo_pair(1);
      {
        const auto store = open();
        deliver(*store, {0});
        write(*store, reduced);
        deliver(*store, {2, 3});
        if (is_kept) store->set_kept(store->written());
        EXPECT_FALSE(is_kept && store->finish(true));
      }
      test::write_file(folder_ / (is_left_done ? "images/000001.jpg" : "incoming.tmp"),
                       as_text(whole.left()));
      test::write_file(folder_ / (is_left_done ? "incoming_right.tmp" : "images_right/000001.jpg"),
                       as_text(whole.right()));
      expect_whole();
      EXPECT_EQ(next(), 4U);
      EXPECT_EQ(image(1), as_text(whole.left()));
      EXPECT_EQ(read_file(folder_ / "images_right/000001.jpg"), as_text(whole.right()));
      EXPECT_THAT(names("orphans"), IsEmpty());
      EXPECT_EQ(late(*open(), whole), SessionStore::Late::kReplaced);
    }
  }
}

TEST_F(RecoveryTest, AllImagesGoneIsAnEmptySession) {
  record({0, 1});
  fs::remove_all(folder_ / "images");
  EXPECT_EQ(next(), 0U);
  EXPECT_THAT(listed(), IsEmpty());
}

TEST_F(RecoveryTest, WhatIsOnTheDeviceIsBelieved) {
  record_kept({0, 1}, {2, 3});
  fs::remove(folder_ / "images/000000.jpg");
  EXPECT_EQ(next(), 4U);
  fs::remove(folder_ / "images/000002.jpg");
  EXPECT_EQ(next(), 2U);
}

TEST_F(RecoveryTest, FramesThatOnlyAPartHasAreBelieved) {
  {
    const auto store = open();
    deliver(*store, {0, 1});
    const RecordedPart only{1, {}, store->written(), true};
    EXPECT_FALSE(store->note_part(only));
    deliver(*store, {2});
    EXPECT_FALSE(store->note_part({2, only.to, store->written()}));
    deliver(*store, {3});
  }
  fs::remove(folder_ / session_image(0));
  fs::remove(folder_ / session_image(1));
  EXPECT_EQ(next(), 4U);
  fs::remove(folder_ / session_image(2));
  EXPECT_EQ(next(), 2U);
}

TEST_F(RecoveryTest, WithoutSyncsTheNewestFramesAreCompared) {
  {
    const auto store = open(Durability::kOff);
    for (Sequence i = 0; i < kMostCompared + 2; ++i) write(*store, plain_frame(i, 1));
  }
  fs::remove(folder_ / "images/000001.jpg");
  const auto reopened = [&] { return open(Durability::kOff)->position()[wire::kFrames]; };
  EXPECT_EQ(reopened(), kMostCompared + 2);
  fs::remove(folder_ / "images/000002.jpg");
  EXPECT_EQ(reopened(), 2U);
}

TEST_F(RecoveryTest, LateFramesBehindTheCutAreAskedForAgainAsWell) {
  const auto [reduced, whole] = reduced_pair(0);
  {
    const auto store = open();
    write(*store, reduced);
    deliver(*store, {1, 4});
    late(*store, plain_frame(2));
    store->set_kept(store->written());
    late(*store, plain_frame(3));
    late(*store, whole);
    late(*store, plain_frame(9));
  }
  fs::remove(folder_ / "images/000003.jpg");
  EXPECT_EQ(next(), 5U);
  EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 4));
  EXPECT_THAT(names("images"), SizeIs(4));
  EXPECT_EQ(image(0),
            as_text(whole.jpeg));  // its record is gone, and the image is known all the same
  expect_whole();
  const auto store = open();
  EXPECT_EQ(late(*store, whole), SessionStore::Late::kReplaced);
  EXPECT_EQ(late(*store, plain_frame(3)), SessionStore::Late::kNew);
}

TEST_F(RecoveryTest, LateFramesBeyondThePositionAreNoOrphans) {
  {
    const auto store = open();
    deliver(*store, {0});
    late(*store, plain_frame(7));
  }
  test::write_file(folder_ / "images/000008.jpg", "without a record");
  EXPECT_EQ(next(), 1U);
  EXPECT_THAT(names("images"), ElementsAre("000000.jpg", "000007.jpg"));
}

TEST_F(RecoveryTest, ALateImageWithoutARecordIsSetAsideInTheEnd) {
  record({0, 5});
  test::write_file(folder_ / "images/000003.jpg", "without a record");
  EXPECT_FALSE(open()->finish(true));
  EXPECT_THAT(names("images"), ElementsAre("000000.jpg", "000005.jpg"));
  EXPECT_THAT(names("orphans/images"), ElementsAre("000003.jpg"));
}

TEST_F(RecoveryTest, ADamagedRecordEndsWhatIsNotKnownToBeOnTheDevice) {
  record_kept({0, 1}, {2, 3, 4});
  damage(places()[3]);
  expect_whole_up_to(3);
}

TEST_F(RecoveryTest, ADamagedRecordOnTheDeviceCostsItselfOnly) {
  record_kept({0, 1, 2}, {3});
  damage(places()[1]);
  EXPECT_EQ(next(), 4U);
  const auto session = read();
  EXPECT_THAT(numbers(), ElementsAre(0, 2, 3));
  EXPECT_THAT(session.problems, ElementsAre(HasSubstr("bytes are damaged")));
  EXPECT_FALSE(open()->finish(true));
  EXPECT_TRUE(fs::exists(folder_ / "images/000001.jpg"));
}

TEST_F(RecoveryTest, ABadBitInTheHeadOfASegmentOnTheDeviceCostsNoFrame) {
  {
    const auto store = open(Durability::kAck, std::string(16'000, 'c'));
    for (Sequence i = 0; i < 4; ++i) {
      deliver(*store, {i});
      for (std::uint64_t k = 0; k < 9; ++k) {
        EXPECT_FALSE(store->write_items({5, i, i + 1, std::vector<std::uint8_t>(60'000)}));
      }
    }
    deliver(*store, {4});
    store->set_kept(store->written());
    deliver(*store, {5});
  }
  ASSERT_THAT(journal::segments_in(folder_).value(), ElementsAre(0, 1, 2));
  for (const std::uint32_t segment : {0U, 1U, 2U}) {
    const std::string good = read_file(journal(segment));
    for (std::size_t bit = 0; bit < journal::kHeadBytes * 8; bit += 7) {
      std::string bad = good;
      bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << bit % 8));
      test::write_file(journal(segment), bad);
      const test::CapturedLog log;
      EXPECT_EQ(next(), 6U) << segment << ", bit " << bit;
      EXPECT_EQ(log.lines("bytes of its journal are damaged").size(), segment == 2 ? 1U : 0U);
      EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 3, 4, 5));
      expect_whole();
    }
    test::write_file(journal(segment), good);
  }
}

TEST_F(RecoveryTest, ASegmentThatWasLostEndsWhatIsNotKnownToBeOnTheDevice) {
  {
    const auto store = open(Durability::kAck, std::string(16'000, 'c'));
    for (Sequence i = 0; i < 8; ++i) {
      deliver(*store, {i});
      for (std::uint64_t k = 0; k < 9; ++k) {
        EXPECT_FALSE(store->write_items({5, i, i + 1, std::vector<std::uint8_t>(60'000)}));
      }
    }
  }
  ASSERT_THAT(journal::segments_in(folder_).value(), ElementsAre(0, 1, 2, 3));
  const auto copy = parent_ / "copy";
  fs::copy(folder_, copy, fs::copy_options::recursive);
  const std::vector<std::function<void()>> losses = {
      [&] { fs::remove(journal(2)); }, [&] { fs::resize_file(journal(2), 0); },
      [&] { test::write_file(journal(2), std::string(5000, '\0')); },
      [&] {
        damage({2, 0});
      }};
  Sequence before = 0;
  for (const Place& place : places()) before += place.segment < 2 ? 1 : 0;
  for (const auto& lose : losses) {
    fs::remove_all(folder_);
    fs::copy(copy, folder_, fs::copy_options::recursive);
    lose();
    expect_whole_up_to(before);
    record({before});
    expect_whole_up_to(before + 1);
  }
}

TEST_F(RecoveryTest, WhateverIsLeftOfTimesItIsMended) {
  record_kept({0, 1, 2}, {3, 4, 5});
  const std::string times = read_file(folder_ / "times.txt");
  const std::size_t kept = times.find("3 ");
  for (const std::string& left :
       {times.substr(0, kept), times.substr(0, kept + 9),
        times.substr(0, kept) + std::string(500, '\0'),
        times.substr(0, kept) + std::string(20, '\0') + times.substr(kept + 20),
        times + std::string(4096, '\0'), times + "99 1.000000000 0.000000\n", std::string(),
        std::string("# notes\n"), std::string(1 << 20, '\0'), times.substr(0, 5)}) {
    test::write_file(folder_ / "times.txt", left);
    EXPECT_EQ(next(), 6U);
    EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  }
  fs::remove(folder_ / "times.txt");
  EXPECT_EQ(next(), 6U);
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
}

TEST_F(RecoveryTest, LinesOfRecordsThatAreOnTheDeviceAreNotWrittenAgain) {
  record_kept({0, 1, 2}, {3});
  std::string times = read_file(folder_ / "times.txt");
  times[0] = '7';  // which a rewrite would undo
  test::write_file(folder_ / "times.txt", times);
  EXPECT_EQ(next(), 4U);
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
}

TEST_F(RecoveryTest, TheJournalMayBeCutAnywhere) {
  const auto [reduced, whole] = reduced_pair(2);
  {
    const auto store = open(Durability::kAck, "camera");
    deliver(*store, {0, 1});
    write(*store, reduced);
    EXPECT_FALSE(store->write_items(dropped(0, {{3, 1}})));
    EXPECT_FALSE(store->note({{5, 0, 0, 0, 0, 0, 0}, 7}));
    write(*store, plain_pair(4, 20, 30));
    late(*store, plain_frame(3));
    late(*store, whole);
    EXPECT_FALSE(store->take_account(test::account(6)));
    deliver(*store, {6});
  }
  std::vector<std::pair<std::uint64_t, SessionSummary>> states = {{0, {}}};
  SessionSummary summary;
  RecordReader reader(folder_);
  while (const auto entry = reader.next().value()) {
    add(entry->record.body, summary);
    states.emplace_back(entry->end.offset, summary);
  }
  const auto copy = parent_ / "copy";
  fs::rename(folder_, copy);
  for (std::uint64_t bytes = states.back().first + 1; bytes-- > 0;) {
    while (states.back().first > bytes) states.pop_back();
    fs::remove_all(folder_);
    fs::copy(copy, folder_, fs::copy_options::recursive);
    fs::resize_file(journal(), bytes);
    const auto store = open(Durability::kAck, "camera");
    if (states.back().first > 0) {
      EXPECT_EQ(store->summary(), states.back().second) << bytes;
    }
    const auto session = read();
    for (const RecordedFrame& frame : session.frames) {
      const auto images = read_images(folder_, frame);
      EXPECT_TRUE(images && is_whole(frame, images.value())) << bytes;
    }
    const auto is_near = [&](const auto& state) {
      return bytes + 1 >= state.first && bytes <= state.first + 1;
    };
    if (std::ranges::none_of(states, is_near)) continue;
    // The robot sends what is missing, and all is as it was.
    const Sequence next = store->position()[wire::kFrames];
    if (next <= 0) deliver(*store, {0});
    if (next <= 1) deliver(*store, {1});
    if (next <= 2) write(*store, reduced);
    if (next <= 4) write(*store, plain_pair(4, 20, 30));
    late(*store, plain_frame(3));
    late(*store, whole);
    if (next <= 6) deliver(*store, {6});
    EXPECT_FALSE(store->finish(true));
    EXPECT_EQ(numbers(), (std::vector<Sequence>{0, 1, 2, 3, 4, 6})) << bytes;
    EXPECT_EQ(listed(), numbers()) << bytes;
    EXPECT_EQ(names("images").size(), 6U) << bytes;
    EXPECT_EQ(image(2), as_text(whole.jpeg)) << bytes;
    if (HasFailure()) return;
  }
}

/// All that is in the folder but the journal and what could not be explained.
std::map<std::string, std::string> contents_of(const fs::path& folder) {
  std::map<std::string, std::string> contents;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = fs::relative(entry.path(), folder);
    if (!entry.is_regular_file() || name.starts_with("journal.") || name.starts_with("orphans/")) {
      continue;
    }
    contents[name] = read_file(entry.path());
  }
  return contents;
}

TEST_F(RecoveryTest, AKillBeforeAnySystemCallLeadsToTheSameSession) {
  const test::CapturedLog log;
  const auto pair = reduced_pair(1);
  const auto& reduced = pair.reduced;
  const auto& whole = pair.whole;
  const auto stereo = reduced_stereo_pair(3);
  // What a robot does not know to be taken it sends again.
  const std::vector<std::function<bool(SessionStore&)>> steps = {
      [&](SessionStore& store) { return !store.write(plain_frame(0), kArrivedNs); },
      [&](SessionStore& store) { return !store.write(reduced, kArrivedNs); },
      [&](SessionStore& store) { return !store.write(stereo.reduced, kArrivedNs); },
      [&](SessionStore& store) { return !store.write(plain_pair(4, 20, 30), kArrivedNs); },
      [&](SessionStore& store) {
        return store.position()[wire::kDrops] > 0 || !store.write_items(dropped(0, {{5, 1}}));
      },
      [&](SessionStore& store) { return store.write_late(plain_frame(2), kArrivedNs).has_value(); },
      [&](SessionStore& store) { return store.write_late(whole, kArrivedNs).has_value(); },
      [&](SessionStore& store) { return store.write_late(stereo.whole, kArrivedNs).has_value(); },
      [&](SessionStore& store) {
        return store.write_late(plain_frame(0, 50), kArrivedNs).has_value();
      },
      [&](SessionStore& store) { return !store.write(plain_frame(6), kArrivedNs); },
      [&](SessionStore& store) { return !store.take_account(test::account(8)); },
      [&](SessionStore& store) { return !store.finish(true); }};
  const auto play = [&](SessionStore& store, std::size_t from, std::size_t to) {
    return std::all_of(steps.begin() + static_cast<std::ptrdiff_t>(from),
                       steps.begin() + static_cast<std::ptrdiff_t>(to),
                       [&](const auto& step) { return step(store); });
  };
  ASSERT_TRUE(play(*open(Durability::kAck, "camera"), 0, steps.size()));
  const auto expected = contents_of(folder_);
  EXPECT_EQ(expected.size(), 14U);  // 6 left images, 2 right ones, 5 views, camera.txt

  std::size_t last_call = 0;
  for (bool is_killed = true; is_killed; ++last_call) {
    fs::remove_all(folder_);
    std::array<int, 2> pipe{};
    ASSERT_EQ(::pipe(pipe.data()), 0);
    is_killed = test::step_child(
        [&] {
          const auto store = open(Durability::kAck, "camera");
          return std::ranges::all_of(steps, [&](const auto& step) {
            return step(*store) && ::write(pipe[1], "", 1) == 1;
          });
        },
        [&](std::size_t call) { return call == last_call + 1; });
    ::close(pipe[1]);
    std::size_t taken = 0;
    for (char byte = 0; ::read(pipe[0], &byte, 1) == 1;) ++taken;
    ::close(pipe[0]);

    const auto store = open(Durability::kAck, "camera");
    if (!store->is_new()) expect_whole();
    const Place written = store->written();
    EXPECT_TRUE(play(*store, 0, std::min(taken, steps.size() - 1)));
    EXPECT_EQ(store->written(), written) << "what was taken is there, before call " << last_call;
    EXPECT_TRUE(play(*store, std::min(taken, steps.size() - 1), steps.size()));
    EXPECT_EQ(contents_of(folder_), expected) << "before call " << last_call;
    if (HasFailure()) return;
  }
  EXPECT_GT(last_call, 6 * steps.size());
}

/// A writer in another process tells each frame that was taken, until it is killed.
TEST_F(RecoveryTest, AKillCostsNothingThatWasTaken) {
  for (int round = 0; round < 20; ++round) {
    const Sequence first = next() + next() % 2;
    std::array<int, 2> pipe{};
    ASSERT_EQ(::pipe(pipe.data()), 0);
    const pid_t child = ::fork();
    if (child == 0) {
      const auto store = open();
      for (Sequence i = first;; i += 2) {
        if (store->write(i % 3 == 0 ? plain_pair(i, 900, 700) : plain_frame(i, 2000), 0))
          ::_exit(1);
        if (i % 7 == 0 && !store->write_late(plain_frame(i + 1, 500), 0)) ::_exit(1);
        if (::write(pipe[1], &i, sizeof i) != sizeof i) ::_exit(1);
      }
    }
    ASSERT_GT(child, 0);
    ::close(pipe[1]);
    Sequence taken = first;
    for (int i = 0; i < 5 + 7 * round; ++i) {
      ASSERT_EQ(::read(pipe[0], &taken, sizeof taken), static_cast<ssize_t>(sizeof taken));
    }
    ::kill(child, SIGKILL);
    while (::read(pipe[0], &taken, sizeof taken) > 0) {
    }
    ::close(pipe[0]);
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    ASSERT_GE(next(), taken + 1);
    ASSERT_LE(next(), taken + 3);
    expect_whole();
  }
  EXPECT_FALSE(open()->finish(true));
  EXPECT_EQ(listed(), numbers());
  EXPECT_EQ(names("images").size(), numbers().size());
}

}  // namespace
}  // namespace orbbuf
