// SPDX-License-Identifier: Apache-2.0
// What a long session on the server's disk costs when it is opened again, each time by a process of
// its own: RESULT lines.
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include "bench/watched_process.hpp"
#include "common/command_line.hpp"
#include "server/session/session_store.hpp"
#include "testing/temporary_folder.hpp"

namespace {

namespace fs = std::filesystem;
using orbbuf::Durability;
using orbbuf::EncodedFrame;
using orbbuf::Sequence;
using orbbuf::SessionStore;

EncodedFrame frame(Sequence number) {
  EncodedFrame frame;
  frame.sequence = number;
  frame.capture_time_ns = static_cast<std::int64_t>(number) * 40'000'000;
  frame.jpeg.assign(100, static_cast<std::uint8_t>(number));
  frame.jpeg_crc = orbbuf::crc32(frame.jpeg);
  return frame;
}

void must(const std::optional<orbbuf::Error>& error) {
  if (error) throw std::runtime_error(error->text);
}

std::unique_ptr<SessionStore> open(const fs::path& folder) {
  auto store = SessionStore::open(folder, {"robot", "session", ""}, Durability::kAck);
  if (!store) must(store.error());
  return std::move(store).value();
}

/// All but the numbers that are 1 mod 50, which come late; the device is a second behind. Then the
/// server is killed.
void record(const fs::path& folder, std::size_t frames) {
  const auto store = open(folder);
  for (Sequence number = 0; number < frames; ++number) {
    if (number % 50 != 1) must(store->write(frame(number), 0));
    if (number % 25 == 0) store->set_kept(store->written());
  }
}

/// Time and memory of a process that does nothing else.
void measure(const char* name, const std::function<void()>& work) {
  std::fflush(stdout);
  const pid_t child = ::fork();
  if (child < 0) throw std::runtime_error("cannot fork");
  if (child == 0) {
    const orbbuf::bench::WatchedProcess self(::getpid());
    const double before_mib = static_cast<double>(self.resident_kib()) / 1024;
    const auto cpu_before = self.cpu_time();
    const auto begin = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    const std::chrono::duration<double> cpu = self.cpu_time() - cpu_before;
    const double mib = static_cast<double>(self.peak_kib()) / 1024 - before_mib;
    for (const auto& [what, value] :
         {std::pair("s", took.count()), {"cpu_s", cpu.count()}, {"mib", mib}}) {
      std::printf("RESULT session.%s_%s %.3f\n", name, what, value);
    }
    std::fflush(stdout);
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  if (status != 0) throw std::runtime_error(std::string(name) + " has failed");
}

}  // namespace

int main(int argc, char** argv) {
  orbbuf::CommandLine app("What a long session on the server's disk costs when it is opened again");
  std::size_t frames = 1'000'000;
  app.add_option("--frames", frames, "The session's").with_default();
  if (const auto status = app.parse(argc, argv)) return *status;
  try {
    const orbbuf::test::TemporaryFolder parent;
    const fs::path folder = parent / "robot" / "session";
    record(folder, frames);
    // A hello after a kill, a hello after an orderly end, the first late frame, the last account.
    measure("reopen", [&] { open(folder); });
    measure("late", [&] {
      if (const auto late = open(folder)->write_late(frame(1), 0); !late) must(late.error());
    });
    measure("views", [&] { must(open(folder)->close()); });
    measure("reopen_ended", [&] { open(folder); });
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "orbbuf-session: %s\n", error.what());
    return 1;
  }
}
