// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/world.hpp"

#include <fmt/format.h>
#include <linux/futex.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <iterator>
#include <new>
#include <string>
#include <utility>

#include "testing/simulation/fibers.hpp"
#include "testing/simulation/network.hpp"
#include "testing/simulation/real.hpp"

namespace orbbuf::simulation {

World* world = nullptr;
std::array<char*, kMostMachines> disk_logs{};
constinit thread_local int this_thread = -1;

namespace {

constexpr std::size_t kWorldBytes = (sizeof(World) + 4095) / 4096 * 4096;

void map_world(int memory) {
  const std::size_t bytes = kWorldBytes + kMostMachines * kDiskLogBytes;
  void* const mapped =
      ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_NORESERVE, memory, 0);
  if (mapped == MAP_FAILED) fail("no memory for the world");
  world = static_cast<World*>(mapped);
  for (std::size_t i = 0; i < kMostMachines; ++i) {
    disk_logs[i] = static_cast<char*>(mapped) + kWorldBytes + i * kDiskLogBytes;
  }
}

bool is_earlier(const Event& a, const Event& b) {
  return a.at != b.at ? a.at < b.at : a.order < b.order;
}
bool is_later(const Event& a, const Event& b) { return is_earlier(b, a); }

void run_due_events() {
  auto& events = world->events;
  while (world->events_used > 0 && events[0].at <= world->now) {
    std::pop_heap(events.begin(), events.begin() + world->events_used, is_later);
    const Event event = events[static_cast<std::size_t>(--world->events_used)];
    handle(event);
  }
}

void make_runnable(Thread& thread, bool was_woken) {
  if (thread.state == State::kBlocked && thread.wait == Wait::kMutex) {
    --machine(thread.machine).mutex_waiters;
  }
  thread.state = State::kRunnable;
  thread.was_woken = was_woken;
  thread.deadline = kNever;
}

Time frozen_until(const Thread& thread) {
  return thread.machine < 0 ? 0 : machine(thread.machine).frozen_until;
}

/// The thread that goes on, after all that happens before it does.
int choose() {
  std::array<int, kMostThreads> runnable;
  for (;;) {
    run_due_events();
    std::size_t count = 0;
    Time next = world->events_used > 0 ? world->events[0].at : kNever;
    for (int i = 0; i < world->threads_used; ++i) {
      Thread& thread = world->threads[static_cast<std::size_t>(i)];
      if (thread.state == State::kFree) continue;
      if (thread.state == State::kBlocked && thread.deadline <= world->now) {
        make_runnable(thread, false);
      }
      const Time frozen = frozen_until(thread);
      if (thread.state == State::kBlocked) {
        next = std::min(next, std::max(thread.deadline, frozen));
      } else if (frozen > world->now) {
        next = std::min(next, frozen);
      } else {
        runnable[count++] = i;
      }
    }
    if (count > 0) {
      world->now += world->random.between(kMicrosecond, 20 * kMicrosecond);
      return runnable[world->random.below(count)];
    }
    if (next == kNever) {
      world->is_stuck = true;
      make_runnable(world->threads[kController], true);
      continue;
    }
    world->now = std::max(world->now, next);
  }
}

// Of the calling process.
int this_machine = -1;
int first_thread = kController;
std::array<Fiber*, kMostThreads> fibers;  // never deleted: kernel threads that end still use them
Fiber* ended = nullptr;

Fiber*& fiber(int thread) { return fibers[static_cast<std::size_t>(thread)]; }
int machine_of(int thread) { return world->threads[static_cast<std::size_t>(thread)].machine; }

/// Of all processes that wait for the turn, that of one machine.
long bit_of(int machine) { return 1L << static_cast<unsigned>(machine + 1); }

void give_turn(int thread) {
  ++world->switches;
  const int machine = machine_of(thread);
  world->current.store(thread, std::memory_order_release);
  if (machine == this_machine) return;
  // That machine may run from here on.
  raw_call(SYS_futex, reinterpret_cast<long>(&world->current), FUTEX_WAKE_BITSET, 1, 0, 0,
           bit_of(machine));
}

/// A fiber cannot give back the stack that it stands on: the next one does.
void give_back_ended() {
  if (ended != nullptr) give_back(*std::exchange(ended, nullptr));
}

/// Asks for the machine of a thread without having the turn. A place among the threads becomes this
/// machine's only while this machine has it, so that the answer is right in what counts.
void await_turn(int self) {
  for (;;) {
    const int next = world->current.load(std::memory_order_acquire);
    if (next == self) return;
    if (machine_of(next) == this_machine) {
      orbbuf_switch(fiber(self), fiber(next));
      give_back_ended();
    } else {
      raw_call(SYS_futex, reinterpret_cast<long>(&world->current), FUTEX_WAIT_BITSET, next, 0, 0,
               bit_of(this_machine));
    }
  }
}

void handle_signals() {
  if (!is_in_machine() || my_machine().signal == 0) return;
  const int signal = std::exchange(my_machine().signal, 0);
  const auto found = signal_handlers().find(signal);
  if (found != signal_handlers().end()) found->second(signal);
}

void die_here() {
  my_machine().is_dying = true;
  make_runnable(world->threads[kController], true);
  block(Wait::kParked, nullptr, kNever);
}

}  // namespace

long raw_call(long number, long a, long b, long c, long d, long e, long f) {
  using Call = long (*)(long, ...);
  ORBBUF_REAL(Call, "syscall");
  return real_function(number, a, b, c, d, e, f);
}

std::map<int, void (*)(int)>& signal_handlers() {
  static std::map<int, void (*)(int)> all;
  return all;
}

void fail(std::string_view why) {
  const auto line = fmt::format("orbbuf-simulate: {}\n", why);
  raw_call(SYS_write, 2, reinterpret_cast<long>(line.data()), static_cast<long>(line.size()));
  raw_call(SYS_exit_group, 70);
  std::abort();
}

void make_world(int memory, std::uint64_t seed) {
  const std::size_t bytes = kWorldBytes + kMostMachines * kDiskLogBytes;
  if (::ftruncate(memory, 0) != 0 || ::ftruncate(memory, static_cast<off_t>(bytes)) != 0) {
    fail("no memory for the world");
  }
  if (world != nullptr) ::munmap(world, bytes);
  map_world(memory);
  new (world) World;  // the bytes of connections are zero, and are not touched
  world->random.state = seed;
  for (int i = 0; i < kMostMachines; ++i) world->at_address[static_cast<std::size_t>(i)] = i;
  this_thread = kController;
  world->threads[kController].state = State::kRunnable;
}

void join_world(int memory, int thread) {
  map_world(memory);
  this_thread = first_thread = thread;
  this_machine = my_machine_number();
  fiber(thread) = new Fiber;
  await_turn(thread);
}

bool is_first_thread() { return this_thread == first_thread; }

void begin_thread(int thread) {
  this_thread = thread;
  sigset_t all;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, nullptr);  // a handler would run on the stack that is lent
  orbbuf_lend(fiber(thread));
  give_back_ended();
}

void await_beginning(int thread) { await_loan(*fiber(thread)); }

int add_thread(int machine) {
  int place = 1;
  while (place < kMostThreads &&
         world->threads[static_cast<std::size_t>(place)].state != State::kFree) {
    ++place;
  }
  if (place == kMostThreads) fail("too many threads");
  Thread& thread = world->threads[static_cast<std::size_t>(place)];
  thread.state = State::kRunnable;
  thread.machine = machine;
  thread.deadline = kNever;
  if (is_in_machine()) fiber(place) = new Fiber;
  world->threads_used = std::max(world->threads_used, place + 1);
  return place;
}

void pass_turn() {
  const int self = this_thread;
  ++world->turns;
  const int next = choose();
  if (next == self) return handle_signals();
  give_turn(next);
  await_turn(self);
  handle_signals();
}

bool block(Wait wait, const void* key, Time deadline) {
  Thread& self = myself();
  self.state = State::kBlocked;
  self.wait = wait;
  self.key = key;
  self.deadline = deadline;
  if (wait == Wait::kMutex) ++my_machine().mutex_waiters;
  pass_turn();
  return self.was_woken;
}

void wake(Wait wait, const void* key, int most) {
  const int number = my_machine_number();
  if (wait == Wait::kMutex && machine(number).mutex_waiters == 0) return;
  for (int i = 0; i < world->threads_used && most > 0; ++i) {
    Thread& thread = world->threads[static_cast<std::size_t>(i)];
    if (thread.state == State::kBlocked && thread.machine == number && thread.wait == wait &&
        thread.key == key) {
      make_runnable(thread, true);
      --most;
    }
  }
}

void wake_io(int machine) {
  for (int i = 0; i < world->threads_used; ++i) {
    Thread& thread = world->threads[static_cast<std::size_t>(i)];
    if (thread.state == State::kBlocked && thread.machine == machine && thread.wait == Wait::kIo) {
      make_runnable(thread, true);
    }
  }
}

void interruption_point() {
  if (!is_in_machine()) return;
  Machine& mine = my_machine();
  if (mine.calls_until_death >= 0 && mine.calls_until_death-- == 0) die_here();
  if (world->random.one_in(64)) pass_turn();
}

void forget_threads(int machine) {
  world->machines[static_cast<std::size_t>(machine)].mutex_waiters = 0;
  for (int i = 1; i < world->threads_used; ++i) {
    Thread& thread = world->threads[static_cast<std::size_t>(i)];
    if (thread.state != State::kFree && thread.machine == machine) thread.state = State::kFree;
  }
  while (world->threads_used > 1 &&
         world->threads[static_cast<std::size_t>(world->threads_used - 1)].state == State::kFree) {
    --world->threads_used;
  }
}

void end_thread() {
  const int self = std::exchange(this_thread, -1);
  world->threads[static_cast<std::size_t>(self)].state = State::kFree;
  ++world->turns;
  const int next = choose();
  give_turn(next);
  ended = fiber(self);
  orbbuf_switch(ended, fiber(machine_of(next) == this_machine ? next : first_thread));
}

void end_machine(int status) {
  const int number = my_machine_number();
  Machine& mine = my_machine();
  mine.has_ended = true;
  mine.is_running = false;
  mine.status = status;
  close_all(number);
  forget_threads(number);
  make_runnable(world->threads[kController], true);
  this_thread = -1;
  give_turn(kController);  // which waits for this process
  raw_call(SYS_exit_group, 0);
  std::abort();
}

void call_controller() { make_runnable(world->threads[kController], true); }

void run_until(Time time) {
  if (time <= world->now) return;
  block(Wait::kSleep, nullptr, time);
}

void add_event(Event event) {
  if (world->events_used == kMostEvents) fail("too many events");
  event.order = ++world->orders;
  world->events[static_cast<std::size_t>(world->events_used++)] = event;
  std::push_heap(world->events.begin(), world->events.begin() + world->events_used, is_later);
}

void trace_line(int number, std::string_view text) {
  for (const char c : text)
    world->hash = (world->hash ^ static_cast<unsigned char>(c)) * 0x100000001B3U;
  world->hash = (world->hash ^ static_cast<std::uint64_t>(world->now)) * 0x100000001B3U;
  if (world->trace < 0) return;
  const std::string_view name = number < 0 ? "world" : machine(number).name.data();
  fmt::basic_memory_buffer<char, 4096> line;  // a program's own memory is as it is without a trace
  fmt::format_to(std::back_inserter(line), "{:>14.6f} {:<7} {}\n",
                 static_cast<double>(world->now) / 1e9, name, text);
  raw_call(SYS_write, world->trace, reinterpret_cast<long>(line.data()),
           static_cast<long>(line.size()));
}

}  // namespace orbbuf::simulation
