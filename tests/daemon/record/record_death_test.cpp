// SPDX-License-Identifier: Apache-2.0
// Real deaths of a process that records, and power cuts as the file shows them. What the next start
// says of each session is compared with what the journal had by then.
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <thread>

#include "tests/daemon/record/record_fixture.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;
using record_format::Bytes;

/// What a journal says of its sessions, read in the simplest way.
struct Told {
  Sequence captured = 0;
  std::set<Sequence> given_up;  // ever
  std::set<Sequence> kept;
  std::set<Sequence> released;

  std::set<Sequence> held() const {
    std::set<Sequence> held;
    std::ranges::set_difference(kept, released, std::inserter(held, held.end()));
    return held;
  }
};
using ToldSessions = std::map<std::string, Told>;

void tell(ToldSessions& sessions, const journal::Record& record) {
  const auto take = [&](wire::Reader& in) {
    DropRanges drops;
    const auto account = record_format::take_account(in, drops);
    Told& told = sessions[account->name];
    told.captured = std::max(told.captured, account->captured);
    for (const auto& [first, range] : drops.by_number()) {
      for (Sequence i = first; i < range.end(); ++i) told.given_up.insert(i);
    }
  };
  wire::Reader in(record.body);
  if (record.type == record_format::kAccount) take(in);
  if (record.type == journal::kCheckpoint) {
    in.take<std::uint8_t>();
    for (auto count = in.take<std::uint32_t>(); count > 0; --count) take(in);
  }
  if (record.type == record_format::kFrame) {
    const auto frame = record_format::parse_frame(record.body);
    Told& told = sessions[frame->first];
    told.kept.insert(frame->second.sequence);
    told.captured = std::max(told.captured, frame->second.sequence + 1);
  }
  if (record.type == record_format::kReleased) {
    const auto released = record_format::parse_released(record.body);
    sessions[released->first].released.insert(released->second.begin(), released->second.end());
  }
}

ToldSessions read_told(const fs::path& folder) {
  ToldSessions sessions;
  journal::Reader reader(folder);
  for (auto record = reader.next(); record && record.value(); record = reader.next()) {
    tell(sessions, *record.value());
  }
  return sessions;
}

/// A process that records in a way of its own until it is killed.
class RecordingProcess {
 public:
  RecordingProcess(const RecordSettings& settings, const std::string& session_id,
                   const std::function<void(WatchedRecord&)>& body)
      : folder_(settings.path), name_("robot/" + session_id), pid_(::fork()) {
    if (pid_ != 0) return;
    WatchedRecord record(settings, session_id);
    body(record);
    for (;;) ::pause();
  }
  ~RecordingProcess() { kill(); }
  RecordingProcess(const RecordingProcess&) = delete;
  RecordingProcess& operator=(const RecordingProcess&) = delete;

  /// Until the journal says that so many frames were captured.
  void wait_for(Sequence captured) const {
    ToldSessions sessions;
    journal::Reader reader(folder_);
    while (sessions[name_].captured < captured) {
      const auto record = reader.next();
      if (record && record.value()) {
        tell(sessions, *record.value());
      } else {
        std::this_thread::yield();
      }
    }
  }
  void kill() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(std::exchange(pid_, -1), nullptr, 0);
  }

 private:
  const fs::path folder_;
  const std::string name_;
  pid_t pid_;
};

class RecordDeathTest : public RecordTest {
 protected:
  /// What a next start in `folder` says is what the journal in `origin` said.
  void expect_told(const RecordSettings& settings, const ToldSessions& sessions) {
    WatchedRecord next(settings, "next");
    std::uint64_t held = 0;
    for (const auto& [name, told] : sessions) {
      if (told.captured == 0) continue;
      const auto id = name.substr(name.find('/') + 1);
      next->rewind();
      const auto account = next.account_of(id);
      ASSERT_TRUE(account) << id;
      EXPECT_TRUE(account->is_final);
      EXPECT_EQ(account->captured, told.captured) << id;
      EXPECT_EQ(account->held, told.held().size()) << id;
      std::set<Sequence> given_up;
      for (const DropRecord& record : account->given_up) {
        for (Sequence i = record.sequence; i < record.end(); ++i) given_up.insert(i);
      }
      EXPECT_TRUE(std::ranges::includes(told.given_up, given_up));
      for (const Sequence i : told.given_up) {
        EXPECT_TRUE(given_up.contains(i) || i < account->confirmed) << id << " " << i;
      }
      held += told.held().size();
    }
    ToldSessions taken;
    for (const auto& late : next.take_frames(held)) {
      taken["robot/" + late.session_id].kept.insert(late.frame->sequence);
      EXPECT_TRUE(
          is_same(*late.frame, *kept_frame(late.frame->sequence, size(late.frame->sequence))));
    }
    EXPECT_FALSE(next->next());
    for (const auto& [name, told] : sessions) EXPECT_EQ(taken[name].kept, told.held()) << name;
  }
  static std::size_t size(Sequence sequence) { return 1 + sequence * 7919 % 5000; }

  /// Some seconds of an outage: frames are given up, kept and released.
  static void record_seconds(WatchedRecord& record, Sequence seconds) {
    for (Sequence second = 0; second < seconds; ++second) {
      for (Sequence i = second * 8; i < second * 8 + 8; ++i) {
        if (i % 3 == 0) record->give_up(std::vector{drop(i)});
        if (i % 2 == 0) record->keep(kept_frame(i, size(i)));
        if (i % 10 == 4) record->release(i - 4);
      }
      record->note(progress(second * 8 + 8, second * 2));
      record.wait_until([&] { return record->next().has_value(); });  // so it was written
      if (second % 4 == 3) record->remove(record.next().id);
    }
  }
};

TEST_F(RecordDeathTest, AfterAKillANextStartTellsAllThatWasWritten) {
  for (const Sequence captured : {1U, 50U, 400U}) {
    RecordingProcess process(settings(), "killed-" + std::to_string(captured),
                             [](WatchedRecord& record) { record_seconds(record, 1000); });
    process.wait_for(captured);
  }
  const auto told = read_told(path());
  EXPECT_EQ(told.size(), 3U);
  expect_told(settings(), told);
}

/// With small segments, so that the indexes of complete ones and removed ones take part.
TEST_F(RecordDeathTest, AfterAKillInALaterSegmentAsWell) {
  const auto small = settings(RecordSettings::kMinBytes);
  RecordingProcess process(small, "killed", [](WatchedRecord& record) {
    for (Sequence i = 0; i < 800; ++i) {
      record->keep(kept_frame(i, size(i)));
      record->note(progress(i + 1));
      if (i % 2 == 0) record->remove(record.next().id);
    }
    record->keep(kept_frame(800, size(800)));
  });
  process.wait_for(801);
  process.kill();
  EXPECT_GT(segments().size(), 1U);
  expect_told(small, read_told(path()));
}

/// A power cut may cut the file anywhere.
TEST_F(RecordDeathTest, ACutAnywhereCostsWhatIsBehindIt) {
  {
    WatchedRecord record(settings(), "cut");
    record_seconds(record, 12);
  }
  const auto whole = read_file(segment(0));
  std::vector<std::uint64_t> cuts;
  journal::Reader reader(path());
  for (auto record = reader.next(); record && record.value(); record = reader.next()) {
    const auto begin = record.value()->place.offset;
    for (const auto at : {begin, begin + 1, begin + 12, record.value()->end.offset - 1}) {
      cuts.push_back(at);
    }
  }
  ASSERT_GT(cuts.size(), 4 * 40U);
  std::filesystem::remove_all(path());
  for (const auto cut : cuts) {
    SCOPED_TRACE(cut);
    const fs::path copy = folder_ / ("cut-" + std::to_string(cut));
    fs::create_directories(copy);
    write_file(journal::segment_path(copy, 0), whole.substr(0, cut));
    RecordSettings cut_settings = settings();
    cut_settings.path = copy;
    expect_told(cut_settings, read_told(copy));
    fs::remove_all(copy);
  }
}

/// A bad bit costs the record that it is in.
TEST_F(RecordDeathTest, ABadBitAnywhereCostsOneRecord) {
  {
    WatchedRecord record(settings(), "bad");
    record_seconds(record, 4);
  }
  const auto good = read_file(segment(0));
  for (std::size_t at = 0; at < good.size(); at += 131) {
    SCOPED_TRACE(at);
    auto bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    fs::remove_all(path());
    fs::create_directories(path());
    write_file(segment(0), bad);
    expect_told(settings(), read_told(path()));
  }
}

/// Also of sessions of which nothing but the checkpoints tells.
TEST_F(RecordDeathTest, ABadBitInTheHeadOfTheNewestSegmentCostsNoSession) {
  const auto small = settings(RecordSettings::kMinBytes);
  { WatchedRecord(small, "earlier")->note(progress(7)); }
  {
    WatchedRecord record(small, "later");
    for (Sequence i = 0; i < 60; ++i) {
      record.keep(i, i + 1, 200'000);
      record.deliver(1);
      record->note(progress(i + 1));
    }
    while (segments().front() == 0) std::this_thread::yield();
  }
  const auto newest = segment(segments().back());
  const auto good = read_file(newest);
  for (std::size_t bit = 0; bit < journal::kHeadBytes * 8; ++bit) {
    auto bad = good;
    bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << bit % 8));
    write_file(newest, bad);
    WatchedRecord record(small, "next-" + std::to_string(bit));
    const auto account = record.account_of("earlier");
    ASSERT_TRUE(account) << bit;
    EXPECT_EQ(account->captured, 7U);
    record->rewind();
    EXPECT_EQ(record.account_of("later")->captured, 60U);
  }
}

/// 3.5 hours at 25 frames a second.
TEST_F(RecordDeathTest, AfterALongOutageEachFrameIsStillNamed) {
  constexpr Sequence kFrames = 331'020;
  RecordingProcess process(without_frames(), "outage", [](WatchedRecord& record) {
    for (Sequence captured = 0; captured < kFrames;) {
      std::vector<DropRecord> drops;
      for (int i = 0; i < 1000 && captured < kFrames; ++i, ++captured) {
        if (captured % 300 != 299) drops.push_back(drop(captured));
      }
      record->give_up(drops);
      record->note(progress(captured, 0));
    }
  });
  process.wait_for(kFrames);
  process.kill();
  WatchedRecord next(without_frames(), "next");
  const auto account = next.account_of("outage");
  ASSERT_TRUE(account);
  EXPECT_EQ(account->captured, kFrames);
  Sequence number = 0;
  for (const DropRecord& record : account->given_up) {
    if (number % 300 == 299) ++number;  // that one waited
    ASSERT_EQ(record.sequence, number);
    EXPECT_NEAR(static_cast<double>(record.capture_time_of(record.end() - 1)),
                static_cast<double>(capture_time(record.end() - 1)), 1e3);
    number = record.end();
  }
  EXPECT_EQ(number, kFrames);
}

TEST_F(RecordDeathTest, OfManyStartsWithoutAServerEachIsTold) {
  constexpr Sequence kStarts = 26;
  for (Sequence start = 1; start <= kStarts; ++start) {
    RecordingProcess process(start % 2 == 0 ? settings() : without_frames(),
                             "start-" + std::to_string(start), [start](WatchedRecord& record) {
                               record->give_up(std::vector{drop(start)});
                               record->note(progress(start + 1));  // a frame says it as well
                               record->keep(kept_frame(start, size(start)));
                               record->set_live_from(0);
                             });
    process.wait_for(start + 1);
  }
  WatchedRecord next(settings(), "next");
  for (Sequence start = 1; start <= kStarts; ++start) {
    next->rewind();
    const auto account = next.account_of("start-" + std::to_string(start));
    ASSERT_TRUE(account) << start;
    EXPECT_EQ(account->captured, start + 1);
    EXPECT_EQ(account->given_up, std::vector{drop(start)});
  }
}

/// A session that no server ever knew: its frames come late, and its account says how many there
/// were.
TEST_F(RecordDeathTest, ADeathBeforeTheFirstContactIsToldWithTheTotal) {
  RecordingProcess process(settings(), "first", [](WatchedRecord& record) {
    record.keep(0, 80);
    record.take(80);
    record->note(progress(121));
  });
  process.wait_for(121);
  process.kill();
  WatchedRecord next(settings(), "next");
  const auto account = next.account_of("first");
  ASSERT_TRUE(account);
  EXPECT_TRUE(account->is_final);
  EXPECT_FALSE(account->has_ended);
  EXPECT_EQ(account->captured, 121U);
  EXPECT_EQ(account->held, 80U);
  EXPECT_EQ(next.take(80), numbers(0, 80));
}

/// 8 GiB in 512 segments, of which only the indexes are read: the frames are holes in the files.
TEST_F(RecordDeathTest, AStartReadsLittleOfEachSegment) {
  constexpr std::uint32_t kSegments = 512;
  constexpr Sequence kFrames = 400;  // in each
  fs::create_directories(path());
  RecordState state("robot", "large");
  state.begin();
  state.note(progress(kFrames * kSegments));
  for (std::uint32_t number = 0; number <= kSegments; ++number) {
    journal::Writer begin(path(), ~std::uint64_t{0}, false, [&] { return state.checkpoint(); });
    ASSERT_FALSE(begin.open({number, 0}));
    ASSERT_TRUE(begin.append(record_format::kReleased, {record_format::encode_released("", {})}));
    if (number == kSegments) break;
    record_format::Index index;
    for (Sequence i = 0; i < kFrames; ++i) {
      index["robot/large"].kept.push_back({number * kFrames + i, number, 1000, 40'000});
    }
    const auto bytes = record_format::encode(index);
    EXPECT_LT(bytes.size(), 8000U);
    fs::resize_file(segment(number), Record::kFrameSegmentBytes);
    journal::Writer end(path(), ~std::uint64_t{0}, false, nullptr);
    ASSERT_FALSE(end.open({number, Record::kFrameSegmentBytes}));
    ASSERT_TRUE(end.append(record_format::kIndex, {bytes}));
  }
  const auto begin = std::chrono::steady_clock::now();
  WatchedRecord record(settings(9ULL << 30), "next");
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  EXPECT_EQ(record->stats().held, kFrames * kSegments);
  EXPECT_EQ(record.account_of("large")->captured, kFrames * kSegments);
  RecordProperty("seconds", std::to_string(took.count()));
}

}  // namespace
}  // namespace orbbuf::test
