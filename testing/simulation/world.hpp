// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/core.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <string_view>

/// A world of machines in virtual time: robots, a server, links and disks, all from one seed.
///
/// Each machine is a process that runs the unmodified program. What the machines share with the
/// *controller*, the process that makes the world, is one World in shared memory. A library that is
/// preloaded into the programs replaces the functions of the C library through which they meet
/// time, threads, network and disk (interpose_*.cpp). Of all threads of all machines exactly
/// one runs: it has the *turn* (fibers.hpp). At each point where a thread would wait, or may be
/// interrupted, the world's random numbers choose which thread goes on. When none can, the clock
/// moves to the next deadline or event.
namespace orbbuf::simulation {

using Time = std::int64_t;  ///< virtual, in ns since the world began

inline constexpr Time kMicrosecond = 1000;
inline constexpr Time kMillisecond = 1'000'000;
inline constexpr Time kSecond = 1'000'000'000;
inline constexpr Time kNever = INT64_MAX;

inline constexpr int kMostMachines = 8;
inline constexpr int kMostThreads = 512;
inline constexpr int kMostConnections = 256;
inline constexpr int kMostEvents = 8192;
inline constexpr int kMostSessions = 1024;
inline constexpr std::uint32_t kRingBytes = 512 << 10;
inline constexpr std::uint64_t kWindowBytes = 384 << 10;  ///< of a connection, at most
static_assert(kWindowBytes < kRingBytes);
inline constexpr std::uint64_t kDiskLogBytes = 64 << 20;
inline constexpr int kController = 0;  ///< its thread

/// SplitMix64.
struct Random {
  std::uint64_t state = 0;

  std::uint64_t next() {
    state += 0x9E3779B97F4A7C15U;
    std::uint64_t z = state;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }
  /// 0 .. below - 1.
  std::uint64_t below(std::uint64_t limit) { return limit == 0 ? 0 : next() % limit; }
  Time between(Time least, Time most) {
    return least + static_cast<Time>(below(static_cast<std::uint64_t>(most - least + 1)));
  }
  bool one_in(std::uint64_t n) { return below(n) == 0; }
};

enum class State : std::uint8_t { kFree, kRunnable, kBlocked };
enum class Wait : std::uint8_t { kSleep, kMutex, kCondition, kFutex, kIo, kJoin, kParked };

struct Thread {
  State state = State::kFree;
  Wait wait = Wait::kSleep;
  bool was_woken = false;  ///< by another thread, not by its deadline
  int machine = -1;        ///< -1: the controller
  const void* key = nullptr;
  Time deadline = kNever;
};

/// One direction of a connection; positions count bytes since it opened. The end counts as a byte.
struct Half {
  std::uint64_t written = 0, sent = 0, acked = 0, arrived = 0, read = 0;
  bool has_end = false;
  bool is_timed = false;        ///< an event for the retransmission is on its way
  std::uint64_t window = 0;     ///< that many bytes may be on their way
  std::uint64_t threshold = 0;  ///< below it the window grows fast
  std::uint64_t recovered = 0;  ///< until that is acknowledged, what was lost is known
  std::uint32_t repeats = 0;    ///< acknowledgements that say nothing new
  std::uint32_t backoff = 0;
  std::uint64_t acked_when_timed = 0;
  Time last_arrival = 0;
  Time waiting_since = 0;  ///< for the oldest byte that is not acknowledged
  std::array<char, kRingBytes> bytes;

  std::uint64_t end() const { return written + (has_end ? 1 : 0); }
  std::uint64_t readable() const { return (arrived < written ? arrived : written) - read; }
  bool is_at_end() const { return has_end && arrived > written && read == written; }
};

struct Endpoint {
  int machine = -1;
  bool is_open = false;         ///< a descriptor has it, or the listener's queue
  bool is_gone = false;         ///< its machine lost power
  bool is_established = false;  ///< may send
  bool wants_room = false;
  bool is_kept_alive = false;
  bool resets = false;  ///< when it is closed
  int error = 0;
  int failed_probes = 0;
  std::uint32_t changes = 0;  ///< for epoll
  std::uint32_t least_unsent = 0;
  Time user_timeout = 0;
};

/// End 0 is of the machine that opened it: a robot.
struct Connection {
  bool is_used = false;
  bool is_dead = false;  ///< the first end's address has changed: nothing gets through any more
  bool is_queued = false;
  std::uint32_t generation = 0;
  std::uint32_t attempt = 0;  ///< of the first packet
  int path = 0;               ///< the machine that opened it, whose path it goes
  int to = 0;                 ///< the machine whose address it was opened to
  std::uint16_t to_port = 0;
  std::uint16_t port = 0;
  Time opened = 0;
  std::array<Endpoint, 2> ends;
  std::array<Half, 2> halves;  ///< by who writes
};

/// Between a machine and those that it connects to; 0: from it.
struct Path {
  std::array<bool, 2> is_down{};
  std::array<Time, 2> busy_until{};
  Time delay = 5 * kMillisecond;
  Time jitter = 0;
  Time queue = 300 * kMillisecond;  ///< that much waits at the bottleneck, the rest is lost
  double bytes_per_second = 1e6;
  std::uint32_t loss_one_in = 0;  ///< 0: none

  double way_s() const { return static_cast<double>(delay + jitter) / 1e9; }
};

struct Disk {
  std::uint64_t capacity = 0;  ///< bytes
  std::uint64_t used = 0;
  std::uint64_t log_used = 0;
  std::uint64_t operations = 0;
  std::uint64_t forced = 0;  ///< syncs that failed
  Time fails_until = 0;      ///< writes and syncs: EIO
  Time slow_until = 0;
  Time syncs_hang_until = 0;
  Time sync_time = 0;  ///< of each sync
};

inline constexpr int kMostQueued = 128;

/// Where a program waits for connections.
struct Listener {
  std::uint16_t port = 0;  ///< 0: it does not
  int queue_used = 0;
  std::uint32_t changes = 0;
  std::array<int, kMostQueued> queue{};
};

struct Machine {
  std::array<char, 16> name{};
  bool is_on = false;       ///< has power
  bool is_running = false;  ///< its program runs
  bool has_ended = false;   ///< by itself, since its last start
  bool is_dying = false;    ///< parked, for the controller to kill it
  int status = 0;
  int pid = 0;
  int start = 0;  ///< how many times it was started
  int session = -1;
  Time frozen_until = 0;
  Time clock_offset = 0;
  Time started = 0;
  std::int64_t calls_until_death = -1;
  int signal = 0;         ///< to be handled
  int mutex_waiters = 0;  ///< of its threads
  std::uint32_t network_news = 0;
  Listener listener;
  Disk disk;
};

/// One start of a robot, as it is known from outside.
struct SessionFacts {
  int machine = -1;
  int start = 0;
  double fps = 0;
  std::array<char, 64> id{};
  std::uint64_t opened = 0;        ///< images; of these the last one may not be captured yet
  std::uint64_t acknowledged = 0;  ///< this and those below as its log last said
  std::uint64_t spooled = 0;
  std::uint64_t most_held = 0;  ///< frames that waited, or were in flight
  std::uint64_t most_in_flight = 0;
  Time began = 0;
  Time ended = kNever;
  bool was_killed = false;
  bool lost_power = false;
  bool has_closed = false;     ///< by itself
  std::uint64_t left = 0;      ///< frames that it had not delivered then
  int stops = 0;               ///< signals; the second one ends it at once
  bool was_visited = false;    ///< by a stranger, in its name
  bool was_forgotten = false;  ///< a server knew less than had been acknowledged
};

struct Event {
  Time at = 0;
  std::uint64_t order = 0;
  int kind = 0;
  int connection = -1;
  int half = 0;
  std::uint32_t generation = 0;
  std::uint64_t from = 0;
  std::uint64_t to = 0;
};

struct World {
  Time now = 0;
  std::uint64_t turns = 0;
  std::uint64_t switches = 0;  ///< turns that went to another thread
  std::uint64_t deaths = 0;
  std::uint64_t orders = 0;
  Random random;
  bool is_stuck = false;
  std::atomic<int> current{kController};  ///< who has the turn
  int threads_used = 1;
  int events_used = 0;
  int trace = -1;          ///< a descriptor
  std::uint64_t hash = 0;  ///< of all that was traced, or would be
  std::uint64_t connects = 0;
  std::array<Thread, kMostThreads> threads;
  std::array<Machine, kMostMachines> machines;
  std::array<Path, kMostMachines> paths;
  std::array<std::array<int, kMostMachines>, kMostMachines>
      cuts;                                   ///< what one sends another is lost
  std::array<int, kMostMachines> at_address;  ///< who answers there, but for a stranger the machine
  std::array<Event, kMostEvents> events;
  int sessions_used = 0;
  std::array<SessionFacts, kMostSessions> sessions;
  std::array<Connection, kMostConnections> connections;
  std::array<std::array<Time, 64>, kMostMachines> attempts;  ///< the last ones, a ring
  std::array<std::uint64_t, kMostMachines> attempts_made;
  std::array<std::uint64_t, kMostMachines> most_attempts;  ///< in a second
};

extern World* world;
extern std::array<char*, kMostMachines> disk_logs;
/// -1: not of the world. The library is preloaded, so a thread's place of it is known at its start.
[[gnu::tls_model("initial-exec")]] extern constinit thread_local int this_thread;

inline bool is_in_machine() { return this_thread > kController; }
inline Thread& myself() { return world->threads[static_cast<std::size_t>(this_thread)]; }
inline Machine& machine(int number) { return world->machines[static_cast<std::size_t>(number)]; }
inline int my_machine_number() { return myself().machine; }
inline Machine& my_machine() { return machine(my_machine_number()); }
inline constexpr Time kWallBegin = 1'790'000'000LL * kSecond;  // September 2026
inline Time my_wall_time() { return kWallBegin + world->now + my_machine().clock_offset; }

/// Makes the World anew in a memory file; the calling thread becomes the controller's.
void make_world(int memory, std::uint64_t seed);
/// The calling process is a machine's, and its thread that one. Returns when it has the turn.
void join_world(int memory, int thread);
bool is_first_thread();  ///< of its process

/// A place for a new thread of a machine, which may run at once. A crash of the simulator if there
/// is none left.
int add_thread(int machine);
/// The turn goes to another thread, or stays; the calling one's state is set before.
void pass_turn();
/// Waits until wake() or the deadline. True: woken.
bool block(Wait wait, const void* key, Time deadline);
/// Threads of the calling thread's machine that wait for `key`.
void wake(Wait wait, const void* key, int most);
/// Threads of a machine that wait for descriptors.
void wake_io(int machine);
/// Perhaps the turn goes to another thread here; and the machine may die here.
void interruption_point();
/// The calling thread ends, and passes the turn for the last time.
void end_thread();
/// The calling machine's program ends, and with it the process.
[[noreturn]] void end_machine(int status);
/// What the calling machine's program has installed.
std::map<int, void (*)(int)>& signal_handlers();
/// From now on no thread of the machine has the turn.
void forget_threads(int machine);

/// The controller goes on as soon as it is chosen.
void call_controller();
/// The controller waits for a time, or for news of a machine.
void run_until(Time time);

/// A new thread of the calling machine begins: returns when it has the turn.
void begin_thread(int thread);
/// Blocks until its kernel thread has begun.
void await_beginning(int thread);

// Events of the network; see network.cpp.
void add_event(Event event);
void handle(const Event& event);

/// A line of the trace: who and what.
void trace_line(int machine, std::string_view text);
template <class... Values>
void trace(int machine, fmt::format_string<Values...> format, Values&&... values) {
  trace_line(machine, fmt::format(format, std::forward<Values>(values)...));
}

[[noreturn]] void fail(std::string_view why);

}  // namespace orbbuf::simulation
