// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_state.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <limits>

#include "common/log.hpp"

namespace orbbuf {
namespace {

constexpr std::uint8_t kVersion = 2;

std::vector<std::uint8_t> encode(const record_format::Account& account, const DropRanges& drops) {
  wire::Writer out(0);
  record_format::put(out, account, drops);
  return std::move(out.bytes());
}

}  // namespace

using record_format::Account;
using record_format::Bytes;
using record_format::StreamAccount;
using State = KeptFrame::State;

RecordState::RecordState(std::string robot_id, const std::string& session_id)
    : prefix_(std::move(robot_id) + '/'), present_name_(prefix_ + session_id) {}

RecordState::Sessions::iterator RecordState::find(std::string_view name) {
  for (auto found = sessions_.end(); found != sessions_.begin();) {
    if ((--found)->second.name == name) return found;
  }
  return sessions_.end();
}

RecordState::Session& RecordState::add(std::string name) {
  Session& session = sessions_[next_session_++];
  session.name = std::move(name);
  return session;
}

bool RecordState::apply_checkpoint(Bytes body) {
  wire::Reader in(body);
  if (in.take<std::uint8_t>() != kVersion) return false;
  Sessions sessions;
  for (auto count = in.take<std::uint32_t>(); count > 0; --count) {
    Session session;
    auto account = record_format::take_account(in, session.given_up);
    if (!account) return false;
    static_cast<Account&>(session) = std::move(*account);
    sessions.emplace(next_session_++, std::move(session));
  }
  if (in.is_short()) return false;
  sessions_ = std::move(sessions);
  return true;
}

void RecordState::apply_account(Bytes body) {
  wire::Reader in(body);
  DropRanges drops;
  auto account = record_format::take_account(in, drops);
  if (!account) return;
  const auto found = find(account->name);
  Session& session = found == sessions_.end() ? add(account->name) : found->second;
  account->captured = std::max(account->captured, session.captured);  // the checkpoint is newer
  for (StreamAccount& each : account->streams) {
    const auto known = std::ranges::find(session.streams, each.stream, &StreamAccount::stream);
    if (known == session.streams.end()) continue;
    each.captured = std::max(each.captured, known->captured);
    each.settled = std::max(each.settled, known->settled);
  }
  static_cast<Account&>(session) = std::move(*account);
  for (const auto& [number, record] : drops.by_number()) session.given_up.add(record);
  session.given_up.remove_below(session.settled_below);
}

void RecordState::apply(const record_format::Index& index, bool may_add) {
  for (const auto& [name, entry] : index) {
    const auto found = find(name);
    if (found == sessions_.end() && !may_add) continue;
    Session& session = found == sessions_.end() ? add(name) : found->second;
    for (const KeptFrame& frame : entry.kept) {
      session.captured = std::max(session.captured, frame.sequence + 1);
      if (session.kept.add(frame)) ++segments_[frame.segment].held;
    }
    for (const Sequence sequence : entry.released) {
      if (KeptFrame* const frame = session.kept.find(sequence)) remove(session, *frame);
    }
    for (auto [stream, items] : entry.items) {
      items.is_late = false;
      if (session.items[stream].add(items)) ++segments_[items.segment].held;
    }
  }
}

std::uint64_t RecordState::Session::held_items() const {
  std::uint64_t held = 0;
  for (const auto& [stream, of_stream] : items) held += of_stream.held();
  return held;
}

/// What the server has need not be held.
void RecordState::note_streams(Session& session, const std::vector<StreamAccount>& streams) {
  for (auto& [stream, kept] : session.items) {
    const auto account = std::ranges::find(
        streams, stream, [](const StreamAccount& each) { return each.stream.id; });
    const std::uint64_t settled = account == streams.end() ? ~0ULL : account->settled;
    while (KeptFrame* const items = kept.find_done(settled)) remove(session, *items, stream);
  }
  session.streams = streams;
  for (StreamAccount& each : session.streams) {
    const KeptFrames& kept = session.items[each.stream.id];
    if (kept.held() > 0) each.settled = std::min(each.settled, kept.first());
  }
}

void RecordState::begin() {
  released_.clear();  // the journal has said so
  for (auto& [number, session] : sessions_) {
    auto streams = session.streams;
    if (session.is_settled) streams.clear();
    if (!session.is_settled && streams.empty() && session.held_items() > 0) {
      log_warn("record: the samples of session {} are lost, since no account names their streams",
               session.name);
    }
    note_streams(session, streams);
    for (auto& [stream, kept] : session.items) kept.set_late(0, ~Sequence{0});
  }
  std::erase_if(sessions_, [](const auto& entry) {
    const Session& session = entry.second;
    const bool is_told = session.is_settled || (session.captured == 0 && session.streams.empty());
    return is_told && session.kept.held() == 0 && session.held_items() == 0;
  });
  while (sessions_.size() >= kMostSessions) forget(sessions_.begin());
  limit_drops();
  add(present_name_);
}

/// There are too many of them.
void RecordState::forget(Sessions::iterator session) {
  const Session& forgotten = session->second;
  log_error(
      "record: session {} is forgotten, since there are {} newer ones: of its {} frames the server "
      "confirmed those below {}; {} kept frames of it are lost",
      forgotten.name, kMostSessions, forgotten.captured, forgotten.confirmed,
      forgotten.kept.held());
  for (auto& [number, segment] : segments_) {
    segment.held -= session->second.kept.remove_segment(number, segment.held).size();
    for (auto& [stream, kept] : session->second.items) {
      segment.held -= kept.remove_segment(number, segment.held).size();
    }
  }
  sessions_.erase(session);
}

void RecordState::limit_drops() {
  std::size_t drops = 0;
  // clang 14 compiles no std::views::reverse. NOLINTNEXTLINE(modernize-loop-convert)
  for (auto session = sessions_.rbegin(); session != sessions_.rend(); ++session) {
    drops += session->second.given_up.size();
    if (drops > kMostEarlierDrops) session->second.given_up = {};  // the server finds the holes
  }
}

void RecordState::give_up(std::span<const DropRecord> records) {
  for (const DropRecord& record : records) {
    present().given_up.add(record);
    new_drops_.add(record);
  }
  is_noted_ = true;
}

bool RecordState::note(const SessionProgress& progress) {
  Session& session = present();
  const bool has_notes =
      is_noted_ || !released_.empty() || !new_items_.empty() || !settled_.empty();
  if (!has_notes && progress == noted_progress_) return false;
  noted_progress_ = progress;
  session.captured = progress.captured;
  session.last_capture_time_ns = progress.last_capture_time_ns;
  session.confirmed = progress.confirmed;
  session.settled_below = progress.settled_below;
  session.given_up.remove_below(progress.settled_below);
  new_drops_.remove_below(progress.settled_below);
  note_streams(session, progress.streams);
  for (const StreamAccount& each : progress.streams) {
    std::erase_if(gone_items_[each.stream.id],
                  [&](const auto& range) { return range.second <= each.settled; });
  }
  session.is_changed = true;
  is_noted_ = true;
  return true;
}

void RecordState::end() {
  present().has_ended = true;
  is_noted_ = true;
}

std::optional<KeptId> RecordState::find_present(Sequence sequence) {
  if (present().kept.find(sequence) == nullptr) return std::nullopt;
  return KeptId{sessions_.rbegin()->first, sequence};
}

KeptFrame* RecordState::find(const KeptId& id) {
  const auto session = sessions_.find(id.session);
  return session == sessions_.end() ? nullptr
                                    : session->second.kept_of(id.stream).find(id.sequence);
}

void RecordState::keep(const wire::Items& items) {
  Session& session = present();
  const KeptFrame kept{
      .sequence = items.first, .is_late = false, .count = record_format::count_of(items)};
  if (!session.items[items.stream].add(kept)) return;
  Note note{record_format::kItems,
            record_format::encode_items(session.name, items),
            session.name,
            {},
            items.stream,
            kept.sequence,
            kept.count};
  pending_item_bytes_ += note.body.size();
  new_items_.push_back(std::move(note));
}

void RecordState::refuse_items(const Note& note) {
  KeptFrame* const items = present().items[*note.items].find(note.first);
  if (items == nullptr) return;
  note_gone(*note.items, *items);
  remove(present(), *items, *note.items);
}

void RecordState::note_gone(wire::StreamId stream, const KeptFrame& items) {
  auto& gone = gone_items_[stream];
  if (gone.empty() || gone.back().second != items.sequence) {
    gone.emplace_back(items.sequence, items.sequence);
  }
  gone.back().second = items.end();
}

std::uint64_t RecordState::send_late(wire::StreamId stream, std::uint64_t begin,
                                     std::uint64_t end) {
  present().items[stream].set_late(begin, end);
  present().is_changed = true;
  std::uint64_t gone = 0;
  for (const auto& [from, to] : gone_items_[stream]) {
    gone += std::clamp(to, begin, end) - std::clamp(from, begin, end);
  }
  return gone;
}

/// What was written, the journal has to be told.
void RecordState::remove(Session& session, KeptFrame& frame, wire::StreamId stream) {
  if (frame.state != State::kPending) {
    --segments_.at(frame.segment).held;
    if (stream == wire::kFrames) released_[session.name].push_back(frame.sequence);
  }
  session.kept_of(stream).remove(frame);
  session.is_changed = true;
}

void RecordState::on_written(const KeptFrame& place, wire::StreamId stream) {
  KeptFrames& kept = present().kept_of(stream);
  if (KeptFrame* const frame = kept.find(place.sequence)) {
    kept.on_written(*frame, place);
    ++segments_.at(place.segment).held;
  } else if (stream == wire::kFrames) {  // it was released meanwhile
    released_[present_name_].push_back(place.sequence);
  }
}

std::optional<RecordState::Taken> RecordState::take_next(Sequence end) {
  for (auto& [number, session] : sessions_) {
    if (!is_ours(session)) continue;
    for (auto& [stream, kept] : session.items) {
      if (const KeptFrame* const items = kept.take_next(std::numeric_limits<Sequence>::max())) {
        return Taken{{number, items->sequence, stream}, id_of(session), *items};
      }
    }
    const Sequence most = is_present(session) ? end : std::numeric_limits<Sequence>::max();
    if (const KeptFrame* const frame = session.kept.take_next(most)) {
      return Taken{{number, frame->sequence}, id_of(session), *frame};
    }
  }
  return std::nullopt;
}

void RecordState::give_back(const KeptId& id) {
  KeptFrame* const frame = find(id);
  if (frame != nullptr) sessions_.at(id.session).kept_of(id.stream).give_back(*frame);
}

void RecordState::remove(const KeptId& id) {
  KeptFrame* const frame = find(id);
  if (frame != nullptr) remove(sessions_.at(id.session), *frame, id.stream);
}

std::vector<wire::Account> RecordState::take_accounts() {
  std::vector<wire::Account> accounts;
  for (auto& [number, session] : sessions_) {
    if (!is_ours(session) || !std::exchange(session.is_changed, false)) continue;
    wire::Account account;
    account.session_id = id_of(session);
    account.has_ended = session.has_ended;
    account.captured = session.captured;
    account.last_capture_time_ns = session.last_capture_time_ns;
    account.confirmed = session.confirmed;
    account.held = session.kept.held();
    account.first_held = session.kept.first();
    for (const StreamAccount& each : session.streams) {
      account.streams.push_back({each.stream, each.captured, session.items[each.stream.id].held()});
    }
    if (!is_present(session)) {  // else they cross in a stream of their own
      for (const auto& [first, record] : session.given_up.by_number()) {
        if (account.given_up.size() == wire::kMaxDropsPerMessage) {
          accounts.push_back(account);
          account.given_up.clear();
        }
        account.given_up.push_back(record);
      }
      account.is_final = true;
    }
    accounts.push_back(std::move(account));
  }
  return accounts;
}

void RecordState::rewind_accounts() {
  for (auto& [number, session] : sessions_) session.is_changed = true;
}

bool RecordState::settle(const std::string& session_id) {
  const auto found = find(prefix_ + session_id);
  if (found == sessions_.end()) return false;
  Session& session = found->second;
  if (is_present(session) || session.kept.held() > 0 || session.held_items() > 0) return false;
  session.is_settled = true;
  settled_.push_back(session);
  sessions_.erase(found);
  return true;
}

std::deque<RecordState::Note> RecordState::take_notes() {
  std::deque<Note> notes = std::exchange(new_items_, {});
  pending_item_bytes_ = 0;
  if (std::exchange(is_noted_, false)) {  // items are of no use without their streams
    notes.push_front({record_format::kAccount, encode(present(), new_drops_), {}, {}});
    new_drops_ = {};
  }
  for (const Account& account : std::exchange(settled_, {})) {
    notes.push_back({record_format::kAccount, encode(account, {}), {}, {}});
  }
  for (auto& [name, released] : std::exchange(released_, {})) {
    auto body = record_format::encode_released(name, released);
    notes.push_back({record_format::kReleased, std::move(body), name, std::move(released)});
  }
  return notes;
}

std::vector<std::uint8_t> RecordState::checkpoint() const {
  wire::Writer out(0);
  out.put(kVersion);
  out.put(static_cast<std::uint32_t>(sessions_.size()));
  for (const auto& [number, session] : sessions_) {
    record_format::put(out, session, session.given_up);
  }
  return std::move(out.bytes());
}

std::optional<std::uint32_t> RecordState::oldest_segment() const {
  return segments_.size() > 1 ? std::optional(segments_.begin()->first) : std::nullopt;
}

std::vector<RecordState::Lost> RecordState::remove_segment(std::uint32_t segment) {
  std::vector<Lost> lost;
  std::uint64_t held = segments_.at(segment).held;
  for (auto session = sessions_.begin(); held > 0 && session != sessions_.end(); ++session) {
    const std::uint64_t before = held;
    const std::uint64_t frames = session->second.kept.remove_segment(segment, held).size();
    held -= frames;
    std::uint64_t late_items = 0;
    for (auto& [stream, kept] : session->second.items) {
      for (const KeptFrame& items : kept.remove_segment(segment, held)) {
        --held;
        if (items.is_late) ++late_items;
        if (is_present(session->second)) note_gone(stream, items);
      }
    }
    if (held == before) continue;
    session->second.is_changed = true;
    if (frames + late_items > 0) lost.push_back({session->second.name, frames, late_items});
  }
  segments_.erase(segment);
  return lost;
}

std::vector<std::uint32_t> RecordState::segments() const {
  std::vector<std::uint32_t> segments;
  for (const auto& [number, segment] : segments_) segments.push_back(number);
  return segments;
}

std::uint64_t RecordState::bytes() const {
  std::uint64_t bytes = 0;
  for (const auto& [number, segment] : segments_) bytes += segment.bytes;
  return bytes;
}

std::uint64_t RecordState::held() const {
  std::uint64_t held = 0;
  for (const auto& [number, session] : sessions_) {
    if (is_ours(session)) held += session.kept.held();
  }
  return held;
}

std::uint64_t RecordState::held_items() const {
  std::uint64_t held = 0;
  for (const auto& [number, session] : sessions_) {
    if (is_ours(session)) held += session.held_items();
  }
  return held;
}

std::vector<std::string> RecordState::describe_earlier(std::size_t most) const {
  std::vector<std::string> lines;
  for (auto entry = std::next(sessions_.rbegin()); entry != sessions_.rend(); ++entry) {
    const Session& session = entry->second;
    if (lines.size() == most) break;
    const bool has_items = session.held_items() > 0;
    if (session.confirmed >= session.captured && session.kept.held() == 0 && !has_items) continue;
    const std::string unconfirmed =
        session.confirmed < session.captured
            ? fmt::format("frames {} to {}", session.confirmed, session.captured - 1)
            : "no frames";
    lines.push_back(fmt::format(
        "record: session {} ended with {} not confirmed by the server; {} of its frames are "
        "kept{}{}",
        session.name, unconfirmed, session.kept.held(), has_items ? ", and samples of it" : "",
        is_ours(session) ? "" : ", and not sent, since robot.id is another one now"));
  }
  return lines;
}

}  // namespace orbbuf
