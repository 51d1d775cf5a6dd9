// SPDX-License-Identifier: Apache-2.0
#include "tests/e2e/rig.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <iterator>
#include <sstream>
#include <stdexcept>

#include "testing/source_folder.hpp"
#include "tests/e2e/programs.hpp"

namespace orbbuf::test {
namespace fs = std::filesystem;

namespace {

std::size_t count_files(const fs::path& folder) {
  if (!exists(folder)) return 0;
  const auto files = fs::directory_iterator(folder);
  return static_cast<std::size_t>(std::distance(begin(files), end(files)));
}

}  // namespace

Server::Server(const fs::path& out, const Overrides& overrides, const std::string& listen,
               const std::vector<std::string>& where) {
  std::vector<std::string> command = where;
  command.insert(command.end(), {kOrbbufServer, "--set", "listen.address=" + listen, "--set",
                                 "files.path=" + out.string()});
  process_ = std::make_unique<Process>(with_settings(std::move(command), overrides));
  address_ = word_after(process_->require_line("listening on "), "listening on ");
}

std::vector<std::string> robot_command(const std::string& id, const std::string& server,
                                       const Overrides& overrides,
                                       const std::vector<std::string>& where) {
  std::vector<std::string> command = where;
  command.insert(command.end(), {kOrbbufd, "--set", "robot.id=" + id, "--set",
                                 "link.server=" + server, "--set", "link.drain_timeout=60 s"});
  return with_settings(std::move(command), overrides);
}

Overrides replay(const fs::path& folder) {
  return {"source.kind=folder", "source.path=" + folder.string(), "source.realtime=false"};
}

fs::path shared_sequence(const std::string& name) {
  const fs::path folder = fs::path(kSourceFolder) / ".." / "shared/data/sequences" / name;
  return exists(folder) ? folder : fs::path();
}

bool wait_for_drops(Process& robot) {
  const std::string stats = "] captured ";
  for (int lines = 1; lines <= 200 && robot.wait_for_lines(stats, lines); ++lines) {
    if (robot.count_lines(stats) > robot.count_lines(" dropped 0 ")) return true;
  }
  return false;
}

Record read_record(const fs::path& out, const std::string& robot) {
  std::vector<fs::path> sessions;
  if (exists(out / robot)) {
    std::ranges::copy(fs::directory_iterator(out / robot), std::back_inserter(sessions));
  }
  if (sessions.size() != 1) {
    throw std::runtime_error("not one session but " + std::to_string(sessions.size()) + " in " +
                             (out / robot).string());
  }
  Record record;
  record.folder = sessions.front();
  // Until it is closed a session has no drops.csv.
  if (read_file(record.folder / "session.txt").find("state ended") == std::string::npos) {
    const Finished views = run({kOrbbufServer, "views", record.folder});
    if (views.status != 0) throw std::runtime_error(views.output);
  }
  for (const std::string& line : read_lines(record.folder / "times.txt")) {
    std::istringstream fields(line);
    std::uint64_t id = 0;
    std::string time;
    fields >> id >> time;
    record.delivered.push_back(id);
    record.times.push_back(time);
  }
  std::vector<std::string> drops = read_lines(record.folder / "drops.csv");
  if (!drops.empty()) drops.erase(drops.begin());
  record.drop_lines = drops.size();
  for (const std::string& line : drops) {
    const std::size_t comma = line.find(',');
    record.dropped[std::stoull(line)] = line.substr(comma + 1, line.rfind(',') - comma - 1);
  }
  record.images = count_files(record.folder / "images");
  record.images_right = count_files(record.folder / "images_right");
  return record;
}

void expect_exactly_once(const Record& record, std::uint64_t captured) {
  EXPECT_EQ(record.delivered.size() + record.dropped.size(), captured);
  EXPECT_EQ(record.drop_lines, record.dropped.size()) << "a drop is recorded twice";
  EXPECT_EQ(record.images, record.delivered.size());
  const bool is_stereo = record.images_right > 0;
  EXPECT_EQ(record.images_right, is_stereo ? record.delivered.size() : 0);
  std::int64_t last = -1;
  for (const std::uint64_t id : record.delivered) {
    EXPECT_GT(static_cast<std::int64_t>(id), last);
    last = static_cast<std::int64_t>(id);
    EXPECT_LT(id, captured);
    EXPECT_FALSE(record.dropped.contains(id)) << "frame " << id << " delivered and dropped";
    char name[32];
    std::snprintf(name, sizeof name, "%06llu.jpg", static_cast<unsigned long long>(id));
    EXPECT_TRUE(exists(record.folder / "images" / name)) << name;
    EXPECT_EQ(exists(record.folder / "images_right" / name), is_stereo) << name;
  }
}

// No std::regex: with asan, g++ 12 warns of what it finds in there.
std::map<std::string, std::uint64_t> closing_stats(const Process& robot) {
  static const std::string kBegin = "session ended: ";
  const std::string output = robot.output();
  const std::size_t begin = output.find(kBegin);
  if (begin == std::string::npos) throw std::runtime_error("no closing stats in: " + output);
  const std::string stats =
      output.substr(begin + kBegin.size(), output.find('\n', begin) - begin - kBegin.size());
  std::map<std::string, std::uint64_t> counts;
  std::istringstream words(stats);
  std::string name;
  for (std::string word; words >> word;) {
    if (word == "=" || word == "+") {
      name.clear();
    } else if (std::isdigit(static_cast<unsigned char>(word[0])) != 0) {
      counts[name] = std::stoull(word);
    } else {
      name += (name.empty() ? "" : " ") + word;
    }
  }
  EXPECT_EQ(counts.size(), 7U) << stats;
  EXPECT_EQ(counts["captured"], counts["skipped"] + counts["failed"] + counts["dropped"] +
                                    counts["acknowledged"] + counts["waiting"] +
                                    counts["in flight"])
      << stats;
  return counts;
}

}  // namespace orbbuf::test
