// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/segment_queue.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <utility>

#include "tests/daemon/spool/spool_fixture.hpp"

namespace orbbuf::test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

using Lost = SegmentQueue::Lost;

/// A queue with what its user does: files of records, which it loads and reads.
class Files {
 public:
  SegmentQueue queue{"now"};

  /// A segment of an earlier session.
  void add(std::uint64_t number, const std::string& session_id, std::vector<Sequence> sequences,
           std::uint64_t freed_below = 0) {
    FrameRange range;
    for (const Sequence sequence : sequences) {
      files_[number].push_back(record(number, sequence));
      range.add(sequence);
    }
    queue.add_complete({"robot", session_id, number}, 1000, range, freed_below);
  }
  void begin(std::uint64_t number) {
    number_ = number;
    files_[number];
    queue.begin(number, 10);
  }
  void write(Sequence sequence, bool is_forgotten = false) {
    files_[number_].push_back(record(number_, sequence));
    queue.add_record(files_[number_].back(), is_forgotten);
  }
  /// Loads and reads until there is nothing to do.
  void read(std::size_t ahead = 2) {
    for (;;) {
      if (const auto number = queue.to_load()) {
        queue.load(*number, files_[*number]);
        continue;
      }
      if (queue.ready() >= ahead) return;
      const auto place = queue.to_read();
      if (!place && queue.to_load()) continue;
      if (!place) return;
      queue.put(*place, bad.contains(place->record.sequence)
                            ? nullptr
                            : spool_frame(place->record.sequence, 1));
    }
  }
  std::optional<Sequence> next() {
    read();
    const auto frame = queue.next();
    return frame ? std::optional(frame->frame->sequence) : std::nullopt;
  }
  std::vector<Sequence> take(std::size_t count) {
    std::vector<Sequence> taken;
    for (std::optional<Sequence> sequence; taken.size() < count && (sequence = next());) {
      taken.push_back(*sequence);
    }
    return taken;
  }

  std::set<Sequence> bad;  // that cannot be read

 private:
  SegmentRecord record(std::uint64_t number, Sequence sequence) {
    const auto& before = files_[number];
    return {before.empty() ? 10 : before.back().end(), 1, sequence};
  }

  std::map<std::uint64_t, std::vector<SegmentRecord>> files_;
  std::uint64_t number_ = 0;  // that is written
};

TEST(SegmentQueue, AnEmptyOneHasNothingToDo) {
  Files files;
  EXPECT_FALSE(files.queue.to_load());
  EXPECT_FALSE(files.queue.to_read());
  EXPECT_FALSE(files.queue.next());
  EXPECT_FALSE(files.queue.take_finished());
  EXPECT_FALSE(files.queue.evict());
  EXPECT_FALSE(files.queue.evict_frames());
  EXPECT_THAT(files.queue.held(), IsEmpty());
  EXPECT_EQ(files.queue.frames(), 0U);
  EXPECT_EQ(files.queue.bytes(), 0U);
  EXPECT_EQ(files.queue.cursor(), (SpoolCursor{0, std::numeric_limits<std::uint64_t>::max()}));
  files.queue.acknowledge(5);
  files.queue.forget(5);
  EXPECT_THAT(files.queue.rewind(), IsEmpty());
}

TEST(SegmentQueue, OneRecordGoesThroughAllItsStates) {
  Files files;
  files.begin(3);
  EXPECT_FALSE(files.next());
  files.write(8);
  EXPECT_EQ(files.queue.cursor(), (SpoolCursor{3, 10}));
  files.read();
  EXPECT_EQ(files.queue.ready(), 1U);
  EXPECT_EQ(files.next(), 8U);
  EXPECT_EQ(files.queue.ready(), 0U);
  EXPECT_FALSE(files.next());
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"now", {1, 8, 8}}));
  files.queue.acknowledge(1);
  EXPECT_THAT(files.queue.held(), IsEmpty());
  EXPECT_EQ(files.queue.cursor(), (SpoolCursor{3, 10 + kRecordHeadBytes + 1}));
  EXPECT_FALSE(files.queue.take_finished());
  files.queue.complete(500);
  EXPECT_EQ(files.queue.bytes(), 500U);
  EXPECT_EQ(files.queue.take_finished(), 3U);
  EXPECT_EQ(files.queue.cursor(), (SpoolCursor{3, std::numeric_limits<std::uint64_t>::max()}));
}

TEST(SegmentQueue, WhatWasFreedBeforeIsNotHeldOnceTheIndexIsLoaded) {
  Files files;
  files.add(5, "old", {1, 2, 3}, 10 + kRecordHeadBytes + 1);
  files.add(6, "old", {4, 5});
  EXPECT_EQ(files.queue.to_load(), 5U);
  files.read();
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"old", {4, 2, 5}}));
  EXPECT_THAT(files.take(9), ElementsAre(2, 3, 4, 5));
}

TEST(SegmentQueue, AFullyFreedSegmentIsFinished) {
  Files files;
  files.add(5, "old", {1, 2, 3}, 10'000);
  files.add(6, "old", {4, 5});
  files.read();
  EXPECT_EQ(files.queue.take_finished(), 5U);
  EXPECT_THAT(files.take(9), ElementsAre(4, 5));
}

TEST(SegmentQueue, LoadSaysHowManyRecordsAreMissing) {
  Files files;
  files.add(5, "old", {1, 2, 3});
  EXPECT_EQ(files.queue.load(5, {{10, 1, 1}}), 2U);
  EXPECT_EQ(files.queue.load(5, {}), 0U);  // it is loaded
  EXPECT_EQ(files.queue.load(9, {}), 0U);
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"old", {1, 1, 1}}));
}

TEST(SegmentQueue, ForgottenFramesAreGoneInEveryState) {
  Files files;
  files.begin(1);
  for (Sequence sequence = 0; sequence < 6; ++sequence) files.write(sequence, sequence == 5);
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"now", {5, 0, 4}}));
  EXPECT_EQ(files.next(), 0U);
  files.read();            // 1 and 2
  files.queue.forget(0);   // handed out
  files.queue.forget(1);   // read ahead
  files.queue.forget(3);   // on the disk only
  files.queue.forget(3);   // once more
  files.queue.forget(77);  // never there
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"now", {2, 2, 4}}));
  EXPECT_THAT(files.take(9), ElementsAre(2, 4));
  files.queue.rewind();
  EXPECT_THAT(files.take(9), ElementsAre(2, 4));
}

TEST(SegmentQueue, FramesOfASegmentThatIsNotLoadedAreForgottenWhenItIs) {
  Files files;
  files.add(1, "old", {0, 1, 2});
  files.begin(2);
  for (const Sequence sequence : {10U, 12U, 14U}) files.write(sequence);
  files.queue.complete(100);
  files.queue.forget(12);
  files.queue.forget(13);
  EXPECT_EQ(files.queue.frames(), 6U);
  files.read();
  EXPECT_EQ(files.queue.frames(), 5U);
  files.queue.forget(12);
  files.read();
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"old", {3, 0, 2}}, Lost{"now", {2, 10, 14}}));
  EXPECT_THAT(files.take(9), ElementsAre(0, 1, 2, 10, 14));
}

TEST(SegmentQueue, OneIndexStaysLoadedForWhatIsForgottenNext) {
  Files files;
  files.add(1, "old", {0});
  for (std::uint64_t number = 2; number <= 3; ++number) {
    files.begin(number);
    for (Sequence sequence = 0; sequence < 3; ++sequence) files.write(10 * number + sequence);
    files.queue.complete(100);
  }
  files.read(1);
  files.queue.forget(20);
  EXPECT_EQ(files.queue.to_load(), 2U);
  files.read(1);
  files.queue.forget(21);
  EXPECT_FALSE(files.queue.to_load());
  EXPECT_EQ(files.queue.frames(), 5U);
  files.queue.forget(30);
  EXPECT_EQ(files.queue.to_load(), 3U);
  files.read(1);
  files.queue.forget(22);
  EXPECT_EQ(files.queue.to_load(), 2U);
  files.read(1);
  EXPECT_EQ(files.queue.take_finished(), 2U);
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"old", {1, 0, 0}}, Lost{"now", {2, 31, 32}}));
}

TEST(SegmentQueue, ASegmentInWhichAllIsForgottenIsFinished) {
  Files files;
  files.add(1, "old", {0});
  files.begin(2);
  files.write(10);
  files.queue.complete(100);
  files.queue.forget(10);
  files.read();
  EXPECT_EQ(files.queue.take_finished(), 2U);
}

TEST(SegmentQueue, AReadThatARewindOvertookIsDiscarded) {
  Files files;
  files.begin(1);
  files.write(0);
  files.write(1);
  EXPECT_EQ(files.next(), 0U);
  files.queue.rewind();
  const auto place = files.queue.to_read();
  ASSERT_TRUE(place);
  EXPECT_EQ(place->record.sequence, 0U);
  files.queue.rewind();
  EXPECT_TRUE(files.queue.put(*place, spool_frame(0)));
  EXPECT_EQ(files.queue.ready(), 0U);
  EXPECT_THAT(files.take(9), ElementsAre(0, 1));
}

TEST(SegmentQueue, ADamagedRecordIsSkippedOnce) {
  Files files;
  files.begin(1);
  for (Sequence sequence = 0; sequence < 3; ++sequence) files.write(sequence);
  files.queue.next();
  files.bad = {1};
  EXPECT_THAT(files.take(9), ElementsAre(0, 2));
  EXPECT_EQ(files.queue.frames(), 2U);
  files.bad = {};
  files.queue.rewind();
  EXPECT_THAT(files.take(9), ElementsAre(0, 2));
}

TEST(SegmentQueue, EvictionTakesOtherRobotsFirstAndNeverTheOneThatIsWritten) {
  Files files;
  files.add(1, "old", {0, 1});
  files.queue.add_foreign(2, 700);
  files.begin(3);
  files.write(5);
  EXPECT_EQ(files.queue.bytes(), 1000 + 700 + 10 + kRecordHeadBytes + 1);
  auto evicted = files.queue.evict();
  ASSERT_TRUE(evicted);
  EXPECT_EQ(evicted->number, 2U);
  EXPECT_EQ(evicted->lost.range.frames, 0U);
  evicted = files.queue.evict();
  ASSERT_TRUE(evicted);
  EXPECT_EQ(evicted->number, 1U);
  EXPECT_TRUE(evicted->lost == (Lost{"old", {2, 0, 1}}));
  EXPECT_FALSE(files.queue.evict());
  EXPECT_THAT(files.take(9), ElementsAre(5));
}

TEST(SegmentQueue, FramesHandedOutAreLostOnlyIfTheyComeBack) {
  Files files;
  files.add(1, "old", {0, 1, 2, 3, 4, 5});
  files.add(2, "old", {6});
  EXPECT_THAT(files.take(4), ElementsAre(0, 1, 2, 3));
  files.queue.acknowledge(1);
  files.read();  // 4 and 5
  EXPECT_TRUE(files.queue.evict()->lost == (Lost{"old", {2, 4, 5}}));
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"old", {4, 1, 6}}));
  EXPECT_EQ(files.next(), 6U);
  files.queue.acknowledge(1);
  EXPECT_THAT(files.queue.held(), ElementsAre(Lost{"old", {3, 2, 6}}));
  EXPECT_THAT(files.queue.rewind(), ElementsAre(Lost{"old", {2, 2, 3}}));
  EXPECT_THAT(files.take(9), ElementsAre(6));
}

/// All that a queue may do, compared with lists that keep every record.
class Model {
 public:
  explicit Model(unsigned seed) : random_(seed) {
    const std::uint64_t segments = random_() % 4;
    for (std::uint64_t number = 1; number <= segments; ++number) {
      const std::string session = number < 3 ? "old" : "newer";
      std::vector<Sequence> sequences;
      for (std::uint64_t count = random_() % 5; count > 0; --count)
        sequences.push_back(next_sequence_++);
      files_.add(number, session, sequences);
      for (const Sequence sequence : sequences) records_.push_back({number, session, sequence});
    }
    next_number_ = segments + 1;
  }

  void step() {
    switch (random_() % 16) {
      case 0:
        return complete();
      case 1:
        return forget();
      case 2:
        return rewind();
      case 3:
        return evict();
      case 4:
        return finish();
      case 5:
        return acknowledge(random_() % 4);
      case 6:
      case 7:
      case 8:
        return take();
      case 9:
        files_.read();
        return;
      case 10:
        if (const auto place = files_.queue.to_read()) pending_read_ = place;
        return;
      default:
        return write();
    }
  }

  void check() {
    files_.read();
    std::map<std::string, FrameRange> held;
    for (const Record& record : records_) {
      const bool is_held = !record.is_gone || (record.is_handed_out && record.is_evicted);
      if (is_held) held[record.session].add(record.sequence);
    }
    std::map<std::string, FrameRange> found;
    std::uint64_t frames = 0;
    for (const auto& [session, range] : files_.queue.held()) {
      found[session] = range;
      frames += range.frames;
    }
    ASSERT_EQ(found, held);
    ASSERT_EQ(files_.queue.frames(), frames);
    ASSERT_EQ(lost_, found_lost_);
  }

  void drain() {
    while (const auto sequence = files_.next()) ASSERT_EQ(sequence, expect_next());
    ASSERT_FALSE(expect_next());
  }

 private:
  struct Record {
    std::uint64_t number;
    std::string session;
    Sequence sequence;
    bool is_gone = false;
    bool is_handed_out = false;
    bool is_evicted = false;
  };

  void write() {
    if (!is_open_) {
      files_.begin(number_ = next_number_++);
      is_open_ = true;
    }
    records_.push_back({number_, "now", next_sequence_});
    files_.write(next_sequence_++);
  }
  void complete() {
    if (!std::exchange(is_open_, false)) return;
    files_.queue.complete(1000);
  }
  void forget() {
    const Sequence sequence = random_() % (next_sequence_ + 3);
    files_.queue.forget(sequence);
    for (Record& record : records_) {
      if (record.sequence != sequence || record.session != "now") continue;
      record.is_gone = true;
      record.is_evicted = false;
    }
  }
  void take() {
    const auto sequence = files_.next();
    ASSERT_EQ(sequence, expect_next());
  }
  /// Marks it as handed out.
  std::optional<Sequence> expect_next() {
    for (Record& record : records_) {
      if (record.is_gone || record.is_handed_out) continue;
      record.is_handed_out = true;
      handed_out_.push_back(record.sequence);
      return record.sequence;
    }
    return std::nullopt;
  }
  void acknowledge(std::size_t count) {
    files_.queue.acknowledge(count);
    for (; count > 0 && !handed_out_.empty(); --count) {
      Record& record = *find(handed_out_.front());
      record.is_gone = true;
      record.is_handed_out = false;
      handed_out_.erase(handed_out_.begin());
    }
  }
  void rewind() {
    for (const auto& lost : files_.queue.rewind()) found_lost_ += lost.range.frames;
    for (const Sequence sequence : std::exchange(handed_out_, {})) {
      Record& record = *find(sequence);
      record.is_handed_out = false;
      if (record.is_evicted) ++lost_;
    }
    if (pending_read_)
      files_.queue.put(*std::exchange(pending_read_, std::nullopt), spool_frame(999'999'999, 1));
  }
  void evict() {
    files_.read();  // or what is to be forgotten counts as lost
    const auto evicted = files_.queue.evict();
    const std::uint64_t number = evicted ? evicted->number : 0;
    if (evicted) found_lost_ += evicted->lost.range.frames;
    for (Record& record : records_) {
      if (record.number != number || record.is_gone) continue;
      record.is_gone = true;
      record.is_evicted = record.is_handed_out;
      if (!record.is_handed_out) ++lost_;
    }
    pending_read_.reset();
  }
  void finish() {
    while (const auto number = files_.queue.take_finished()) {
      for (const Record& record : records_) ASSERT_TRUE(record.number != number || record.is_gone);
    }
  }
  std::vector<Record>::iterator find(Sequence sequence) {
    return std::find_if(records_.begin(), records_.end(),
                        [&](const Record& record) { return record.sequence == sequence; });
  }

  std::mt19937 random_;
  Files files_;
  std::vector<Record> records_;
  std::vector<Sequence> handed_out_;
  std::optional<SegmentQueue::Place> pending_read_;
  std::uint64_t number_ = 0;
  std::uint64_t next_number_ = 1;
  bool is_open_ = false;
  Sequence next_sequence_ = 0;
  std::uint64_t lost_ = 0;
  std::uint64_t found_lost_ = 0;
};

TEST(SegmentQueue, DoesAsListsOfAllRecordsDo) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Model model(seed);
    for (int step = 0; step < 500; ++step) {
      model.step();
      if (step % 10 == 0) model.check();
      if (testing::Test::HasFatalFailure()) return;
    }
    model.drain();
    model.check();
    if (testing::Test::HasFatalFailure()) return;
  }
}

}  // namespace
}  // namespace orbbuf::test
