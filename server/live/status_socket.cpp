// SPDX-License-Identifier: Apache-2.0
#include "server/live/status_socket.hpp"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <chrono>
#include <cstdlib>
#include <utility>
#include <vector>

#include "server/runtime/private_socket.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using Protocol = asio::local::stream_protocol;
using boost::system::error_code;

constexpr std::chrono::seconds kPatience{5};
/// systemd's, of the unit that the package installs.
constexpr const char* kServiceSocket = "/run/orbbuf-server/status";

fs::path in_folder_of(const char* variable, const char* name) {
  const char* const folder = std::getenv(variable);  // NOLINT(concurrency-mt-unsafe)
  return folder == nullptr || *folder == '\0' ? fs::path() : fs::path(folder) / name;
}

fs::path own_socket() { return in_folder_of("XDG_RUNTIME_DIR", "orbbuf-server.sock"); }

Result<std::string> ask(const fs::path& path) {
  asio::io_context io;
  Protocol::socket socket(io);
  error_code failed;
  try {
    socket.connect(Protocol::endpoint(path.string()), failed);
  } catch (const boost::system::system_error& error) {  // a path too long for a socket
    failed = error.code();
  }
  if (failed) return Error{path.string() + ": " + failed.message()};
  std::string table;
  bool is_whole = false;
  asio::async_read(socket, asio::dynamic_buffer(table), [&](const error_code& ended, std::size_t) {
    is_whole = ended == asio::error::eof && !table.empty();
  });
  io.run_for(kPatience);
  if (!is_whole) return Error{path.string() + ": no answer"};
  if (!table.ends_with('\n')) return Error{path.string() + ": the answer was cut short"};
  return table;
}

constexpr std::size_t kColumns = 17;
constexpr std::size_t kWords = 3;  // at the left of their columns; numbers are at the right
using Row = std::array<std::string, kColumns>;

std::string to_text(std::optional<std::chrono::nanoseconds> age) {
  if (!age) return "-";
  return to_seconds(*age) < 1 ? fmt::format("{:.0f} ms", std::max(0.0, 1e3 * to_seconds(*age)))
                              : fmt::format("{:.1f} s", to_seconds(*age));
}

Row row_of(const RobotMetrics& robot, RobotMetrics::Time now) {
  const bool is_connected = robot.is_connected();
  Row row{robot.info().robot_id, robot.info().session_id, robot.state(),
          fmt::format("{:.1f}", robot.frame_rate(now)),
          robot.is_ended() ? "-" : to_text(robot.timeline().age(now))};
  std::fill(row.begin() + 5, row.end(), std::string(1, '-'));
  row[13] = std::to_string(robot.late());
  if (robot.quality() > 0) row[15] = std::to_string(robot.quality());
  row[16] = std::to_string(robot.reduced());
  if (const auto& held = robot.on_robot()) {
    row[14] = held->present == held->all ? std::to_string(held->all)
                                         : fmt::format("{}/{}", held->present, held->all);
  }
  if (!robot.report()) return row;
  const wire::Report& report = *robot.report();
  const wire::Stats& stats = report.stats;
  row[5] = fmt::format("{}/{}", stats.waiting, report.capacity);
  if (is_connected)
    row[6] = fmt::format("{:.2f} MB/s", static_cast<double>(report.link_rate) / 1e6);
  if (is_connected && report.round_trip_us > 0) {
    row[7] = fmt::format("{:.1f} ms", report.round_trip_us / 1e3);
  }
  row[8] = std::to_string(stats.captured);
  row[9] = std::to_string(stats.acknowledged);
  row[10] = std::to_string(stats.dropped);
  row[11] = std::to_string(stats.skipped);
  row[12] = std::to_string(stats.failed);
  return row;
}

}  // namespace

std::string to_table(const Metrics& metrics, RobotMetrics::Time now) {
  std::vector<Row> rows{{"ROBOT", "SESSION", "STATE", "FRAMES/S", "AGE", "BUFFER", "LINK",
                         "ROUND TRIP", "CAPTURED", "DELIVERED", "DROPPED", "SKIPPED", "FAILED",
                         "LATE", "ON ROBOT", "QUALITY", "REDUCED"}};
  for (const auto& [id, robot] : metrics.robots()) rows.push_back(row_of(*robot, now));
  std::array<std::size_t, kColumns> widths{};
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < kColumns; ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string table;
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < kColumns; ++i) {
      if (i > 0) table += "  ";
      table += i < kWords ? fmt::format("{:<{}}", row[i], widths[i])
                          : fmt::format("{:>{}}", row[i], widths[i]);
    }
    table += '\n';
  }
  return table;
}

fs::path status_socket_path(const std::string& setting) {
  if (setting != kAutomaticSocket) return setting;
  const fs::path service = in_folder_of("RUNTIME_DIRECTORY", "status");
  return service.empty() ? own_socket() : service;
}

StatusSocket::StatusSocket(asio::io_context& main, fs::path path, const Metrics& metrics)
    : path_(std::move(path)),
      metrics_(metrics),
      acceptor_(listen_privately(main, "status.socket", path_)),
      retry_(main) {}

StatusSocket::~StatusSocket() { ::unlink(path_.c_str()); }

void StatusSocket::stop() {
  error_code ignored;  // it is closed either way
  acceptor_.close(ignored);
  retry_.cancel();
}

void StatusSocket::accept() {
  acceptor_.async_accept([this](const error_code& failed, Protocol::socket socket) {
    if (!acceptor_.is_open() || failed == asio::error::operation_aborted) return;
    if (failed) return accept_later();  // no descriptors, of which the robots' listener tells
    const std::string table = to_table(metrics_, RobotMetrics::Clock::now());
    error_code ignored;  // the client has gone
    socket.non_blocking(true, ignored);
    socket.write_some(asio::buffer(table), ignored);
    accept();
  });
}

void StatusSocket::accept_later() {
  retry_.expires_after(kRetry);
  retry_.async_wait([this](const error_code& aborted) {
    if (!aborted && acceptor_.is_open()) accept();
  });
}

Result<std::string> ask_status(const std::string& setting) {
  std::vector<fs::path> paths{setting};
  if (setting == kAutomaticSocket) paths = {own_socket(), kServiceSocket};
  std::string tried;
  for (const fs::path& path : paths) {
    if (path.empty()) continue;
    auto table = ask(path);
    if (table) return table;
    tried += (tried.empty() ? "" : "; ") + table.error().text;
  }
  return Error{"no server answers: " + (tried.empty() ? "status.socket is off" : tried)};
}

}  // namespace orbbuf
