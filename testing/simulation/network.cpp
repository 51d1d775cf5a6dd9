// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/network.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace orbbuf::simulation {
namespace {

enum Kind : int {
  kFirstPacket,  ///< leaves the robot, again and again until it is answered
  kFirstArrives,
  kAnswerArrives,
  kRefusalArrives,
  kArrive,
  kAcknowledge,
  kRetransmit,
  kReset,
  kKeepAlive,
};

constexpr std::uint64_t kMostSegmentBytes = 8192;
constexpr std::uint64_t kLeastSegmentBytes = 536;
constexpr std::uint64_t kFirstWindow = 14'600;
constexpr std::uint32_t kRepeats = 3;  // of an acknowledgement: a segment is lost
constexpr Time kLeastRetransmission = 200 * kMillisecond;
constexpr Time kMostRetransmission = 120 * kSecond;
constexpr std::uint32_t kMostRetransmissions = 15;
constexpr int kMostFirstPackets = 7;
constexpr Time kProbeInterval = 5 * kSecond;
constexpr int kMostProbes = 3;

Path& path_of(const Connection& one) { return world->paths[static_cast<std::size_t>(one.path)]; }

/// The machine that answers at the address that a connection was opened to.
int target_of(const Connection& one) { return world->at_address[static_cast<std::size_t>(one.to)]; }

bool is_through(const Connection& one, int direction) {
  if (one.is_dead || path_of(one).is_down[static_cast<std::size_t>(direction)]) return false;
  const auto opener = static_cast<std::size_t>(one.path), other = static_cast<std::size_t>(one.to);
  return (direction == 0 ? world->cuts[opener][other] : world->cuts[other][opener]) == 0;
}

Time delay_of(const Connection& one) {
  const Path& path = path_of(one);
  return path.delay + (path.jitter > 0 ? world->random.between(0, path.jitter) : 0);
}

void post(int number, Kind kind, int half, Time after, std::uint64_t from = 0,
          std::uint64_t to = 0) {
  Event event;
  event.at = world->now + after;
  event.kind = kind;
  event.connection = number;
  event.half = half;
  event.generation = connection(number).generation;
  event.from = from;
  event.to = to;
  add_event(event);
}

Endpoint& end_of(Connection& one, int end) { return one.ends[static_cast<std::size_t>(end)]; }
Half& half_of(Connection& one, int half) { return one.halves[static_cast<std::size_t>(half)]; }

void changed(Endpoint& end) {
  ++end.changes;
  if (end.is_open && end.machine >= 0) wake_io(end.machine);
}

void break_end(Endpoint& end, int error) {
  if (!end.is_open || end.error != 0) return;
  end.error = error;
  changed(end);
}

/// When neither end has it, what is on its way does not matter any more.
void free_if_over(Connection& one) {
  if (!one.is_used) return;
  for (int side = 0; side < 2; ++side) {
    const Endpoint& end = end_of(one, side);
    if (end.is_open) return;
    // It has closed, and the other end, which is there, still waits for what was sent.
    const Endpoint& other = end_of(one, 1 - side);
    if (other.is_open && !other.is_gone) return;
  }
  one.is_used = false;
  ++one.generation;
}

void send_reset(int number, int to) { post(number, kReset, to, delay_of(connection(number))); }

Time retransmission_time(const Connection& one, const Half& half) {
  const Time base = std::max(kLeastRetransmission, 3 * path_of(one).delay + path_of(one).jitter);
  return std::min(kMostRetransmission, base << std::min(half.backoff, 10U));
}

/// How long the link may be busy with what waits for it: a slow one, too, holds some packets.
Time queue_time(const Path& path) {
  constexpr double kLeastBytes = 32e3;
  return std::max(path.queue, static_cast<Time>(kLeastBytes / path.bytes_per_second * 1e9));
}

void arm(int number, int side) {
  Connection& one = connection(number);
  Half& half = half_of(one, side);
  if (half.is_timed || half.acked == half.sent) return;
  half.is_timed = true;
  half.acked_when_timed = half.acked;
  post(number, kRetransmit, side, retransmission_time(one, half) + queue_time(path_of(one)));
}

/// So small that some of them fit into the queue.
std::uint64_t segment_bytes(const Path& path) {
  const double queue = path.bytes_per_second * static_cast<double>(queue_time(path)) / 1e9;
  return std::clamp(static_cast<std::uint64_t>(queue / 4), kLeastSegmentBytes, kMostSegmentBytes);
}

/// Sends again from there on, and less at once.
void shrink_window(const Path& path, Half& half) {
  half.threshold = std::max(2 * segment_bytes(path), (half.sent - half.acked) / 2);
  half.window = half.threshold;
  half.recovered = half.sent;
  half.repeats = 0;
  half.sent = half.acked;
}

void grow_window(const Path& path, Half& half, std::uint64_t acked) {
  if (half.window >= half.threshold) acked = segment_bytes(path) * acked / half.window;
  half.window = std::min(kWindowBytes, half.window + acked);
}

/// Sends what may be sent.
void pump(int number, int side) {
  Connection& one = connection(number);
  Half& half = half_of(one, side);
  Path& path = path_of(one);
  if (!end_of(one, side).is_established) return;
  auto& busy_until = path.busy_until[static_cast<std::size_t>(side)];
  while (half.sent < half.end()) {
    if (half.sent - std::min(half.sent, half.read) >= kWindowBytes) break;
    if (half.sent - half.acked >= half.window) break;
    const std::uint64_t to = std::min(half.end(), half.sent + segment_bytes(path));
    const auto seconds = static_cast<double>(to - half.sent + 40) / path.bytes_per_second;
    if (half.sent == half.acked) half.waiting_since = world->now;
    const bool is_lost = !is_through(one, side) || busy_until > world->now + queue_time(path) ||
                         (path.loss_one_in > 0 && world->random.one_in(path.loss_one_in));
    if (!is_lost) {
      busy_until = std::max(busy_until, world->now) + static_cast<Time>(seconds * 1e9);
      half.last_arrival = std::max(half.last_arrival, busy_until + delay_of(one));  // in order
      post(number, kArrive, side, half.last_arrival - world->now, half.sent, to);
    }
    half.sent = to;
  }
  arm(number, side);
  Endpoint& writer = end_of(one, side);
  if (writer.wants_room && room_to_send(number, side) > 0) {
    writer.wants_room = false;
    changed(writer);
  }
}

void first_packet(int number, const Event& event) {
  Connection& one = connection(number);
  if (end_of(one, 0).is_established || !end_of(one, 0).is_open) return;
  if (event.from >= kMostFirstPackets) return break_end(end_of(one, 0), ETIMEDOUT);
  if (is_through(one, 0)) post(number, kFirstArrives, 0, delay_of(one));
  post(number, kFirstPacket, 0, kSecond << event.from, event.from + 1);
}

void first_arrives(int number) {
  Connection& one = connection(number);
  const int target = target_of(one);
  if (!is_through(one, 0) || !machine(target).is_on) return;
  Endpoint& server = end_of(one, 1);
  if (one.is_queued || server.is_open) {
    if (is_through(one, 1)) post(number, kAnswerArrives, 1, delay_of(one));
    return;
  }
  Listener& listener = machine(target).listener;
  if (listener.port != one.to_port) return post(number, kRefusalArrives, 1, delay_of(one));
  if (listener.queue_used >= kMostQueued) return;
  server.machine = target;
  server.is_open = server.is_established = one.is_queued = true;
  listener.queue[static_cast<std::size_t>(listener.queue_used++)] = number;
  ++listener.changes;
  wake_io(target);
  if (is_through(one, 1)) post(number, kAnswerArrives, 1, delay_of(one));
}

void answer_arrives(int number) {
  Connection& one = connection(number);
  Endpoint& robot = end_of(one, 0);
  if (!is_through(one, 1) || robot.is_established) return;
  if (!robot.is_open) return send_reset(number, 1);
  robot.is_established = true;
  changed(robot);
  pump(number, 0);
}

/// Whether the packets of a half reach a kernel that answers them.
bool is_answered(int number, int side) {
  Connection& one = connection(number);
  if (!is_through(one, side)) return false;
  const Endpoint& reader = end_of(one, 1 - side);
  return reader.machine >= 0 && machine(reader.machine).is_on;
}

void arrive(int number, const Event& event) {
  Connection& one = connection(number);
  Half& half = half_of(one, event.half);
  if (!is_answered(number, event.half)) return;
  Endpoint& reader = end_of(one, 1 - event.half);
  if (!reader.is_open) return send_reset(number, event.half);
  // What is behind a lost segment is sent again as well.
  if (event.from <= half.arrived && event.to > half.arrived) {
    half.arrived = event.to;
    changed(reader);
  }
  if (is_through(one, 1 - event.half)) {
    post(number, kAcknowledge, event.half, delay_of(one), 0, half.arrived);
  }
}

void acknowledge(int number, const Event& event) {
  Connection& one = connection(number);
  Half& half = half_of(one, event.half);
  if (!is_through(one, 1 - event.half) || event.to < half.acked) return;
  if (event.to == half.acked) {
    if (half.sent == half.acked || half.acked < half.recovered) return;
    if (++half.repeats < kRepeats) return;
    const Time since = half.waiting_since;
    shrink_window(path_of(one), half);
    pump(number, event.half);
    half.waiting_since = since;
    return;
  }
  grow_window(path_of(one), half, event.to - half.acked);
  half.repeats = 0;
  half.acked = event.to;
  half.sent = std::max(half.sent, half.acked);
  half.backoff = 0;
  half.waiting_since = world->now;
  pump(number, event.half);
  Endpoint& writer = end_of(one, event.half);
  if (writer.wants_room && room_to_send(number, event.half) > 0) {
    writer.wants_room = false;
    changed(writer);
  }
}

void retransmit(int number, const Event& event) {
  Connection& one = connection(number);
  Half& half = half_of(one, event.half);
  half.is_timed = false;
  Endpoint& writer = end_of(one, event.half);
  if (half.sent != half.acked && half.acked == half.acked_when_timed) {
    const Time waited = world->now - half.waiting_since;
    if (++half.backoff > kMostRetransmissions ||
        (writer.user_timeout > 0 && waited > writer.user_timeout)) {
      return break_end(writer, ETIMEDOUT);
    }
    const Time since = half.waiting_since;
    shrink_window(path_of(one), half);
    half.window = segment_bytes(path_of(one));
    pump(number, event.half);
    half.waiting_since = since;
  }
  arm(number, event.half);
}

void probe(int number, const Event& event) {
  Connection& one = connection(number);
  Endpoint& end = end_of(one, event.half);
  if (!end.is_open || end.error != 0) return;
  const bool is_alive =
      is_answered(number, event.half) && is_through(one, 1 - event.half) && end.is_established;
  if (is_alive && !end_of(one, 1 - event.half).is_open && end_of(one, 1 - event.half).is_gone) {
    return break_end(end, ECONNRESET);
  }
  end.failed_probes = is_alive ? 0 : end.failed_probes + 1;
  if (end.failed_probes >= kMostProbes) return break_end(end, ETIMEDOUT);
  post(number, kKeepAlive, event.half, kProbeInterval);
}

}  // namespace

int open_connection(int to, std::uint16_t port) {
  int number = 0;
  while (number < kMostConnections && connection(number).is_used) ++number;
  if (number == kMostConnections) fail("too many connections");
  Connection& one = connection(number);
  const std::uint32_t generation = one.generation + 1;
  one.is_used = true;
  one.is_dead = one.is_queued = false;
  one.generation = generation;
  one.path = my_machine_number();
  one.to = to;
  one.to_port = port;
  one.port = static_cast<std::uint16_t>(32768 + world->connects++ % 28000);
  one.opened = world->now;
  one.ends = {};
  for (Half& half : one.halves) {
    half.written = half.sent = half.acked = half.arrived = half.read = half.acked_when_timed = 0;
    half.has_end = half.is_timed = false;
    half.window = kFirstWindow;
    half.threshold = kWindowBytes;
    half.recovered = half.repeats = 0;
    half.backoff = 0;
    half.last_arrival = 0;
  }
  one.ends[0].machine = one.path;
  one.ends[0].is_open = true;
  const auto robot = static_cast<std::size_t>(one.path);
  auto& attempts = world->attempts[robot];
  auto& made = world->attempts_made[robot];
  attempts[made++ % attempts.size()] = world->now;
  std::uint64_t recent = 0;
  for (std::uint64_t i = 0; i < std::min<std::uint64_t>(made, attempts.size()); ++i) {
    if (world->now - attempts[i] < kSecond) ++recent;
  }
  world->most_attempts[robot] = std::max(world->most_attempts[robot], recent);
  Event first;
  first.kind = kFirstPacket;
  first_packet(number, first);
  return number;
}

std::size_t room_to_send(int number, int end) {
  const Connection& one = connection(number);
  const Half& half = one.halves[static_cast<std::size_t>(end)];
  const std::uint64_t lowest = std::min(half.read, half.acked);
  std::uint64_t room = kRingBytes - (half.written - std::min(lowest, half.written));
  const std::uint64_t least = one.ends[static_cast<std::size_t>(end)].least_unsent;
  if (least > 0) {
    const std::uint64_t unsent = half.written - std::min(half.sent, half.written);
    room = std::min(room, unsent >= least ? 0 : least - unsent);
  }
  return static_cast<std::size_t>(room);
}

std::size_t send_bytes(int number, int end, const char* bytes, std::size_t count) {
  Connection& one = connection(number);
  Half& half = half_of(one, end);
  const std::size_t taken = std::min(count, room_to_send(number, end));
  for (std::size_t done = 0; done < taken;) {
    const std::size_t at = (half.written + done) % kRingBytes;
    const std::size_t piece = std::min(taken - done, kRingBytes - at);
    std::memcpy(half.bytes.data() + at, bytes + done, piece);
    done += piece;
  }
  half.written += taken;
  if (taken < count) end_of(one, end).wants_room = true;
  pump(number, end);
  return taken;
}

std::size_t receive_bytes(int number, int end, char* into, std::size_t room, bool is_peeking) {
  Connection& one = connection(number);
  Half& half = half_of(one, 1 - end);
  const std::size_t taken = std::min<std::size_t>(room, half.readable());
  for (std::size_t done = 0; done < taken;) {
    const std::size_t at = (half.read + done) % kRingBytes;
    const std::size_t piece = std::min(taken - done, kRingBytes - at);
    std::memcpy(into + done, half.bytes.data() + at, piece);
    done += piece;
  }
  if (is_peeking) return taken;
  half.read += taken;
  if (taken > 0) pump(number, 1 - end);  // the window is open again
  return taken;
}

void end_writing(int number, int end) {
  Half& half = half_of(connection(number), end);
  if (half.has_end) return;
  half.has_end = true;
  pump(number, end);
}

void close_end(int number, int end) {
  Connection& one = connection(number);
  Endpoint& mine = end_of(one, end);
  if (!mine.is_open) return;
  mine.is_open = false;
  Endpoint& other = end_of(one, 1 - end);
  if (mine.error == 0 && other.machine >= 0) {
    const bool is_unread = half_of(one, 1 - end).readable() > 0;
    if (is_unread || mine.resets || !mine.is_established) {
      if (is_through(one, end)) send_reset(number, 1 - end);
    } else {
      end_writing(number, end);
    }
  }
  if (one.is_queued && end == 1) {
    Listener& listener = machine(mine.machine).listener;
    const auto begin = listener.queue.begin();
    const auto last = begin + listener.queue_used;
    if (const auto found = std::find(begin, last, number); found != last) {
      std::copy(found + 1, last, found);
      --listener.queue_used;
    }
    one.is_queued = false;
  }
  free_if_over(one);
}

void close_all(int number) {
  for (int i = 0; i < kMostConnections; ++i) {
    for (int end = 0; end < 2; ++end) {
      if (connection(i).is_used &&
          connection(i).ends[static_cast<std::size_t>(end)].machine == number) {
        close_end(i, end);
      }
    }
  }
  machine(number).listener.port = 0;
}

void abandon_all(int number) {
  for (int i = 0; i < kMostConnections; ++i) {
    Connection& one = connection(i);
    if (!one.is_used) continue;
    for (Endpoint& end : one.ends) {
      if (end.machine != number || !end.is_open) continue;
      end.is_open = false;
      end.is_gone = true;
    }
    free_if_over(one);
  }
  machine(number).listener.port = 0;
  machine(number).listener.queue_used = 0;
}

void change_address(int number) {
  for (int i = 0; i < kMostConnections; ++i) {
    Connection& one = connection(i);
    if (one.is_used && one.path == number) one.is_dead = true;
  }
  ++machine(number).network_news;
  wake_io(number);
}

void keep_alive(int number, int end) {
  Endpoint& one = end_of(connection(number), end);
  if (one.is_kept_alive) return;
  one.is_kept_alive = true;
  post(number, kKeepAlive, end, kProbeInterval);
}

int accept_connection() {
  Listener& listener = my_machine().listener;
  if (listener.queue_used == 0) return -1;
  const int number = listener.queue[0];
  std::copy(listener.queue.begin() + 1, listener.queue.begin() + listener.queue_used,
            listener.queue.begin());
  --listener.queue_used;
  connection(number).is_queued = false;
  return number;
}

void handle(const Event& event) {
  const int number = event.connection;
  Connection& one = connection(number);
  if (!one.is_used || one.generation != event.generation) return;
  switch (event.kind) {
    case kFirstPacket:
      return first_packet(number, event);
    case kFirstArrives:
      return first_arrives(number);
    case kAnswerArrives:
      return answer_arrives(number);
    case kRefusalArrives:
      if (is_through(one, 1)) break_end(end_of(one, 0), ECONNREFUSED);
      return;
    case kArrive:
      return arrive(number, event);
    case kAcknowledge:
      return acknowledge(number, event);
    case kRetransmit:
      return retransmit(number, event);
    case kReset:
      if (is_through(one, 1 - event.half)) break_end(end_of(one, event.half), ECONNRESET);
      return;
    case kKeepAlive:
      return probe(number, event);
    default:
      fail("an event without a kind");
  }
}

}  // namespace orbbuf::simulation
