// SPDX-License-Identifier: Apache-2.0
// What it costs to have frames on the device before they are acknowledged, by four ways to get them
// there.
//   orbbuf-sync-cost FOLDER ROBOTS SECONDS [BYTES]
// Robots write 25 frames a second: an image by rename, and a line in each of two lists. Prints, for
// each way, the time from a frame's capture until it is on the device, and what share of the frames
// got there in time.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct Robot {
  fs::path folder;
  int times = -1;
  int checksums = -1;
  int folder_fd = -1;
};

struct Written {
  Clock::time_point captured;
  std::size_t robot;
  int image;
};

std::vector<Robot> make_robots(const fs::path& root, int count) {
  std::vector<Robot> robots;
  for (int i = 0; i < count; ++i) {
    Robot robot{root / std::to_string(i), -1, -1, -1};
    fs::create_directories(robot.folder / "images");
    const auto list = [&](const char* name) {
      return ::open((robot.folder / name).c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
    };
    robot.times = list("times.txt");
    robot.checksums = list("checksums.sfv");
    robot.folder_fd = ::open((robot.folder / "images").c_str(), O_RDONLY | O_DIRECTORY);
    robots.push_back(robot);
  }
  return robots;
}

void must(bool is_done, const char* what) {
  if (is_done) return;
  std::perror(what);
  std::exit(EXIT_FAILURE);
}

int write_frame(const Robot& robot, int sequence, const std::string& jpeg) {
  const auto temporary = robot.folder / "incoming.tmp";
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  must(fd >= 0 && ::write(fd, jpeg.data(), jpeg.size()) == static_cast<ssize_t>(jpeg.size()),
       "write");
  fs::rename(temporary, robot.folder / "images" / (std::to_string(sequence) + ".jpg"));
  const std::string line = std::to_string(sequence) + " 1600000000.000000000 0.000000\n";
  must(::write(robot.checksums, line.data(), line.size()) > 0, "checksums");
  must(::write(robot.times, line.data(), line.size()) > 0, "times");
  return fd;
}

void sync_one(const Robot& robot, const Written& frame) {
  must(::fdatasync(frame.image) == 0, "fdatasync");
  must(::fsync(robot.folder_fd) == 0, "fsync");
  must(::fdatasync(robot.checksums) == 0 && ::fdatasync(robot.times) == 0, "fdatasync");
}

/// As io_uring does it: its workers block in fsync, too.
void sync_in_parallel(const std::vector<Robot>& robots, const std::vector<Written>& group) {
  std::vector<std::jthread> workers;
  const std::size_t count = std::min<std::size_t>(group.size(), 16);
  for (std::size_t w = 0; w < count; ++w) {
    workers.emplace_back([&, w] {
      for (std::size_t i = w; i < group.size(); i += count)
        sync_one(robots[group[i].robot], group[i]);
    });
  }
}

void sync_group(const std::string& way, int root_fd, int log, const std::string& jpeg,
                const std::vector<Robot>& robots, const std::vector<Written>& group) {
  if (way == "syncfs") must(::syncfs(root_fd) == 0, "syncfs");
  if (way == "each") {
    for (const Written& frame : group) sync_one(robots[frame.robot], frame);
  }
  if (way == "parallel") sync_in_parallel(robots, group);
  if (way == "log") {  // each frame is written a second time, in one file
    for (std::size_t i = 0; i < group.size(); ++i) {
      must(::write(log, jpeg.data(), jpeg.size()) > 0, "log");
    }
    must(::fdatasync(log) == 0, "fdatasync");
  }
}

void run(const std::string& way, const fs::path& root, int robot_count, double seconds,
         std::size_t bytes) {
  const auto robots = make_robots(root / way, robot_count);
  const int root_fd = ::open(root.c_str(), O_RDONLY | O_DIRECTORY);
  const int log = ::open((root / (way + ".log")).c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
  std::string jpeg(bytes, 'x');
  for (char& byte : jpeg) byte = static_cast<char>(std::rand());
  const auto begin = Clock::now();
  const auto total = static_cast<int>(seconds * 25);
  std::vector<double> ms;
  int next = 0;
  while (next < total) {
    std::vector<Written> group;
    for (; next < total && Clock::now() >= begin + std::chrono::milliseconds(40) * next; ++next) {
      for (std::size_t r = 0; r < robots.size(); ++r) {
        group.push_back(
            {begin + std::chrono::milliseconds(40) * next, r, write_frame(robots[r], next, jpeg)});
      }
    }
    if (!group.empty()) sync_group(way, root_fd, log, jpeg, robots, group);
    const auto now = Clock::now();
    for (const Written& frame : group) {
      ms.push_back(std::chrono::duration<double, std::milli>(now - frame.captured).count());
      ::close(frame.image);
    }
    if (now > begin + std::chrono::duration<double>(2 * seconds)) break;
    std::this_thread::sleep_until(begin + std::chrono::milliseconds(40) * next);
  }
  const double took = std::chrono::duration<double>(Clock::now() - begin).count();
  std::sort(ms.begin(), ms.end());
  std::printf("RESULT sync.%s robots=%d frames_a_second=%.0f median_ms=%.1f p99_ms=%.1f\n",
              way.c_str(), robot_count, static_cast<double>(ms.size()) / took, ms[ms.size() / 2],
              ms[ms.size() * 99 / 100]);
  fs::remove_all(root / way);
  fs::remove(root / (way + ".log"));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return EXIT_FAILURE;
  const fs::path root = argv[1];
  const std::size_t bytes = argc > 4 ? std::strtoul(argv[4], nullptr, 10) : 40000;
  for (const char* way : {"none", "each", "parallel", "syncfs", "log"}) {
    run(way, root, std::atoi(argv[2]), std::atof(argv[3]), bytes);
  }
}
