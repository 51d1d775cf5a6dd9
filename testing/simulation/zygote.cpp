// SPDX-License-Identifier: Apache-2.0
// A program that is not begun, but waits to be copied: the controller asks for a machine, and the
// program's main runs in a fork. So a start takes no dynamic linking.
#include "testing/simulation/zygote.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <string>
#include <vector>

#include "testing/simulation/disk.hpp"
#include "testing/simulation/real.hpp"
#include "testing/simulation/world.hpp"

namespace orbbuf::simulation {
namespace {

using Main = int (*)(int, char**, char**);

Main program = nullptr;

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at < text.size();) {
    parts.emplace_back(text.c_str() + at);
    at += parts.back().size() + 1;
  }
  return parts;
}

void crash(int signal) {
  if (!is_in_machine()) raw_call(SYS_exit_group, 128 + signal);
  trace(my_machine_number(), "CRASH: signal {}", signal);
  end_machine(128 + signal);
}

[[noreturn]] void run_machine(std::vector<std::string> parts, char** environment) {
  const int thread = std::stoi(parts.at(0));
  world_folder = parts.at(1);
  if (::chdir(world_folder.c_str()) != 0) fail("cannot enter the world's folder");
  const int none = ::open("/dev/null", O_RDWR);
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) ::dup2(none, fd);
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) ::signal(signal, crash);
  join_world(kWorldDescriptor, thread);
  std::vector<char*> arguments;
  for (std::size_t i = 2; i < parts.size(); ++i) arguments.push_back(parts[i].data());
  arguments.push_back(nullptr);
  end_machine(program(static_cast<int>(arguments.size() - 1), arguments.data(), environment));
}

/// A request is "start", or the number of a process to wait for; the answer is a number.
int serve(int /*count*/, char** /*arguments*/, char** environment) {
  for (;;) {
    std::array<char, 65536> bytes;
    const ssize_t got = ::recv(kZygoteDescriptor, bytes.data(), bytes.size(), 0);
    if (got <= 0) return 0;
    auto parts = split(std::string(bytes.data(), static_cast<std::size_t>(got)));
    int answer = 0;
    if (parts.front() == "start") {
      answer = ::fork();
      if (answer == 0) {
        ::close(kZygoteDescriptor);
        run_machine({parts.begin() + 1, parts.end()}, environment);
      }
    } else {
      ::waitpid(std::stoi(parts.front()), &answer, 0);
    }
    if (::send(kZygoteDescriptor, &answer, sizeof answer, 0) < 0) return 1;
  }
}

}  // namespace
}  // namespace orbbuf::simulation

extern "C" int simulated_start(orbbuf::simulation::Main main, int count, char** arguments,
                               void (*init)(), void (*fini)(), void (*loader_fini)(),
                               void* stack_end) __asm__("__libc_start_main");
extern "C" int simulated_start(orbbuf::simulation::Main main, int count, char** arguments,
                               void (*init)(), void (*fini)(), void (*loader_fini)(),
                               void* stack_end) {
  using Begin =
      int (*)(orbbuf::simulation::Main, int, char**, void (*)(), void (*)(), void (*)(), void*);
  const auto begin = orbbuf::simulation::real<Begin>("__libc_start_main");
  orbbuf::simulation::program = main;
  const bool is_wanted = ::getenv(orbbuf::simulation::kZygoteVariable) != nullptr;
  return begin(is_wanted ? orbbuf::simulation::serve : main, count, arguments, init, fini,
               loader_fini, stack_end);
}
