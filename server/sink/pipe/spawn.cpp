// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/spawn.hpp"

#include <spawn.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <string_view>

namespace orbbuf {
namespace {

constexpr int kFirstDescriptorToClose = 3;

std::string_view variable(std::string_view entry) { return entry.substr(0, entry.find('=')); }

/// systemd means them for the server alone.
bool is_for_server_alone(std::string_view name) {
  constexpr std::array<std::string_view, 4> kNames = {"CREDENTIALS_DIRECTORY", "NOTIFY_SOCKET",
                                                      "WATCHDOG_PID", "WATCHDOG_USEC"};
  return std::ranges::find(kNames, name) != kNames.end();
}

/// `ours` first, and of the server's own what is not among it.
std::vector<std::string> merged_environment(const std::vector<std::string>& ours) {
  std::vector<std::string> merged = ours;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    if (is_for_server_alone(variable(*entry))) continue;
    bool is_ours = false;
    for (const auto& own : ours) is_ours = is_ours || variable(own) == variable(*entry);
    if (!is_ours) merged.emplace_back(*entry);
  }
  return merged;
}

/// As exec wants them; `texts` must stay as they are.
std::vector<char*> c_strings(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  pointers.reserve(texts.size() + 1);
  for (auto& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

int add_descriptors(posix_spawn_file_actions_t& actions, int input, int output) {
  int failed = posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
  if (failed == 0) failed = posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  if (failed == 0) failed = posix_spawn_file_actions_adddup2(&actions, output, STDERR_FILENO);
  if (failed != 0) return failed;
  return posix_spawn_file_actions_addclosefrom_np(&actions, kFirstDescriptorToClose);
}

}  // namespace

int spawn(const std::string& command, const std::vector<std::string>& environment, int input,
          int output, pid_t* pid) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  sigset_t defaults;
  sigemptyset(&defaults);
  for (const int ignored : {SIGPIPE, SIGUSR1, SIGUSR2}) sigaddset(&defaults, ignored);
  if (int failed = posix_spawn_file_actions_init(&actions)) return failed;
  int failed = posix_spawnattr_init(&attributes);
  if (failed == 0) {
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    failed = add_descriptors(actions, input, output);
    std::vector<std::string> arguments{"sh", "-c", command};
    std::vector<std::string> variables = merged_environment(environment);
    if (failed == 0) {
      failed = ::posix_spawn(pid, "/bin/sh", &actions, &attributes, c_strings(arguments).data(),
                             c_strings(variables).data());
    }
    posix_spawnattr_destroy(&attributes);
  }
  posix_spawn_file_actions_destroy(&actions);
  return failed;
}

}  // namespace orbbuf
