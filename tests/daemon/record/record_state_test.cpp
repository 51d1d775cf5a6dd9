// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_state.hpp"

#include <gmock/gmock.h>

#include <limits>

#include "testing/captured_log.hpp"
#include "tests/daemon/record/record_fixture.hpp"

namespace orbbuf {
namespace {

using test::drop;
using test::progress;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;
using State = KeptFrame::State;

constexpr Sequence kAll = std::numeric_limits<Sequence>::max();

KeptFrame written(Sequence sequence, std::uint32_t segment = 0) {
  return {sequence, segment, static_cast<std::uint32_t>(sequence * 100), 100, State::kWritten};
}

/// A state with segment 0, in the session `id`, after the notes of another one.
class StateOf {
 public:
  explicit StateOf(const std::string& id, const RecordState* earlier = nullptr,
                   const std::string& robot = "robot")
      : state_(robot, id) {
    if (earlier != nullptr && !state_.apply_checkpoint(earlier->checkpoint())) ADD_FAILURE();
    state_.add_segment(0, 1000);
  }
  RecordState& operator*() { return state_; }
  RecordState* operator->() { return &state_; }

 private:
  RecordState state_;
};

/// A state that read its notes after its checkpoint says the same as the one that made them.
TEST(RecordState, ANextStartKnowsWhatTheNotesSay) {
  StateOf first("one");
  first->begin();
  const auto checkpoint = first->checkpoint();
  const std::vector<DropRecord> drops = {drop(4), drop(6, DropReason::kBusy)};
  first->give_up(drops);
  first->note(progress(10, 3));
  auto notes = first->take_notes();
  ASSERT_THAT(notes, SizeIs(1));
  first->give_up(std::vector{drop(11)});
  first->note({20, 77, 5, 5});
  notes.push_back(first->take_notes().front());
  EXPECT_THAT(first->take_notes(), IsEmpty());

  StateOf next("two");
  ASSERT_TRUE(next->apply_checkpoint(checkpoint));
  for (const auto& note : notes) {
    EXPECT_EQ(note.type, record_format::kAccount);
    next->apply_account(note.body);
  }
  next->begin();
  const auto accounts = next->take_accounts();
  ASSERT_THAT(accounts, SizeIs(2));
  EXPECT_EQ(
      accounts[0],
      (wire::Account{"one", true, false, 20, 77, 5, 0, 0, {drop(6, DropReason::kBusy), drop(11)}}));
  EXPECT_EQ(accounts[1].session_id, "two");
  EXPECT_FALSE(accounts[1].is_final);
}

TEST(RecordState, AnAccountIsTakenAgainWhenItChangesOrOnANewConnection) {
  StateOf state("one");
  state->begin();
  EXPECT_THAT(state->take_accounts(), SizeIs(1));
  EXPECT_THAT(state->take_accounts(), IsEmpty());
  state->note(progress(5));
  EXPECT_THAT(state->take_accounts(), ElementsAre(testing::Field(&wire::Account::captured, 5U)));
  EXPECT_THAT(state->take_accounts(), IsEmpty());
  state->rewind_accounts();
  EXPECT_THAT(state->take_accounts(), SizeIs(1));
}

TEST(RecordState, ASettledSessionIsForgotten) {
  StateOf one("one");
  one->begin();
  one->note(progress(5));
  StateOf two("two", &*one);
  two->begin();
  two->settle("two");  // the present one is never
  two->settle("unknown");
  EXPECT_THAT(two->take_accounts(), SizeIs(2));
  const auto before = two->checkpoint();
  two->settle("one");
  EXPECT_THAT(two->describe_earlier(10), IsEmpty());
  const auto notes = two->take_notes();
  ASSERT_THAT(notes, SizeIs(1));

  StateOf three("three");  // from the note
  ASSERT_TRUE(three->apply_checkpoint(before));
  three->apply_account(notes.front().body);
  three->begin();
  EXPECT_THAT(three->take_accounts(),
              ElementsAre(testing::Field(&wire::Account::session_id, "three")));
  StateOf four("four", &*two);  // from a checkpoint
  four->begin();
  EXPECT_THAT(four->take_accounts(), SizeIs(1));
}

/// The server may have said bye for a reason of its own: it settles the session.
TEST(RecordState, ASessionThatEndedIsToldOnceMore) {
  StateOf one("one");
  one->begin();
  one->note(progress(5, 5));
  one->end();
  StateOf two("two", &*one);
  two->begin();
  EXPECT_THAT(two->describe_earlier(10), IsEmpty());
  const auto accounts = two->take_accounts();
  ASSERT_THAT(accounts, SizeIs(2));
  EXPECT_TRUE(accounts.front().has_ended);
  EXPECT_TRUE(accounts.front().is_final);
}

TEST(RecordState, DropRecordsAreNotedWithoutProgress) {
  StateOf one("one");
  one->begin();
  one->give_up(std::vector{drop(1)});
  EXPECT_THAT(one->take_notes(), SizeIs(1));
}

TEST(RecordState, WhileNothingHappensThereIsNoNote) {
  StateOf one("one");
  one->begin();
  EXPECT_TRUE(one->note(progress(0))) << "that it has begun";
  EXPECT_THAT(one->take_notes(), SizeIs(1));
  EXPECT_FALSE(one->note(progress(0)));
  EXPECT_TRUE(one->note(progress(1)));
  EXPECT_THAT(one->take_notes(), SizeIs(1));
  EXPECT_THAT(one->take_accounts(), SizeIs(1));
  EXPECT_FALSE(one->note(progress(1)));
  EXPECT_THAT(one->take_notes(), IsEmpty());
  EXPECT_THAT(one->take_accounts(), IsEmpty());
  one->give_up(std::vector{drop(0)});
  EXPECT_TRUE(one->note(progress(1)));
  EXPECT_THAT(one->take_notes(), SizeIs(1));
  auto samples = progress(1);
  samples.streams = {{{4, "imu0", "imu"}, 9, 7}};
  EXPECT_TRUE(one->note(samples));
  EXPECT_THAT(one->take_notes(), SizeIs(1));
  EXPECT_FALSE(one->note(samples)) << "no camera, and no samples without its frames";
}

TEST(RecordState, ASessionOfWhichFramesAreHeldIsNotForgotten) {
  StateOf one("one");
  one->begin();
  one->note(progress(5));
  one->keep(3);
  one->on_written(written(3));
  one->end();
  StateOf two("two", &*one);
  two->apply({{"robot/one", {{written(3)}, {}}}}, false);
  two->begin();
  const auto account = two->take_accounts().front();
  EXPECT_EQ(account.held, 1U);
  EXPECT_EQ(account.first_held, 3U);
  two->settle("one");
  const auto taken = two->take_next(kAll);
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->session, "one");
  two->remove(taken->id);
  EXPECT_EQ(two->take_accounts().front().held, 0U);
  two->settle("one");
  EXPECT_THAT(two->describe_earlier(10), IsEmpty());
}

TEST(RecordState, ManyDropRecordsCrossInSeveralAccountsOfWhichTheLastIsFinal) {
  StateOf one("one");
  one->begin();
  constexpr Sequence kFrames = 2 * wire::kMaxDropsPerMessage + 10;
  for (Sequence i = 0; i < kFrames; ++i) one->give_up(std::vector{drop(i)});
  one->note({kFrames, 1, 0, 0});
  EXPECT_THAT(one->take_accounts(), SizeIs(1));  // they cross in their own stream
  StateOf two("two", &*one);
  two->begin();
  const auto accounts = two->take_accounts();
  ASSERT_THAT(accounts, SizeIs(4));
  Sequence next = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(accounts[i].is_final, i == 2);
    EXPECT_LE(accounts[i].given_up.size(), wire::kMaxDropsPerMessage);
    for (const DropRecord& record : accounts[i].given_up) EXPECT_EQ(record.sequence, next++);
  }
  EXPECT_EQ(next, kFrames);
}

TEST(RecordState, FramesOfAllSessionsAreTakenTheOldestFirst) {
  StateOf one("one");
  one->begin();
  one->note(progress(9));
  StateOf two("two", &*one);
  two->apply({{"robot/one", {{written(7), written(8)}, {7}}}}, false);
  two->begin();
  for (const Sequence sequence : {2U, 1U}) {
    EXPECT_TRUE(two->keep(sequence));
    EXPECT_FALSE(two->keep(sequence));
    two->on_written(written(sequence));
  }
  std::vector<std::pair<std::string, Sequence>> taken;
  while (const auto next = two->take_next(2)) taken.emplace_back(next->session, next->id.sequence);
  EXPECT_THAT(taken, ElementsAre(std::pair("one", 8U), std::pair("two", 1U)));
  EXPECT_EQ(two->take_next(kAll)->id.sequence, 2U);
}

TEST(RecordState, AReleasedFrameIsNotedIfItWasWritten) {
  StateOf state("one");
  state->begin();
  state->keep(1);
  state->keep(2);
  state->remove(*state->find_present(2));  // never written
  EXPECT_FALSE(state->find_present(2));
  state->on_written(written(1));
  state->remove(*state->find_present(1));
  state->keep(3);
  state->remove(*state->find_present(3));
  state->on_written(written(3));  // while it was being written
  const auto notes = state->take_notes();
  ASSERT_THAT(notes, SizeIs(1));
  EXPECT_EQ(notes.front().type, record_format::kReleased);
  EXPECT_THAT(notes.front().released, ElementsAre(1, 3));
  EXPECT_EQ(notes.front().session, "robot/one");
  EXPECT_EQ(state->held(), 0U);
  EXPECT_FALSE(state->is_needed(0));
}

TEST(RecordState, ARemovedSegmentTakesFramesOfSeveralSessions) {
  StateOf one("one");
  one->begin();
  one->note(progress(9));
  StateOf two("two", &*one);
  two->add_segment(1, 500);
  two->apply({{"robot/one", {{written(7), written(8, 1)}, {}}}}, false);
  two->begin();
  two->keep(1);
  two->on_written(written(1));
  EXPECT_EQ(two->oldest_segment(), 0U);
  EXPECT_EQ(two->bytes(), 1500U);
  EXPECT_THAT(two->remove_segment(0),
              ElementsAre(RecordState::Lost{"robot/one", 1}, RecordState::Lost{"robot/two", 1}));
  EXPECT_EQ(two->oldest_segment(), std::nullopt);  // the newest is not removed
  EXPECT_EQ(two->bytes(), 500U);
  EXPECT_EQ(two->held(), 1U);
}

TEST(RecordState, AnIndexOfAnOlderSegmentBringsNoForgottenSessionBack) {
  StateOf state("one");
  state->apply({{"robot/gone", {{written(7)}, {}}}}, false);
  state->apply({{"robot/new", {{written(8)}, {}}}}, true);
  state->begin();
  EXPECT_EQ(state->held(), 1U);
  EXPECT_EQ(state->take_next(kAll)->session, "new");
  EXPECT_EQ(state->take_accounts().front().captured, 9U);
}

wire::Items items(std::uint64_t first, std::uint16_t count) {
  wire::Writer payload(0);
  payload.put(count);
  return {4, first, payload.bytes()};
}

KeptFrame written_items(std::uint64_t first, std::uint16_t count) {
  return {first, 0, static_cast<std::uint32_t>(first), 40, State::kWritten, false, count};
}

/// Of stream 4.
SessionProgress progress_of_items(std::uint64_t captured, std::uint64_t settled) {
  SessionProgress progress = test::progress(9);
  progress.streams = {{{4, "imu0", "imu"}, captured, settled}};
  return progress;
}

TEST(RecordState, ItemsThatTheServerHasNotAreSentByTheNextStart) {
  StateOf one("one");
  one->begin();
  one->keep(items(0, 3));
  one->keep(items(3, 4));
  one->keep(items(7, 2));
  one->note(progress_of_items(9, 3));  // it has the first
  const auto notes = one->take_notes();
  ASSERT_THAT(notes, SizeIs(4));
  EXPECT_EQ(notes[0].type, record_format::kAccount) << "it names their stream";
  EXPECT_EQ(notes[1].items, wire::StreamId{4});
  for (const auto& [first, count] : {std::pair(0, 3), std::pair(3, 4), std::pair(7, 2)}) {
    one->on_written(
        written_items(static_cast<std::uint64_t>(first), static_cast<std::uint16_t>(count)), 4);
  }
  EXPECT_FALSE(one->take_next(kAll)) << "they are not late";
  EXPECT_TRUE(one->is_needed(0));

  StateOf two("two", &*one);
  two->apply(
      {{"robot/one",
        {{}, {}, {{4, written_items(0, 3)}, {4, written_items(3, 4)}, {4, written_items(7, 2)}}}}},
      false);
  two->begin();
  EXPECT_EQ(two->held_items(), 6U);
  const auto account = two->take_accounts().front();
  EXPECT_THAT(account.streams, ElementsAre(wire::StreamAccount{{4, "imu0", "imu"}, 9, 6}));
  EXPECT_FALSE(two->settle("one"));
  for (const Sequence first : {3U, 7U}) {
    const auto taken = two->take_next(kAll);
    ASSERT_TRUE(taken);
    EXPECT_EQ(taken->id, (KeptId{0, first, 4}));
    two->remove(taken->id);
  }
  EXPECT_FALSE(two->is_needed(0));
  EXPECT_TRUE(two->settle("one"));
}

TEST(RecordState, ItemsOfAStreamThatNoAccountNamesAreLost) {
  const test::CapturedLog log;
  StateOf state("two");
  state->apply({{"robot/one", {{}, {}, {{4, written_items(0, 3)}}}}}, true);
  state->begin();
  EXPECT_EQ(state->held_items(), 0U);
  EXPECT_EQ(log.lines("the samples of session robot/one are lost").size(), 1U);
}

TEST(RecordState, ItemsThatDoNotWaitAnyMoreAreSentLate) {
  StateOf one("one");
  one->begin();
  for (const std::uint64_t first : {0U, 3U, 6U}) {
    one->keep(items(first, 3));
    one->on_written(written_items(first, 3), 4);
  }
  one->send_late(4, 4, 5);
  one->note(progress_of_items(9, 9));  // the position is beyond them
  const auto taken = one->take_next(kAll);
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->id.sequence, 3U);
  EXPECT_EQ(one->held_items(), 3U);
  one->give_back(taken->id);
  EXPECT_EQ(one->take_next(kAll)->id.sequence, 3U);
}

TEST(RecordState, ItemsThatGoWhileTheyWaitElsewhereAreLostOnlyOnceTheyAreLate) {
  StateOf one("one");
  one->begin();
  one->add_segment(1, 100);
  for (const std::uint64_t first : {0U, 3U, 6U, 9U}) {
    one->keep(items(first, 3));
    one->on_written(written_items(first, 3), 4);
  }
  EXPECT_EQ(one->send_late(4, 10, 11), 0U);
  EXPECT_THAT(one->remove_segment(0), ElementsAre(RecordState::Lost{"robot/one", 0, 1}));
  one->note(progress_of_items(15, 4));  // that below it was delivered live
  one->keep(items(12, 3));
  const auto notes = one->take_notes();
  one->refuse_items(notes.back());
  EXPECT_EQ(one->held_items(), 0U);
  EXPECT_EQ(one->send_late(4, 4, 9), 5U);
  EXPECT_EQ(one->send_late(4, 13, 20), 2U);
}

TEST(RecordState, SessionsOfAnotherRobotAreKeptAndNotTold) {
  StateOf theirs("one", nullptr, "other");
  theirs->begin();
  theirs->note(progress(9));
  StateOf ours("two", &*theirs);
  ours->apply({{"other/one", {{written(7)}, {}}}}, false);
  ours->begin();
  EXPECT_EQ(ours->held(), 0U);
  EXPECT_FALSE(ours->take_next(kAll));
  EXPECT_THAT(ours->take_accounts(), SizeIs(1));
  EXPECT_THAT(ours->describe_earlier(9).front(), testing::HasSubstr("robot.id is another one"));
  StateOf again("three", &*ours, "other");
  again->apply({{"other/one", {{written(7)}, {}}}}, false);
  again->begin();
  EXPECT_EQ(again->held(), 1U);
  EXPECT_THAT(again->take_accounts(), SizeIs(2));
}

TEST(RecordState, TheOldestOfTooManySessionsIsForgottenAndItsTotalsAreLogged) {
  RecordState many("robot", "unused");
  for (std::size_t i = 0; i <= RecordState::kMostSessions; ++i) {
    wire::Writer out(0);
    record_format::put(out, {"robot/" + std::to_string(i), false, false, 10 + i, 1, 3, 3}, {});
    many.apply_account(out.bytes());
  }
  many.add_segment(0, 1000);
  many.apply({{"robot/0", {{written(5)}, {}}}}, false);
  const test::CapturedLog log;
  many.begin();
  EXPECT_THAT(log.lines("is forgotten"), SizeIs(2));
  EXPECT_THAT(log.lines("session robot/0 is forgotten").front(),
              testing::HasSubstr("of its 10 frames the server confirmed those below 3; 1 kept"));
  EXPECT_FALSE(many.is_needed(0));
  EXPECT_THAT(many.take_accounts(), SizeIs(RecordState::kMostSessions));
}

TEST(RecordState, OfTooManyDropRecordsTheOldestSessionsKeepTheTotals) {
  constexpr Sequence kDrops = RecordState::kMostEarlierDrops / 4;
  RecordState many("robot", "unused");
  for (int i = 0; i < 6; ++i) {
    DropRanges drops;
    for (Sequence n = 0; n < kDrops; ++n) drops.add(drop(2 * n));
    wire::Writer out(0);
    record_format::put(out, {"robot/" + std::to_string(i), false, false, 2 * kDrops}, drops);
    many.apply_account(out.bytes());
  }
  many.begin();
  std::map<std::string, std::size_t> drops;
  for (const auto& account : many.take_accounts()) {
    drops[account.session_id] += account.given_up.size();
    EXPECT_EQ(account.captured, account.session_id == "unused" ? 0 : 2 * kDrops);
  }
  EXPECT_EQ(drops["0"], 0U);
  EXPECT_EQ(drops["1"], 0U);
  EXPECT_EQ(drops["2"], kDrops);
  EXPECT_EQ(drops["5"], kDrops);
}

TEST(RecordState, ACheckpointThatIsNoneChangesNothing) {
  StateOf one("one");
  one->begin();
  one->note(progress(5));
  auto body = one->checkpoint();
  StateOf two("two");
  for (std::size_t size = 0; size < body.size(); ++size) {
    EXPECT_FALSE(two->apply_checkpoint(record_format::Bytes(body).first(size))) << size;
  }
  body[0] = 99;  // a version to come
  EXPECT_FALSE(two->apply_checkpoint(body));
  two->begin();
  EXPECT_THAT(two->take_accounts(), SizeIs(1));
}

}  // namespace
}  // namespace orbbuf
