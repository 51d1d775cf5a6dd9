// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/programs.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/personality.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <stdexcept>

#include "testing/simulation/disk.hpp"
#include "testing/simulation/network.hpp"
#include "testing/simulation/world.hpp"
#include "testing/simulation/zygote.hpp"

namespace orbbuf::simulation {

Program::Program(const std::filesystem::path& file, const std::filesystem::path& library,
                 int memory, std::vector<std::string> emulator) {
  emulator.push_back(file);
  std::vector<char*> words;
  words.reserve(emulator.size() + 1);
  for (std::string& word : emulator) words.push_back(word.data());
  words.push_back(nullptr);
  std::array<int, 2> sockets{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets.data()) != 0) {
    throw std::runtime_error("cannot make a socket pair");
  }
  process_ = ::fork();
  if (process_ < 0) throw std::runtime_error("cannot fork");
  if (process_ == 0) {
    ::personality(ADDR_NO_RANDOMIZE);
    ::dup2(memory, kWorldDescriptor);
    ::dup2(sockets[1], kZygoteDescriptor);
    ::setenv("LD_PRELOAD", library.c_str(), 1);
    ::setenv("LD_BIND_NOW", "1", 1);  // once, not in each copy
    ::setenv(kZygoteVariable, "1", 1);
    ::unsetenv("XDG_RUNTIME_DIR");
    ::execvp(words[0], words.data());
    ::_exit(127);
  }
  ::close(sockets[1]);
  socket_ = sockets[0];
}

Program::~Program() {
  ::close(socket_);  // it then ends
  ::waitpid(process_, nullptr, 0);
}

int Program::ask(const std::string& request) const {
  int answer = 0;
  if (::send(socket_, request.data(), request.size(), MSG_NOSIGNAL) < 0 ||
      ::recv(socket_, &answer, sizeof answer, 0) != sizeof answer) {
    throw std::runtime_error("a program that machines are copies of has ended");
  }
  return answer;
}

void Program::start(int number, const std::vector<std::string>& arguments) {
  Machine& one = machine(number);
  const int thread = add_thread(number);
  one.is_running = one.is_on = true;
  one.has_ended = one.is_dying = false;
  one.signal = 0;
  one.frozen_until = 0;
  one.calls_until_death = -1;
  one.started = world->now;
  ++one.start;
  std::string request = "start";
  for (const std::string& part : {std::to_string(thread), world_folder}) request += '\0' + part;
  for (const std::string& part : arguments) request += '\0' + part;
  one.pid = ask(request + '\0');
}

void Program::kill(int number) {
  Machine& one = machine(number);
  if (one.pid <= 0) return;
  ::kill(one.pid, SIGKILL);
  ask(std::to_string(one.pid) + '\0');
  one.pid = 0;
  one.is_running = false;
  close_all(number);
  forget_threads(number);
}

}  // namespace orbbuf::simulation
