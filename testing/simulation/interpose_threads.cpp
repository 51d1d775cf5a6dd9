// SPDX-License-Identifier: Apache-2.0
// Time, threads and what they wait for, and all else in the C library that would make two runs
// differ. Outside a machine each function does what the library's does.
#include <errno.h>
#include <linux/futex.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <sys/random.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timex.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <set>
#include <utility>

#include "testing/simulation/network.hpp"
#include "testing/simulation/real.hpp"
#include "testing/simulation/world.hpp"

namespace orbbuf::simulation {
namespace {

using Start = void* (*)(void*);

using Name = std::array<char, 16>;

/// The kernel's is that of the one kernel thread. The first thread's is never asked for.
thread_local Name this_name{};

struct Beginning {
  Start start = nullptr;
  void* value = nullptr;
  int thread = -1;
  Name name;
};

/// Those that have ended, and that no other has joined.
std::set<pthread_t>& ended() {
  static auto* const all = new std::set<pthread_t>();
  return *all;
}

const void* key_of(pthread_t thread) {
  return reinterpret_cast<const void*>(thread);  // NOLINT: a number of no meaning here
}

/// Its destructor runs after those of thread_local objects.
pthread_key_t end_key() {
  static const pthread_key_t key = [] {
    pthread_key_t made{};
    pthread_key_create(&made, [](void*) {
      ended().insert(pthread_self());
      wake(Wait::kJoin, key_of(pthread_self()), kMostThreads);
      end_thread();
    });
    return made;
  }();
  return key;
}

void* run_thread(void* argument) {
  const Beginning beginning = *static_cast<Beginning*>(argument);
  delete static_cast<Beginning*>(argument);
  this_name = beginning.name;
  begin_thread(beginning.thread);
  pthread_setspecific(end_key(), &this_thread);
  return beginning.start(beginning.value);
}

Time to_time(const timespec& time) { return time.tv_sec * kSecond + time.tv_nsec; }

timespec to_timespec(Time time) {
  timespec result{};
  result.tv_sec = time / kSecond;
  result.tv_nsec = time % kSecond;
  return result;
}

bool is_wall_clock(clockid_t clock) {
  return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI;
}

/// The world's time of an absolute time of a clock.
Time world_time(clockid_t clock, const timespec& time) {
  const Time moment = to_time(time);
  const Time now = is_wall_clock(clock) ? my_wall_time() : world->now;
  return world->now + (moment - now);
}

int wait_for_condition(pthread_cond_t* condition, pthread_mutex_t* mutex, Time deadline) {
  pthread_mutex_unlock(mutex);
  const bool was_woken = block(Wait::kCondition, condition, deadline);
  pthread_mutex_lock(mutex);
  return was_woken ? 0 : ETIMEDOUT;
}

long futex(std::uint32_t* word, int operation, std::uint32_t value, const timespec* timeout) {
  const int command = operation & FUTEX_CMD_MASK;
  if (command == FUTEX_WAKE || command == FUTEX_WAKE_BITSET) {
    wake(Wait::kFutex, word, static_cast<int>(value));
    interruption_point();
    return 0;
  }
  if (command != FUTEX_WAIT && command != FUTEX_WAIT_BITSET) fail("an unknown futex operation");
  if (__atomic_load_n(word, __ATOMIC_ACQUIRE) != value) {
    errno = EAGAIN;
    return -1;
  }
  Time deadline = kNever;
  if (timeout != nullptr && command == FUTEX_WAIT) deadline = world->now + to_time(*timeout);
  if (timeout != nullptr && command == FUTEX_WAIT_BITSET) {
    const bool is_wall = (operation & FUTEX_CLOCK_REALTIME) != 0;
    deadline = world_time(is_wall ? CLOCK_REALTIME : CLOCK_MONOTONIC, *timeout);
  }
  if (block(Wait::kFutex, word, deadline)) return 0;
  errno = ETIMEDOUT;
  return -1;
}

void fill_randomly(void* into, std::size_t bytes) {
  auto* const begin = static_cast<unsigned char*>(into);
  std::generate(begin, begin + bytes,
                [] { return static_cast<unsigned char>(world->random.next() >> 32U); });
}

}  // namespace

}  // namespace orbbuf::simulation

using namespace orbbuf::simulation;  // NOLINT: what follows are the C library's names

// Time.

ORBBUF_INTERPOSE(int, clock_gettime, clockid_t clock, timespec* time) {
  ORBBUF_REAL(int (*)(clockid_t, timespec*), "clock_gettime");
  if (!is_in_machine()) return real_function(clock, time);
  *time = to_timespec(is_wall_clock(clock) ? my_wall_time() : world->now);
  return 0;
}
ORBBUF_INTERPOSE(int, gettimeofday, timeval* time, void* zone) {
  ORBBUF_REAL(int (*)(timeval*, void*), "gettimeofday");
  if (!is_in_machine()) return real_function(time, zone);
  time->tv_sec = my_wall_time() / kSecond;
  time->tv_usec = my_wall_time() % kSecond / 1000;
  return 0;
}
ORBBUF_INTERPOSE(time_t, time, time_t* time) {
  ORBBUF_REAL(time_t(*)(time_t*), "time");
  if (!is_in_machine()) return real_function(time);
  const time_t now = my_wall_time() / kSecond;
  if (time != nullptr) *time = now;
  return now;
}
ORBBUF_INTERPOSE(int, adjtimex, timex* values) {
  ORBBUF_REAL(int (*)(timex*), "adjtimex");
  return is_in_machine() ? TIME_OK : real_function(values);
}
ORBBUF_INTERPOSE(int, nanosleep, const timespec* time, timespec* rest) {
  ORBBUF_REAL(int (*)(const timespec*, timespec*), "nanosleep");
  if (!is_in_machine()) return real_function(time, rest);
  block(Wait::kSleep, nullptr, world->now + to_time(*time));
  return 0;
}
ORBBUF_INTERPOSE(int, clock_nanosleep, clockid_t clock, int flags, const timespec* time,
                 timespec* rest) {
  ORBBUF_REAL(int (*)(clockid_t, int, const timespec*, timespec*), "clock_nanosleep");
  if (!is_in_machine()) return real_function(clock, flags, time, rest);
  const bool is_absolute = (flags & TIMER_ABSTIME) != 0;
  block(Wait::kSleep, nullptr,
        is_absolute ? world_time(clock, *time) : world->now + to_time(*time));
  return 0;
}
ORBBUF_INTERPOSE(int, usleep, useconds_t time) {
  ORBBUF_REAL(int (*)(useconds_t), "usleep");
  if (!is_in_machine()) return real_function(time);
  block(Wait::kSleep, nullptr, world->now + time * kMicrosecond);
  return 0;
}
ORBBUF_INTERPOSE(int, sched_yield) {
  ORBBUF_REAL(int (*)(), "sched_yield");
  if (!is_in_machine()) return real_function();
  // libstdc++ yields some times before it waits: 4 on x86, 16 on ARM. The turns must be the same.
  constexpr int kMost = 64;
  static thread_local int in_a_row = 0;
  static thread_local std::uint64_t turns = 0;
  if (std::exchange(turns, world->turns) != world->turns) in_a_row = 0;
  if (++in_a_row < kMost) return 0;
  pass_turn();
  return 0;
}

// Threads.

ORBBUF_INTERPOSE(int, pthread_create, pthread_t* made, const pthread_attr_t* attributes,
                 Start start, void* value) {
  ORBBUF_REAL(int (*)(pthread_t*, const pthread_attr_t*, Start, void*), "pthread_create");
  if (!is_in_machine()) return real_function(made, attributes, start, value);
  const int thread = add_thread(my_machine_number());
  const int failed =
      real_function(made, attributes, run_thread, new Beginning{start, value, thread, this_name});
  if (failed != 0) fail("cannot create a thread");
  await_beginning(thread);
  ended().erase(*made);
  return 0;
}
ORBBUF_INTERPOSE(int, pthread_join, pthread_t thread, void** result) {
  ORBBUF_REAL(int (*)(pthread_t, void**), "pthread_join");
  if (!is_in_machine()) return real_function(thread, result);
  while (!ended().contains(thread)) block(Wait::kJoin, key_of(thread), kNever);
  ended().erase(thread);
  return real_function(thread, result);
}
// What they wait for.

ORBBUF_INTERPOSE(int, pthread_mutex_lock, pthread_mutex_t* mutex) {
  ORBBUF_REAL(int (*)(pthread_mutex_t*), "pthread_mutex_lock");
  if (!is_in_machine()) return real_function(mutex);
  for (;;) {
    const int failed = pthread_mutex_trylock(mutex);
    if (failed != EBUSY) return failed;
    block(Wait::kMutex, mutex, kNever);
  }
}
ORBBUF_INTERPOSE(int, pthread_mutex_unlock, pthread_mutex_t* mutex) {
  ORBBUF_REAL(int (*)(pthread_mutex_t*), "pthread_mutex_unlock");
  const int failed = real_function(mutex);
  if (is_in_machine()) wake(Wait::kMutex, mutex, 1);
  return failed;
}
ORBBUF_INTERPOSE(int, pthread_cond_wait, pthread_cond_t* condition, pthread_mutex_t* mutex) {
  ORBBUF_REAL(int (*)(pthread_cond_t*, pthread_mutex_t*), "pthread_cond_wait");
  if (!is_in_machine()) return real_function(condition, mutex);
  return wait_for_condition(condition, mutex, kNever);
}
ORBBUF_INTERPOSE(int, pthread_cond_timedwait, pthread_cond_t* condition, pthread_mutex_t* mutex,
                 const timespec* until) {
  ORBBUF_REAL(int (*)(pthread_cond_t*, pthread_mutex_t*, const timespec*),
              "pthread_cond_timedwait");
  if (!is_in_machine()) return real_function(condition, mutex, until);
  // Asio's conditions go by the monotonic clock, others by that of the wall; both lie years apart.
  constexpr time_t kLongAfterStart = 100'000'000;
  const bool is_wall = until->tv_sec > kLongAfterStart;
  return wait_for_condition(condition, mutex,
                            world_time(is_wall ? CLOCK_REALTIME : CLOCK_MONOTONIC, *until));
}
ORBBUF_INTERPOSE(int, pthread_cond_clockwait, pthread_cond_t* condition, pthread_mutex_t* mutex,
                 clockid_t clock, const timespec* until) {
  ORBBUF_REAL(int (*)(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*),
              "pthread_cond_clockwait");
  if (!is_in_machine()) return real_function(condition, mutex, clock, until);
  return wait_for_condition(condition, mutex, world_time(clock, *until));
}
ORBBUF_INTERPOSE(int, pthread_cond_signal, pthread_cond_t* condition) {
  ORBBUF_REAL(int (*)(pthread_cond_t*), "pthread_cond_signal");
  if (!is_in_machine()) return real_function(condition);
  wake(Wait::kCondition, condition, 1);
  interruption_point();
  return 0;
}
ORBBUF_INTERPOSE(int, pthread_cond_broadcast, pthread_cond_t* condition) {
  ORBBUF_REAL(int (*)(pthread_cond_t*), "pthread_cond_broadcast");
  if (!is_in_machine()) return real_function(condition);
  wake(Wait::kCondition, condition, kMostThreads);
  interruption_point();
  return 0;
}
extern "C" long simulated_syscall(long number, ...) __asm__("syscall");
extern "C" long simulated_syscall(long number, ...) {
  va_list list;
  va_start(list, number);
  long values[6];
  for (long& value : values) value = va_arg(list, long);
  va_end(list);
  if (number == SYS_futex && is_in_machine()) {
    return futex(reinterpret_cast<std::uint32_t*>(values[0]), static_cast<int>(values[1]),
                 static_cast<std::uint32_t>(values[2]),
                 reinterpret_cast<const timespec*>(values[3]));
  }
  return raw_call(number, values[0], values[1], values[2], values[3], values[4], values[5]);
}

// Signals: the world's only.

ORBBUF_INTERPOSE(int, sigaction, int signal, const struct sigaction* action,
                 struct sigaction* old) {
  ORBBUF_REAL(int (*)(int, const struct sigaction*, struct sigaction*), "sigaction");
  if (!is_in_machine()) return real_function(signal, action, old);
  if (old != nullptr) *old = {};
  if (action == nullptr) return 0;
  if (action->sa_handler == SIG_DFL || action->sa_handler == SIG_IGN) {
    signal_handlers().erase(signal);
  } else {
    signal_handlers()[signal] = action->sa_handler;
  }
  return 0;
}

// What is random, and who one is.

extern "C" unsigned simulated_random_device(void* device) __asm__(
    "_ZNSt13random_device9_M_getvalEv");
extern "C" unsigned simulated_random_device(void* device) {
  ORBBUF_REAL(unsigned (*)(void*), "_ZNSt13random_device9_M_getvalEv");
  if (!is_in_machine()) return real_function(device);
  return static_cast<unsigned>(world->random.next() >> 32U);
}
ORBBUF_INTERPOSE(ssize_t, getrandom, void* into, size_t bytes, unsigned flags) {
  ORBBUF_REAL(ssize_t(*)(void*, size_t, unsigned), "getrandom");
  if (!is_in_machine()) return real_function(into, bytes, flags);
  fill_randomly(into, bytes);
  return static_cast<ssize_t>(bytes);
}
ORBBUF_INTERPOSE(int, getentropy, void* into, size_t bytes) {
  ORBBUF_REAL(int (*)(void*, size_t), "getentropy");
  if (!is_in_machine()) return real_function(into, bytes);
  fill_randomly(into, bytes);
  return 0;
}
ORBBUF_INTERPOSE(pid_t, getpid) {
  if (!is_in_machine()) return static_cast<pid_t>(raw_call(SYS_getpid));
  return 1000 * (1 + my_machine_number()) + my_machine().start;
}
ORBBUF_INTERPOSE(pid_t, gettid) {
  if (!is_in_machine()) return static_cast<pid_t>(raw_call(SYS_gettid));
  return is_first_thread() ? simulated_getpid() : 100'000 + this_thread;
}
ORBBUF_INTERPOSE(int, pthread_setname_np, pthread_t thread, const char* name) {
  ORBBUF_REAL(int (*)(pthread_t, const char*), "pthread_setname_np");
  if (!is_in_machine() || thread != pthread_self()) return real_function(thread, name);
  std::snprintf(this_name.data(), this_name.size(), "%s", name);
  return 0;
}
ORBBUF_INTERPOSE(int, pthread_getname_np, pthread_t thread, char* name, size_t bytes) {
  ORBBUF_REAL(int (*)(pthread_t, char*, size_t), "pthread_getname_np");
  if (!is_in_machine() || thread != pthread_self()) return real_function(thread, name, bytes);
  std::snprintf(name, bytes, "%s", this_name.data());
  return 0;
}
ORBBUF_INTERPOSE(void, exit, int status) {
  if (is_in_machine()) end_machine(status);
  ORBBUF_REAL(void (*)(int), "exit");
  real_function(status);
  __builtin_unreachable();
}
ORBBUF_INTERPOSE(void, _exit, int status) {
  if (is_in_machine()) end_machine(status);
  raw_call(SYS_exit_group, status);
}
ORBBUF_INTERPOSE(void, _Exit, int status) {
  if (is_in_machine()) end_machine(status);
  raw_call(SYS_exit_group, status);
}
