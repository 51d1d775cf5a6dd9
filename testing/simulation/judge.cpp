// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/judge.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <set>

#include "common/crc32.hpp"
#include "common/file_io.hpp"
#include "server/dataset/check_session.hpp"
#include "server/dataset/join_session.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::simulation {
namespace {

namespace fs = std::filesystem;

/// What a robot's disk may not have yet (docs/promises.md), and a moment for a machine that was
/// frozen or slow.
constexpr double kYoungAtKill = 2.5;
constexpr double kYoungAtPowerCut = 3.5;
constexpr std::uint64_t kMostAttempts =
    16;  // a second: every 100 ms, and each way's first; of a server
constexpr std::uint64_t kMostReduced = 8;  // a frame has at least that part of its bytes
constexpr std::uint64_t kUsuallyReduced = 3;
constexpr std::uint64_t kMostInFlight = 32;        // if buffer.capacity counts frames
constexpr std::uint64_t kMostDropRecords = 16384;  // of one outage, beyond that neighbours join

constexpr Time kAlone = 8 * kSecond;  // an outage, if nothing else happens so long before or after
constexpr Time kLongWay = 250 * kMillisecond;  // beyond that a planner sees little of the link
constexpr double kTwoFrames = 50e3;            // bytes, of large images: so much is written at once
constexpr Time kStandsStill = kSecond;         // then a robot leaves a server
constexpr Time kIsPaused = 2 * kSecond;        // then a server has tried twice
constexpr double kLiveAgain = 1;               // link.live_again
constexpr double kLateness = 0.4;  // what a judge may not blame: a rounding, a repeated segment
constexpr double kTransit = 0.3;   // of a frame, beyond what it took before

/// A disk of that fault: a server sends its robots away.
bool takes_no_frames(FaultKind kind) {
  return kind == FaultKind::kFullDisk || kind == FaultKind::kFailingDisk;
}

double to_seconds(Time time) { return static_cast<double>(time) / 1e9; }

bool is_content(const fs::path& file, const std::string& expected) {
  const auto content = read_text(file);
  return content && content.value() == expected;
}

std::uint32_t crc_of(const std::string& bytes) {
  return crc32(std::span(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()));
}

class SessionJudge {
 public:
  SessionJudge(const Scenario& scenario, const Run& run, const SessionFacts& facts,
               Verdict& verdict)
      : scenario_(scenario),
        run_(run),
        facts_(facts),
        robot_(scenario.robots[static_cast<std::size_t>(facts.machine - 1)]),
        folder_((scenario.has_several() ? fs::path(world_folder) / "joined" : data_of(kServer)) /
                facts.id.data()),
        verdict_(verdict) {}

  void run() {
    ++verdict_.sessions;
    if (scenario_.has_several()) join();
    // What such a server loses of a session that is over nobody names.
    if (scenario_.sync != "ack" && facts_.ended < run_.server_power_cut()) return;
    find_old();
    verdict_.captured += surely_captured();
    // A server that dies between making the folder and the journal leaves the folder only.
    if (facts_.id[0] == '\0' || !fs::exists(folder_ / "journal.000000")) {
      if (old_ > 0) problem(fmt::format("{} frames, and the server knows nothing of it", old_));
      return;
    }
    const auto session = read_session(folder_);
    if (!session) {
      const bool may_be_empty = run_.server_power_cut() > facts_.began;
      if (old_ > 0 || facts_.acknowledged > 0 || !may_be_empty) problem(session.error().text);
      return;
    }
    take(session.value());
    account();
    check_accounts(session.value());
    check_live_again(session.value());
    if (!was_left()) compare_images(session.value());
    if (!was_left()) check_views();
    check_report();
  }

 private:
  void problem(const std::string& text) {
    verdict_.problems.push_back(fmt::format("robot{}, start {}, session {}: {}", facts_.machine,
                                            facts_.start, facts_.id.data(), text));
  }

  std::uint64_t surely_captured() const { return facts_.opened > 0 ? facts_.opened - 1 : 0; }

  bool has_died() const { return facts_.was_killed || facts_.lost_power; }

  /// After a power cut of the server no robot told it what it lacks, since it has no record, or
  /// died before that had the session: the server has not looked yet.
  bool was_left() const {
    const bool is_forgotten = !robot_.has_record() || (has_died() && old_ == 0);
    return is_forgotten && (!facts_.has_closed || facts_.left > 0) &&
           run_.server_power_cut() > facts_.began;
  }

  fs::path data_of(int server) const {
    return fs::path(world_folder) / folder_name(server) / "data" /
           fmt::format("robot{}", facts_.machine);
  }

  static bool has_journal(const fs::path& part) { return fs::exists(part / "journal.000000"); }

  /// As `orbbuf-server join` does with the paths of all servers.
  void join() {
    std::vector<fs::path> parts;
    if (facts_.id[0] == '\0') return;
    for (int i = 0; i < scenario_.servers; ++i) {
      const fs::path folder = data_of(scenario_.server(i)) / facts_.id.data();
      if (fs::exists(folder)) parts.push_back(folder);
    }
    fs::remove_all(folder_);
    if (std::ranges::none_of(parts, has_journal)) return;
    const auto joined = join_session(parts, folder_);
    if (!joined) return problem("join: " + joined.error().text);
    // A journal that no server has opened since its power cut may end in bytes that were not
    // synced.
    const bool may_be_torn = run_.server_power_cut() > facts_.began;
    for (const std::string& found : joined.value().problems) {
      if (may_be_torn && found.find(": journal: ") != std::string::npos) continue;
      problem("join: " + found);
    }
    for (const fs::path& part : parts) {
      if (has_journal(part)) check_part(part);
    }
  }

  /// What is in it belongs to it, once.
  void check_part(const fs::path& folder) {
    const auto session = read_session(folder);
    if (!session) return problem(session.error().text);
    std::set<std::uint64_t> there;
    for (const RecordedFrame& frame : session.value().frames) {
      if (is_live(frame)) live_.insert(frame.sequence);
      if (there.insert(frame.sequence).second) continue;
      problem(fmt::format("frame {} is twice in {}", frame.sequence, folder.string()));
    }
  }

  bool may_lose() const { return run_.server_power_cut() > 0 && scenario_.sync != "ack"; }

  /// What a sync of the server could not write is missing since its power cut.
  bool has_lost_bytes() const { return run_.has_bad_server_disk() && run_.server_power_cut() > 0; }

  bool has_trouble_with_disk() const {
    return run_.has_bad_disk(facts_.machine) || robot_.has_small_disk;
  }

  /// Frames that must be accounted for.
  void find_old() {
    old_ = surely_captured();
    // Without a record what it had not delivered when it ended is named nowhere.
    if (!robot_.has_record() && (facts_.left > 0 || !facts_.has_closed)) old_ = 0;
    if (facts_.began < run_.bad_disk_until(facts_.machine)) old_ = 0;
    if (!has_died() && facts_.stops < 2) return;  // the second one is obeyed at once
    double young = facts_.lost_power ? kYoungAtPowerCut : kYoungAtKill;
    for (const Fault& fault : scenario_.faults) {  // behind it much is captured at once
      const bool is_freeze = fault.kind == FaultKind::kFreeze && fault.machine == facts_.machine;
      if (!is_freeze || facts_.ended < fault.at) continue;
      if (facts_.ended < fault.at + fault.length + kAlone) young += to_seconds(fault.length);
    }
    const auto at_risk = static_cast<std::uint64_t>(std::ceil(young * facts_.fps)) + 1;
    old_ = old_ > at_risk ? old_ - at_risk : 0;
    if (!robot_.has_record()) old_ = 0;
  }

  /// A join does not tell of a frame that it was replaced.
  static bool is_live(const RecordedFrame& frame) { return !frame.is_late || frame.is_replacing; }

  void take(const RecordedSession& session) {
    for (const RecordedFrame& frame : session.frames) {
      if (!there_.insert(frame.sequence).second) {
        problem(fmt::format("frame {} is there twice", frame.sequence));
      }
      if (is_live(frame)) live_.insert(frame.sequence);
      if (frame.sequence >= facts_.opened) {
        problem(fmt::format("frame {} was never captured", frame.sequence));
      }
    }
    for (const DropRecord& drop : session.drops) {
      for (Sequence number = drop.sequence; number < drop.end(); ++number) {
        if (there_.contains(number)) problem(fmt::format("frame {} is there and named", number));
        if (!named_.emplace(number, drop.reason).second) {
          problem(fmt::format("frame {} is named twice", number));
        }
        if (number >= facts_.opened) {
          problem(fmt::format("frame {} is named and was never captured", number));
          break;
        }
      }
    }
    std::erase_if(live_, [this](std::uint64_t number) { return !there_.contains(number); });
    verdict_.delivered += there_.size();
    verdict_.named += named_.size();
    if (has_lost_bytes() || was_left()) return;
    for (const std::string& damage : session.problems) problem(damage);
  }

  void account() {
    std::uint64_t unnamed = 0, first = 0;
    for (std::uint64_t number = 0; number < surely_captured(); ++number) {
      if (there_.contains(number) || named_.contains(number)) continue;
      if (number >= old_) {
        ++verdict_.too_young;
      } else if (unnamed++ == 0) {
        first = number;
      }
    }
    if (unnamed > 0) {
      problem(fmt::format("of {} frames {} are neither there nor named, from {} on",
                          surely_captured(), unnamed, first));
    }
    if (facts_.acknowledged > live_.size() && !may_lose() && !has_lost_bytes()) {
      problem(fmt::format("{} were acknowledged, {} are there", facts_.acknowledged, live_.size()));
    }
    check_reasons();
    check_memory();
  }

  /// It could not deliver all in its last seconds, and there is no later start that tells of it.
  bool is_left_to_next_start() const {
    const auto later = world->sessions.begin() + (&facts_ - world->sessions.data()) + 1;
    return facts_.left > 0 && std::none_of(later, world->sessions.begin() + world->sessions_used,
                                           [this](const SessionFacts& other) {
                                             return other.machine == facts_.machine;
                                           });
  }

  /// A robot that has a record tells what became of its earlier sessions, as far as it knows.
  void check_accounts(const RecordedSession& session) {
    std::uint64_t alike = 0, most_alike = 0;
    for (std::size_t i = 1; i < session.drops.size(); ++i) {
      const DropRecord& before = session.drops[i - 1];
      const bool is_alike =
          before.end() == session.drops[i].sequence && before.reason == session.drops[i].reason;
      alike = is_alike ? alike + 1 : 0;
      most_alike = std::max(most_alike, alike);
    }
    if (most_alike > kMostDropRecords + kMostDropRecords / 8) {
      problem(fmt::format("{} drop records in a row could be one", most_alike));
    }
    if (!robot_.has_record() || facts_.began < run_.bad_disk_until(facts_.machine)) return;
    const SessionSummary& summary = session.summary;
    const bool is_told = summary.account && summary.account->is_final;
    if (old_ > 0 && !is_told && !summary.has_ended() && !is_left_to_next_start()) {
      problem("its end was never told");
    }
    if (!is_told) return;
    const std::uint64_t known = std::max(there_.empty() ? 0 : *there_.rbegin() + 1,
                                         named_.empty() ? 0 : named_.rbegin()->first + 1);
    for (std::uint64_t number = 0; number < known; ++number) {
      if (there_.contains(number) || named_.contains(number)) continue;
      return problem(
          fmt::format("frame {} is neither there nor named, and frame {} is", number, known - 1));
    }
  }

  /// After an outage that nothing else comes close to, a frame is soon as new as it was before.
  void check_live_again(const RecordedSession& session) {
    if (robot_.policy != "catch-up" || robot_.path.delay > kLongWay) return;
    const double queue = to_seconds(robot_.path.queue) * robot_.path.bytes_per_second;
    if (robot_.has_large_images && queue < kTwoFrames) return;
    for (const Fault& outage : scenario_.faults) {
      if (outage.length < kSecond || !is_alone(outage) || is_clock_wrong(outage)) continue;
      const Time end = outage.at + outage.length;
      if (outage.kind == FaultKind::kCut && outage.machine == facts_.machine) {
        check_live_again(session, outage, {end, end, "the link was back"});
      } else if (is_survived(outage)) {
        const Time left = outage.at + (takes_no_frames(outage.kind) ? kIsPaused : kStandsStill);
        check_live_again(session, outage, {outage.at, left, "a server was left"});
      }
    }
  }

  struct Return {
    Time first;  ///< frames that come from then on count
    Time back;   ///< from then on it has so much time
    std::string_view what;
  };
  void check_live_again(const RecordedSession& session, const Fault& outage, const Return& after) {
    if (facts_.began > outage.at - kAlone || facts_.ended < after.back + kAlone) return;
    const double attempts = std::clamp(to_seconds(outage.length) / 600, 0.13, 1.0);
    const double delay = to_seconds(robot_.path.delay);
    const double limit = kLiveAgain + attempts + 1 / facts_.fps + 7 * delay + kLateness;
    const Time usual = least_lateness(session, outage.at - kAlone, outage.at);
    if (usual == kNever) return;
    const Time most = usual + static_cast<Time>((kTransit + 1 / facts_.fps) * 1e9);
    Time soonest = kNever;
    for (const RecordedFrame& frame : session.frames) {
      // When a reduced one came that was replaced is not recorded: at the earliest then.
      const Time came =
          frame.is_replacing ? frame.capture_time_ns + usual : frame.arrived_ns - kWallBegin;
      const bool is_new = came - frame.capture_time_ns <= most;
      if (!is_live(frame) || came < after.first || !is_new) continue;
      soonest = std::min(soonest, came - after.back);
    }
    if (to_seconds(soonest) <= limit) return;
    problem(fmt::format("{} at {:.3f} s, and live {} s later: more than {:.2f} s", after.what,
                        to_seconds(after.back), soonest == kNever ? 1e9 : to_seconds(soonest),
                        limit));
  }

  /// A server's, or of the way to one, when the robot knows another one.
  bool is_survived(const Fault& fault) const {
    if (!scenario_.has_several() || robot_.servers.size() == 1) return false;
    if (takes_no_frames(fault.kind)) return scenario_.is_server(fault.machine);
    switch (fault.kind) {
      case FaultKind::kKill:
      case FaultKind::kPowerCut:
      case FaultKind::kFreeze:
        return scenario_.is_server(fault.machine);
      case FaultKind::kCutFrom:
      case FaultKind::kCutOneWay:
        return fault.machine == facts_.machine || static_cast<int>(fault.value) == facts_.machine;
      default:
        return false;
    }
  }

  /// But for what is the same for all frames of a session: they have the source's times.
  static Time lateness(const RecordedFrame& frame) {
    return frame.arrived_ns - kWallBegin - frame.capture_time_ns;
  }
  static Time least_lateness(const RecordedSession& session, Time from, Time to) {
    Time least = kNever;
    for (const RecordedFrame& frame : session.frames) {
      const Time came = frame.arrived_ns - kWallBegin;
      if (frame.is_late || came < from || came > to) continue;
      least = std::min(least, lateness(frame));
    }
    return least;
  }

  /// Of a server: when frames came is not known then.
  bool is_clock_wrong(const Fault& outage) const {
    const Time end = outage.at + outage.length + kAlone;
    return std::ranges::any_of(scenario_.faults, [&](const Fault& step) {
      return step.kind == FaultKind::kClockStep && scenario_.is_server(step.machine) &&
             step.at <= end;
    });
  }

  /// No other fault within some seconds, of this robot or of the server.
  bool is_alone(const Fault& outage) const {
    const Time end = outage.at + outage.length + kAlone;
    if (end > scenario_.length) return false;
    return std::ranges::all_of(scenario_.faults, [&](const Fault& other) {
      if (&other == &outage) return true;
      if (other.machine != facts_.machine && scenario_.is_robot(other.machine)) return true;
      const auto times = other.kind == FaultKind::kDieInARow ? other.value : 1;
      const Time lasts = static_cast<Time>(times) * (other.length + 5 * kSecond) + kAlone;
      return other.at > end || other.at + lasts < outage.at;
    });
  }

  /// `buffer.memory`, of frames that are reduced to a quarter at most.
  void check_memory() {
    std::size_t bytes = 0;
    const Source& source = run_.source_of(facts_.machine);
    for (const std::string& image : source.images) bytes += image.size();
    const std::uint64_t most = 4 * kBufferBytes / (bytes / source.images.size());
    if (facts_.most_held > most) {
      problem(
          fmt::format("{} frames were in memory, of which {} take it all", facts_.most_held, most));
    }
    const bool has_bad_link = std::ranges::any_of(scenario_.faults, [this](const Fault& fault) {
      return fault.machine == facts_.machine &&
             (fault.kind == FaultKind::kSlowLink || fault.kind == FaultKind::kLongWay ||
              fault.kind == FaultKind::kLoss);
    });
    const std::uint64_t whole = kBufferBytes / 2 / (bytes / source.images.size());
    const std::uint64_t half = robot_.policy != "catch-up" ? kMostInFlight
                               : has_bad_link              ? kMostReduced * whole
                                                           : kUsuallyReduced * whole;
    if (facts_.most_in_flight > half + 2) {
      problem(fmt::format("{} frames were in flight, of which {} take half of the memory",
                          facts_.most_in_flight, half));
    }
  }

  void check_reasons() {
    const Source& source = run_.source_of(facts_.machine);
    std::map<std::string, std::uint64_t> wrong;
    for (const auto& [number, reason] : named_) {
      const bool is_giant = number % source.images.size() == source.giant;
      const bool is_kept = robot_.has_spool && !has_trouble_with_disk() && !is_giant;
      std::string why;
      if (reason == DropReason::kLost && !may_lose() && !has_lost_bytes() &&
          !has_trouble_with_disk()) {
        why = "lost";
      }
      if (reason == DropReason::kRefused && !is_giant) why = "refused";
      if (reason == DropReason::kFailed) why = "failed";
      if (reason == DropReason::kUnknown && !has_died() && facts_.has_closed && facts_.left == 0)
        why = "unknown";
      if (reason == DropReason::kPolicy && is_kept && number < old_ && !may_lose())
        why = "dropped, and never came";
      if (!why.empty() && wrong[why]++ == 0) first_wrong_[why] = number;
    }
    for (const auto& [why, count] : wrong) {
      problem(fmt::format("{} frames are named with a reason that is not true: {}, from {} on",
                          count, why, first_wrong_[why]));
    }
  }

  void compare_images(const RecordedSession& session) {
    const Source& source = run_.source_of(facts_.machine);
    std::uint64_t wrong = 0, first = 0;
    for (const RecordedFrame& frame : session.frames) {
      const std::string& captured = source.images[frame.sequence % source.images.size()];
      const bool is_right =
          frame.is_reduced()
              ? frame.whole_crc == crc_of(captured) && frame.whole_bytes == captured.size()
              : is_content(folder_ / "images" / fmt::format("{:06}.jpg", frame.sequence), captured);
      if (!is_right && wrong++ == 0) first = frame.sequence;
    }
    if (wrong > 0)
      problem(fmt::format("{} images are not what was captured, from {} on", wrong, first));
  }

  /// times.txt, as a SLAM program reads it.
  void check_views() {
    std::ifstream in(folder_ / "times.txt");
    std::set<std::uint64_t> seen;
    for (std::string line; std::getline(in, line);) {
      const auto times = session_lines::parse_times(line);
      if (!times) {
        if (scenario_.sync == "ack") problem("no line of times.txt: " + line.substr(0, 40));
        continue;
      }
      if (!seen.insert(times->sequence).second) problem("again in times.txt: " + line);
      if (!there_.contains(times->sequence)) problem("in times.txt only: " + line);
    }
    if (run_.has_server_crashed() || facts_.was_visited) return;
    if (fs::exists(folder_ / "orphans")) problem("has orphans");
  }

  void check_report() {
    const auto report = check_session(folder_);
    if (!report) return problem(report.error().text);
    for (const std::string& found : report.value().problems) {
      const bool is_end = found.starts_with("not ended");
      if (is_end && (has_died() || facts_.stops > 1)) continue;
      if (is_end && (old_ == 0 || may_lose() || is_left_to_next_start())) continue;
      // Without a record it is not told later that the bye met a fault.
      if (is_end && !robot_.has_record() && facts_.ended < scenario_.length) continue;
      if (was_left() && !is_end) continue;
      if (has_lost_bytes() && found.starts_with("journal: ")) continue;
      problem("check: " + found);
    }
    if (facts_.was_killed && facts_.stops == 0 && report.value().problems.empty()) {
      problem("check has no complaint, and the robot was killed");
    }
    if (report.value().on_robot > 0) {
      problem(fmt::format("{} frames are still on the robot", report.value().on_robot));
    }
  }

  const Scenario& scenario_;
  const Run& run_;
  const SessionFacts& facts_;
  const RobotSetup& robot_;
  const fs::path folder_;
  Verdict& verdict_;
  std::uint64_t old_ = 0;
  std::set<std::uint64_t> live_;  ///< those that came live
  std::set<std::uint64_t> there_;
  std::map<std::uint64_t, DropReason> named_;
  std::map<std::string, std::uint64_t> first_wrong_;
};

}  // namespace

Verdict judge(const Scenario& scenario, const Run& run) {
  Verdict verdict;
  verdict.problems = run.problems();
  std::set<std::pair<int, std::string>> ids;
  for (int i = 0; i < world->sessions_used; ++i) {
    const SessionFacts& facts = world->sessions[static_cast<std::size_t>(i)];
    SessionJudge(scenario, run, facts, verdict).run();
    if (facts.id[0] == 0 || ids.emplace(facts.machine, facts.id.data()).second) continue;
    verdict.problems.push_back(fmt::format("robot{}, start {} has the session of another, {}",
                                           facts.machine, facts.start, facts.id.data()));
  }
  const bool is_sent_elsewhere = std::ranges::any_of(scenario.faults, [&](const Fault& fault) {
    return fault.kind == FaultKind::kImpostor || takes_no_frames(fault.kind);
  });
  for (std::size_t i = 1; i <= scenario.robots.size(); ++i) {
    const std::size_t known = scenario.robots[i - 1].servers.size() + (is_sent_elsewhere ? 1 : 0);
    const std::uint64_t most = known * kMostAttempts;
    if (world->most_attempts[i] > most) {
      verdict.problems.push_back(
          fmt::format("robot{} tried to connect {} times in a second", i, world->most_attempts[i]));
    }
  }
  return verdict;
}

}  // namespace orbbuf::simulation
