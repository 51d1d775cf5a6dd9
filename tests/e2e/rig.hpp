// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "testing/process.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// `--set` arguments, one `table.key=value` each.
using Overrides = std::vector<std::string>;

/// The real orbbuf-server on a free port, writing into its own folder.
class Server {
 public:
  /// `where`: words put before the command, e.g. `ip netns exec NAME`.
  explicit Server(const std::filesystem::path& out, const Overrides& overrides = {},
                  const std::string& listen = "127.0.0.1:0",
                  const std::vector<std::string>& where = {});

  Process& process() { return *process_; }
  /// `HOST:PORT` that it listens on.
  const std::string& address() const { return address_; }

 private:
  std::unique_ptr<Process> process_;
  std::string address_;
};

/// The id of the one robot of most tests.
inline constexpr const char* kRobot = "turtlebot1";

/// The command of the real orbbufd, which has a minute for its last frames: a machine may be slow.
std::vector<std::string> robot_command(const std::string& id, const std::string& server,
                                       const Overrides& overrides,
                                       const std::vector<std::string>& where = {});

/// `--set` arguments to replay a folder of images without loss.
Overrides replay(const std::filesystem::path& folder);

/// A sequence of ../shared/data, or empty where that is absent.
std::filesystem::path shared_sequence(const std::string& name);

/// Waits until an stats that the robot has logged names dropped frames.
bool wait_for_drops(Process& robot);

/// What the server's folder says of one robot's only session.
struct Record {
  std::filesystem::path folder;
  std::vector<std::uint64_t> delivered;          ///< ids in times.txt, in the file's order
  std::vector<std::string> times;                ///< their times, as written
  std::map<std::uint64_t, std::string> dropped;  ///< sequence -> reason
  std::size_t drop_lines = 0;                    ///< lines in drops.csv less the header
  std::size_t images = 0;                        ///< files in images/
  std::size_t images_right = 0;                  ///< files in images_right/
};
Record read_record(const std::filesystem::path& out, const std::string& robot);

/// Checks that a record names each of `captured` frames exactly once, delivered or dropped, that
/// the delivered ones are in order, and that images/, as well as images_right/ if there are any,
/// holds exactly these.
void expect_exactly_once(const Record& record, std::uint64_t captured);

/// The robot's closing stats, `captured` first, as in its last log line; checks that it adds up.
std::map<std::string, std::uint64_t> closing_stats(const Process& robot);

}  // namespace orbbuf::test
