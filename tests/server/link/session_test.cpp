// SPDX-License-Identifier: Apache-2.0
#include "server/link/session.hpp"

#include <gmock/gmock.h>

#include "testing/captured_log.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::plain_frame_ptr;

/// A sink that answers when the test says so.
class FakeSink : public FrameSink {
 public:
  explicit FakeSink(wire::Position position = {}) : position_(position) {}
  wire::Position position() const override { return position_; }
  void async_write(FramePtr frame, Done done) override {
    frames.push_back(frame->sequence);
    done_ = std::move(done);
  }
  bool takes_items() const override { return wants_items; }
  void async_write_items(ItemsPtr written, Done done) override {
    items.push_back(written->first);
    done_ = std::move(done);
  }
  void note(const SessionClosing& reported) override {
    EXPECT_FALSE(reported.has_ended);
    notes.push_back(reported.stats->captured);
  }
  std::uint64_t lost() const override { return lost_frames; }
  void cancel() override { is_cancelled = true; }
  void async_drain(const SessionClosing& last, Done drained) override {
    closing = last;
    ++drains;
    if (!is_draining) return drained(std::nullopt);
    drained_ = std::move(drained);
  }
  void close() override {
    is_closed = true;
    drain();
  }

  void drain(std::optional<Error> error = std::nullopt) {
    if (drained_) std::exchange(drained_, nullptr)(std::move(error));
  }
  bool is_busy() const { return static_cast<bool>(done_); }
  void answer(std::optional<Error> error = std::nullopt) {
    std::exchange(done_, nullptr)(std::move(error));
  }

  void async_commit(Done done) override {
    if (!holds_commits) return done(std::nullopt);
    EXPECT_FALSE(commit_);
    commit_ = std::move(done);
  }
  void answer_commit(std::optional<Error> error = std::nullopt) {
    std::exchange(commit_, nullptr)(std::move(error));
  }

  bool holds_commits = false;
  std::vector<Sequence> frames;
  bool wants_items = true;
  std::vector<std::uint64_t> items;  // of each call, the first
  std::vector<std::uint64_t> notes;
  std::uint64_t lost_frames = 0;
  bool is_cancelled = false;
  bool is_closed = false;
  bool is_draining = false;
  int drains = 0;
  std::optional<SessionClosing> closing;

 private:
  wire::Position position_;
  Done done_;
  Done commit_;
  Done drained_;
};

struct FakePeer : SessionPeer {
  void on_attached(wire::Position position) override { welcome = position; }
  void on_kept() override { ++kept; }
  void on_replaced() override { is_replaced = true; }
  void on_sent_away(const std::string& why) override { sent_away.push_back(why); }
  void on_ended(wire::Position position) override { bye = position; }
  void on_end_lost() override { is_end_lost = true; }

  std::optional<wire::Position> welcome;
  std::optional<wire::Position> bye;
  bool is_replaced = false;
  bool is_end_lost = false;
  std::vector<std::string> sent_away;
  int kept = 0;
};

class SessionTest : public test::EventLoop {
 protected:
  using Sequences = std::vector<Sequence>;

  void make(std::vector<std::shared_ptr<FrameSink>> sinks,
            std::chrono::nanoseconds timeout = std::chrono::hours(1)) {
    session_ =
        std::make_shared<Session>(main_, SessionInfo{"robot", "session", ""}, std::move(sinks),
                                  Session::Timeouts{timeout, std::chrono::seconds(2)},
                                  Session::Events{[this] { ++closed_; }, [this] { ++failures_; }});
    session_->attach(peer_);
  }
  void write(Sequence sequence) {
    session_->write(plain_frame_ptr(sequence), [this] { ++taken_; });
  }
  void write_drops(std::uint64_t first, std::size_t count) {
    session_->write_items(test::drops_ptr(first, std::vector<DropRecord>(count)), count,
                          [this] { ++taken_; });
  }
  bool run_until_busy(const FakeSink& sink) {
    return run_until([&] { return sink.is_busy(); });
  }

  std::shared_ptr<FakeSink> sink_ = std::make_shared<FakeSink>();
  std::shared_ptr<FakePeer> peer_ = std::make_shared<FakePeer>();
  std::shared_ptr<Session> session_;
  int taken_ = 0;
  int closed_ = 0;
  int failures_ = 0;
};

TEST_F(SessionTest, BeginsWhereTheSinkThatRemembersStands) {
  make({std::make_shared<FakeSink>(wire::Position{12, 3}), sink_});
  EXPECT_EQ(peer_->welcome, (wire::Position{12, 3}));
}

TEST_F(SessionTest, LostFramesOfAllSinksAreShown) {
  const auto second = std::make_shared<FakeSink>();
  make({sink_, second});
  const auto metrics = std::make_shared<RobotMetrics>(session_->info());
  session_->show(metrics);
  sink_->lost_frames = 2;
  second->lost_frames = 3;
  write(0);
  sink_->answer();
  second->answer();
  EXPECT_EQ(metrics->lost(), 5U);
  second->lost_frames = 4;
  session_->close(SessionEnd::kBye);
  EXPECT_EQ(metrics->lost(), 6U);
}

/// D
TEST_F(SessionTest, FramesThatAreNoJpegAreKeptAndTheFirstIsLogged) {
  const test::CapturedLog log;
  make({sink_});
  session_->write(test::jpeg_like_frame_ptr(0), [this] { ++taken_; });
  sink_->answer();
  EXPECT_TRUE(log.lines("is no JPEG").empty());
  for (const Sequence sequence : {1U, 2U}) {
    write(sequence);
    sink_->answer();
  }
  EXPECT_EQ(sink_->frames, (std::vector<Sequence>{0, 1, 2}));
  EXPECT_EQ(log.lines("frame 1 is no JPEG; it is kept as it came").size(), 1U);
  EXPECT_EQ(log.lines("is no JPEG").size(), 1U);
}

TEST_F(SessionTest, AFrameIsTakenWhenAllSinksHaveIt) {
  const auto second = std::make_shared<FakeSink>();
  make({sink_, second});
  write(4);
  sink_->answer();
  EXPECT_EQ(taken_, 0);
  EXPECT_EQ(session_->position()[wire::kFrames], 0U);
  second->answer();
  EXPECT_EQ(taken_, 1);
  EXPECT_EQ(session_->position(), (wire::Position{5, 0}));
}

TEST_F(SessionTest, AFrameIsKeptWhenItsCommitIsDone) {
  sink_->holds_commits = true;
  make({sink_});
  write(0);
  sink_->answer();
  EXPECT_EQ(taken_, 1);  // the next may come
  EXPECT_EQ(peer_->kept, 0);
  EXPECT_EQ(session_->received(), 1U);
  EXPECT_EQ(session_->kept(), wire::Position{});
  write(1);
  sink_->answer();
  sink_->answer_commit();
  EXPECT_EQ(peer_->kept, 1);
  EXPECT_EQ(session_->kept(), (wire::Position{1, 0}));  // the commit began before frame 1
  sink_->answer_commit();
  EXPECT_EQ(session_->kept(), (wire::Position{2, 0}));
}

TEST_F(SessionTest, TheSinksNoteTheStatsNowAndThenAndWhenTheConnectionIsLost) {
  make({sink_});
  session_->on_report({.stats = {1, 0, 0, 0, 0, 1, 0}});
  session_->on_report({.stats = {2, 0, 0, 0, 0, 2, 0}});
  EXPECT_EQ(sink_->notes, (std::vector<std::uint64_t>{1}));
  session_->detach(*peer_);
  EXPECT_EQ(sink_->notes, (std::vector<std::uint64_t>{1, 2}));
  session_->attach(peer_);
  session_->detach(*peer_);
  EXPECT_EQ(sink_->notes.size(), 2U);
}

TEST_F(SessionTest, TheSinksLearnHowTheSessionWasLeft) {
  const test::CapturedLog log;
  make({sink_});
  session_->on_report({.stats = {9, 0, 1, 1, 6, 1, 0}, .clock_offset_ns = -7});
  session_->on_bye({{10, 0}});
  session_->close(SessionEnd::kBye);
  EXPECT_EQ(sink_->closing, (SessionClosing{true, wire::Stats{10, 0, 1, 1, 6, 1, 0}, -7}));
  EXPECT_TRUE(log.lines("does not fit").empty());
}

TEST_F(SessionTest, TotalsThatDoNotFitAreLogged) {
  const test::CapturedLog log;
  make({std::make_shared<FakeSink>(wire::Position{12, 3})});
  session_->on_bye({{11, 3}});
  EXPECT_EQ(log.lines("does not fit: 11 frames captured, 3 dropped").size(), 1U);
}

TEST_F(SessionTest, OneThatTheRobotLeftIsNotEnded) {
  make({sink_});
  session_->on_report({.stats = {9, 0, 1, 1, 6, 1, 0}});
  session_->close(SessionEnd::kAbandoned);
  EXPECT_EQ(sink_->closing, (SessionClosing{false, wire::Stats{9, 0, 1, 1, 6, 1, 0}, 0}));
}

TEST_F(SessionTest, EachFailedTryOfASinkIsReported) {
  const test::CapturedLog log;
  make({sink_});
  write(0);
  sink_->answer(Error{"the disk is full"});
  EXPECT_EQ(failures_, 1);
  ASSERT_TRUE(run_until_busy(*sink_));
  sink_->answer(Error{"the disk is full"});
  EXPECT_EQ(failures_, 2);
  ASSERT_TRUE(run_until_busy(*sink_));
  sink_->answer();
  EXPECT_EQ(failures_, 2);
}

/// Over a slow link a robot may try another connection before a second has passed: seed 150051 of
/// the simulation.
TEST_F(SessionTest, SendsTheRobotAwayAfterTwoFailedTriesAlsoOfTwoConnections) {
  const test::CapturedLog log;
  make({sink_});
  write(0);
  sink_->answer(Error{"the disk is full"});
  session_->step_aside(false);
  const auto second = std::make_shared<FakePeer>();
  session_->attach(second);
  EXPECT_EQ(second->welcome, wire::Position{});
  write(0);
  sink_->answer(Error{"the disk is full"});
  session_->step_aside(false);
  EXPECT_THAT(peer_->sent_away, testing::IsEmpty());
  EXPECT_THAT(second->sent_away, testing::ElementsAre("the disk is full"));
  EXPECT_FALSE(session_->is_closing());
}

TEST_F(SessionTest, ARobotThatComesBackSinceItHasNoOtherServerStays) {
  const test::CapturedLog log;
  make({sink_});
  for (int i = 0; i < 3; ++i) {
    write(0);
    sink_->answer(Error{"the disk is full"});
    session_->step_aside(false);
    session_->detach(*peer_);
    session_->attach(peer_);
  }
  EXPECT_THAT(peer_->sent_away, testing::SizeIs(1));
  write(0);
  sink_->answer();
  EXPECT_EQ(session_->position(), (wire::Position{1, 0}));
}

TEST_F(SessionTest, ADeviceThatHasFailedEndsTheSessionAndSendsTheRobotAway) {
  make({sink_});
  write(0);
  sink_->answer();
  session_->step_aside(true);
  EXPECT_EQ(closed_, 1);
  EXPECT_THAT(peer_->sent_away, testing::SizeIs(1));
  EXPECT_FALSE(peer_->bye);
}

TEST_F(SessionTest, AWelcomeWaitsUntilWhatIsThereIsKept) {
  sink_ = std::make_shared<FakeSink>(wire::Position{12, 3});
  sink_->holds_commits = true;
  make({sink_});
  EXPECT_FALSE(peer_->welcome);
  sink_->answer_commit();
  EXPECT_EQ(peer_->welcome, (wire::Position{12, 3}));
}

TEST_F(SessionTest, ByeWaitsUntilAllIsKept) {
  sink_->holds_commits = true;
  make({sink_});
  write(0);
  sink_->answer();
  session_->close(SessionEnd::kBye);
  run_ready();
  EXPECT_FALSE(peer_->bye);
  sink_->answer_commit();
  EXPECT_EQ(peer_->bye, (wire::Position{1, 0}));
  EXPECT_EQ(closed_, 1);
}

TEST_F(SessionTest, AfterAFailedCommitNothingMoreIsKept) {
  const test::CapturedLog log;
  sink_->holds_commits = true;
  make({sink_});
  write(0);
  sink_->answer();
  sink_->answer_commit(Error{"sync: Input/output error"});
  write(1);
  sink_->answer();
  EXPECT_EQ(peer_->kept, 1) << "with the reason";
  EXPECT_EQ(session_->pause(), "sync: Input/output error");
  EXPECT_EQ(session_->kept(), wire::Position{});
  EXPECT_EQ(session_->received(), 0U);  // the robot shall keep the rest
  EXPECT_EQ(log.lines("error robot session: stream paused: sync").size(), 1U);
  EXPECT_EQ(log.lines("stream resumed").size(), 0U);
  session_->close(SessionEnd::kStopping);
  EXPECT_EQ(peer_->bye, wire::Position{});
}

TEST_F(SessionTest, ARepeatIsTakenButNotWrittenAgain) {
  make({sink_});
  write(4);
  sink_->answer();
  write(4);
  write(2);
  EXPECT_EQ(taken_, 1);  // never from within the call
  run_ready();
  EXPECT_EQ(taken_, 3);
  EXPECT_EQ(sink_->frames, Sequences{4});
}

TEST_F(SessionTest, ItemsThatAreKnownAreNotWrittenAgain) {
  make({sink_ = std::make_shared<FakeSink>(wire::Position{0, 2})});
  write_drops(2, 3);
  sink_->answer();
  write_drops(0, 2);
  write_drops(2, 3);
  EXPECT_EQ(taken_, 1);  // never from within the call
  run_ready();
  EXPECT_EQ(taken_, 3);
  EXPECT_EQ(sink_->items, std::vector<std::uint64_t>{2});
  EXPECT_EQ(session_->position(), (wire::Position{0, 5}));
}

TEST_F(SessionTest, AGapInTheItemsIsAWarning) {
  const test::CapturedLog log;
  make({sink_});
  write_drops(7, 1);
  sink_->answer();
  EXPECT_EQ(session_->position(), (wire::Position{0, 8}));
  write_drops(20, 1);  // told once in a while
  sink_->answer();
  EXPECT_EQ(session_->position(), (wire::Position{0, 21}));
  EXPECT_EQ(log.lines("did not come live").size(), 1U);
  EXPECT_EQ(log.lines("warning robot session: items 0 to 6 of stream 1 did not come live").size(),
            1U);
}

TEST_F(SessionTest, ItemsGoToTheSinksThatTakeThem) {
  const auto second = std::make_shared<FakeSink>();
  const auto third = std::make_shared<FakeSink>();
  second->wants_items = false;
  make({sink_, second, third});
  write_drops(0, 1);
  sink_->answer();
  EXPECT_EQ(taken_, 0);
  third->answer();
  EXPECT_EQ(taken_, 1);
  EXPECT_TRUE(second->items.empty());
  EXPECT_EQ(session_->kept(), (wire::Position{0, 1}));
}

TEST_F(SessionTest, ItemsThatNoSinkTakesAreAcknowledged) {
  sink_->wants_items = false;
  make({sink_});
  write_drops(0, 2);
  EXPECT_EQ(taken_, 0);  // never from within the call
  run_ready();
  EXPECT_EQ(taken_, 1);
  EXPECT_EQ(session_->kept(), (wire::Position{0, 2}));
  EXPECT_GE(peer_->kept, 1);
}

TEST_F(SessionTest, AFailingSinkHoldsTheStreamAndIsLoggedOnceEachWay) {
  const test::CapturedLog log;
  make({sink_});
  write(0);
  sink_->answer(Error{"no space"});
  ASSERT_TRUE(run_until_busy(*sink_));
  sink_->answer(Error{"no space"});
  ASSERT_TRUE(run_until_busy(*sink_));
  EXPECT_EQ(taken_, 0);
  EXPECT_EQ(peer_->kept, 2) << "the robot is to know that the server lives";
  EXPECT_EQ(session_->kept(), wire::Position{});
  EXPECT_EQ(session_->pause(), "no space");
  sink_->answer();
  EXPECT_EQ(session_->pause(), "");
  EXPECT_EQ(taken_, 1);
  EXPECT_EQ(sink_->frames, (Sequences{0, 0, 0}));
  EXPECT_EQ(log.lines("error robot session: stream paused: no space").size(), 1U);
  EXPECT_EQ(log.lines("info robot session: stream resumed").size(), 1U);
}

TEST_F(SessionTest, ASinkThatHasTheFrameIsNotGivenItAgain) {
  const auto second = std::make_shared<FakeSink>();
  make({sink_, second});
  write(0);
  sink_->answer();
  second->answer(Error{"broken"});
  ASSERT_TRUE(run_until_busy(*second));
  second->answer();
  EXPECT_EQ(taken_, 1);
  EXPECT_EQ(sink_->frames, Sequences{0});
  EXPECT_EQ(second->frames, (Sequences{0, 0}));
}

TEST_F(SessionTest, ANewConnectionIsWelcomedWhenTheSinkIsDone) {
  make({sink_});
  write(0);
  const auto second = std::make_shared<FakePeer>();
  session_->attach(second);
  EXPECT_TRUE(peer_->is_replaced);
  EXPECT_TRUE(sink_->is_cancelled);
  EXPECT_FALSE(second->welcome);
  sink_->answer();
  EXPECT_EQ(second->welcome, (wire::Position{1, 0}));
  EXPECT_EQ(taken_, 0);  // the one that waited has gone
}

TEST_F(SessionTest, AFrameThatNoSinkTookIsTheRobotsAgainAfterAHandover) {
  make({sink_});
  write(0);
  const auto second = std::make_shared<FakePeer>();
  session_->attach(second);
  sink_->answer(Error{"nobody reads"});
  EXPECT_EQ(second->welcome, wire::Position{});
  write(3);
  sink_->answer();
  EXPECT_EQ(session_->position()[wire::kFrames], 4U);
}

TEST_F(SessionTest, AFrameWaitingForItsNextTryIsGivenUpAtOnce) {
  make({sink_});
  write(0);
  sink_->answer(Error{"no space"});
  const auto second = std::make_shared<FakePeer>();
  session_->attach(second);
  EXPECT_EQ(second->welcome, wire::Position{});
}

TEST_F(SessionTest, AFrameThatOneSinkTookGoesToTheOthersBeforeTheHandover) {
  const auto second_sink = std::make_shared<FakeSink>();
  make({sink_, second_sink});
  write(0);
  sink_->answer();
  second_sink->answer(Error{"broken"});
  const auto second = std::make_shared<FakePeer>();
  session_->attach(second);
  EXPECT_FALSE(second->welcome);
  ASSERT_TRUE(run_until_busy(*second_sink));
  second_sink->answer();
  EXPECT_EQ(second->welcome, (wire::Position{1, 0}));
}

TEST_F(SessionTest, AReplacedConnectionThatGoesLaterDoesNoHarm) {
  make({sink_});
  const auto second = std::make_shared<FakePeer>();
  session_->attach(second);
  session_->detach(*peer_);
  session_->close(SessionEnd::kStopping);
  EXPECT_EQ(second->bye, wire::Position{});
}

TEST_F(SessionTest, ClosesWhenNobodyComesBack) {
  make({sink_}, std::chrono::milliseconds(10));
  session_->detach(*peer_);
  ASSERT_TRUE(run_until([this] { return closed_ == 1; }));
  EXPECT_TRUE(sink_->is_closed);
  EXPECT_FALSE(peer_->bye);
}

TEST_F(SessionTest, AByeClosesTheSinksAndIsAnswered) {
  make({sink_});
  write(0);
  sink_->answer();
  session_->close(SessionEnd::kBye);
  EXPECT_TRUE(sink_->is_closed);
  EXPECT_EQ(peer_->bye, (wire::Position{1, 0}));
  EXPECT_EQ(closed_, 1);
}

TEST_F(SessionTest, StoppingLetsAWriteInProgressFinish) {
  make({sink_});
  write(0);
  session_->close(SessionEnd::kStopping);
  EXPECT_TRUE(sink_->is_cancelled);
  EXPECT_FALSE(peer_->bye);
  sink_->answer();
  EXPECT_EQ(peer_->bye, (wire::Position{1, 0}));
  EXPECT_EQ(closed_, 1);
}

TEST_F(SessionTest, AByeIsAnsweredWhenAllSinksAreDrained) {
  const auto second = std::make_shared<FakeSink>();
  sink_->is_draining = second->is_draining = true;
  make({sink_, second});
  session_->close(SessionEnd::kBye);
  sink_->drain();
  EXPECT_FALSE(peer_->bye);
  EXPECT_FALSE(sink_->is_closed);
  second->drain();
  EXPECT_TRUE(sink_->is_closed && second->is_closed);
  EXPECT_TRUE(peer_->bye);
  EXPECT_EQ(closed_, 1);
}

TEST_F(SessionTest, ASinkThatNeverDrainsIsClosedInTheEnd) {
  sink_->is_draining = true;
  make({sink_});
  session_->close(SessionEnd::kBye);
  ASSERT_TRUE(run_until([this] { return closed_ == 1; }));
  EXPECT_TRUE(sink_->is_closed);
  EXPECT_TRUE(peer_->bye);
}

TEST_F(SessionTest, AnEndThatCannotBeRecordedIsTriedAgainBeforeTheBye) {
  const test::CapturedLog log;
  sink_->is_draining = true;
  make({sink_});
  session_->on_bye({});
  session_->close(SessionEnd::kBye);
  for (int tries = 1; tries <= 4; ++tries) {  // beyond the time to drain
    ASSERT_TRUE(run_until([&] { return sink_->drains == tries; }));
    sink_->drain(Error{"the disk is full"});
    EXPECT_FALSE(peer_->bye);
    EXPECT_EQ(failures_, tries);
  }
  ASSERT_TRUE(run_until([&] { return sink_->drains == 5; }));
  EXPECT_TRUE(sink_->closing->has_ended);
  sink_->drain();
  EXPECT_TRUE(peer_->bye);
  EXPECT_EQ(closed_, 1);
  EXPECT_EQ(log.lines("stream paused: the disk is full").size(), 1U);
  EXPECT_EQ(log.lines("stream resumed").size(), 1U);
}

TEST_F(SessionTest, AServerThatStopsGivesUpAnEndThatCannotBeRecorded) {
  sink_->is_draining = true;
  make({sink_});
  session_->on_bye({});
  session_->close(SessionEnd::kBye);
  session_->close(SessionEnd::kStopping);
  while (closed_ == 0) {
    const int tries = sink_->drains;
    sink_->drain(Error{"the disk is full"});
    ASSERT_TRUE(run_until([&] { return closed_ == 1 || sink_->drains > tries; }));
  }
  EXPECT_FALSE(peer_->bye);
  EXPECT_TRUE(peer_->is_end_lost);
}

TEST_F(SessionTest, StoppingDoesNotWaitForeverForAStuckSink) {
  make({sink_});
  write(0);
  session_->close(SessionEnd::kStopping);
  ASSERT_TRUE(run_until([this] { return sink_->is_closed; }));
  sink_->answer(Error{"closed"});
  EXPECT_EQ(peer_->bye, wire::Position{});
  EXPECT_EQ(closed_, 1);
}

}  // namespace
}  // namespace orbbuf
