// SPDX-License-Identifier: Apache-2.0
#include "server/fleet_commands.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/file_io.hpp"
#include "common/journal/journal.hpp"
#include "common/log.hpp"
#include "server/dataset/check_session.hpp"
#include "server/dataset/join_session.hpp"
#include "server/fleet/fetch_segment.hpp"
#include "server/live/control_socket.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

struct JoinOptions {
  std::string session;
  std::vector<std::string> paths;
  std::vector<std::string> etcd;
  std::string output;
};

fleet::SessionName name_of(const std::string& text) {
  const auto slash = text.find('/');
  fleet::SessionName name{text.substr(0, slash),
                          slash == std::string::npos ? "" : text.substr(slash + 1)};
  if (wire::is_valid_id(name.robot_id) && wire::is_valid_id(name.session_id)) return name;
  throw std::runtime_error("not ROBOT/SESSION: " + text);
}

/// The segments' folders below a server's files.path.
void find_local(const fs::path& files, const fleet::SessionName& session,
                std::vector<fs::path>& folders) {
  std::error_code failed;
  std::set<fs::path> found;
  fs::directory_iterator entry(files / session.robot_id, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const auto folder = fleet::parse_folder(entry->path().filename().string());
    if (folder.session_id == session.session_id) found.insert(entry->path());
  }
  folders.insert(folders.end(), found.begin(), found.end());
}

/// Of the session's name: whether one of the folders is the first segment, or, of a server that the
/// robot came to later, has late frames only.
bool has_segment(const std::vector<fs::path>& folders, const std::string& name) {
  return std::ranges::any_of(folders, [&](const fs::path& path) {
    const auto summary = path.filename() == name ? read_summary(path) : std::nullopt;
    return summary && (summary->totals.live > 0 || summary->totals.late == 0);
  });
}

/// Whether one of the folders is what that page shows by that name: its newest journal is.
bool is_here(const std::vector<fs::path>& folders, const Address& page,
             const fleet::SessionName& session, const std::string& name) {
  return std::ranges::any_of(folders, [&](const fs::path& path) {
    const auto segments = journal::segments_in(path);
    if (path.filename() != name || !segments || segments.value().empty()) return false;
    const auto journal = journal::segment_path("", segments.value().back());
    const auto there = fleet::fetch_file(page, session.robot_id, name, journal.string());
    const auto here = read_text(path / journal);
    return there && here && there.value() == here.value();
  });
}

std::vector<Address> etcd_of(const JoinOptions& options) {
  std::vector<Address> endpoints;
  for (const std::string& text : options.etcd) {
    auto address = parse_address(text);
    if (!address) throw std::runtime_error("--etcd: " + address.error().text);
    endpoints.push_back(std::move(address).value());
  }
  return endpoints;
}

/// What no local path has: the segments that etcd knows, and late frames that came to a server
/// which the robot was at later. Those are in a folder of the session's name, too.
void fetch_others(const JoinOptions& options, const fleet::SessionName& session,
                  const fs::path& fetched, std::vector<fs::path>& folders) {
  const auto found = fleet::find_session(etcd_of(options), session);
  if (!found) throw std::runtime_error(found.error().text);
  const std::vector<fs::path> local = folders;
  std::set<std::pair<std::string, std::string>> wanted;  // server, folder
  for (const auto& [segment, http] : found.value().segments) {
    const std::string folder = folder_of(session.session_id, segment);
    if (!parse_address(http) && !has_segment(local, folder)) {
      log_warn("{}: is at {}, whose page is not there; give its files.path, or begin it", folder,
               segment.server);
    }
    wanted.emplace(segment.server, folder);
  }
  for (const fleet::ServerEntry& server : found.value().servers) {
    wanted.emplace(server.name, session.session_id);
    const auto page = parse_address(server.http);
    if (!page) continue;
    for (const auto& [name, folder] : wanted) {
      if (name != server.name || is_here(local, page.value(), session, folder)) continue;
      const fs::path to = fetched / server.name / folder;
      const auto error = fleet::fetch_segment(page.value(), session.robot_id, folder, to);
      if (error) throw std::runtime_error(error->text);
      if (!fs::exists(to)) continue;
      log_info("{}: fetched from {}, {}", folder, server.name, server.http);
      folders.push_back(to);
    }
  }
}

int join(const JoinOptions& options) {
  const fleet::SessionName session = name_of(options.session);
  const fs::path out = options.output.empty() ? session.session_id : options.output;
  const fs::path fetched = out.string() + ".fetched";
  std::vector<fs::path> folders;
  for (const std::string& path : options.paths) find_local(path, session, folders);
  if (!options.etcd.empty()) fetch_others(options, session, fetched, folders);
  const auto joined = join_session(folders, out);
  fs::remove_all(fetched);
  if (!joined) throw std::runtime_error(joined.error().text);
  const JoinReport& report = joined.value();
  for (const std::string& problem : report.problems) {
    std::cout << out.string() << ": " << problem << '\n';
  }
  std::cout << out.string() << ": " << report.segments << " segments, " << report.frames
            << " frames; in two segments: " << report.repeats << '\n';
  const auto checked = check_session(out);
  if (!checked) throw std::runtime_error(checked.error().text);
  for (const std::string& problem : checked.value().problems) {
    std::cout << out.string() << ": " << problem << '\n';
  }
  std::cout << out.string() << ": " << summary(checked.value()) << '\n';
  return report.problems.empty() && checked.value().problems.empty() ? EXIT_SUCCESS : EXIT_FAILURE;
}

void add_join(CommandLine& app, std::function<int()>& command) {
  const auto options = std::make_shared<JoinOptions>();
  auto join_app = app.add_subcommand(
      "join", "Make one session of the parts that several servers of a fleet have recorded",
      [&command, options] { command = [options] { return join(*options); }; });
  join_app.add_option("SESSION", options->session, "ROBOT/SESSION").required().value_name("");
  join_app.add_option("PATH", options->paths, "files.path of a server, as it is on this machine")
      .value_name("");
  join_app
      .add_option("--etcd", options->etcd,
                  "The fleet's etcd, to fetch the parts of other servers from their pages; "
                  "repeatable")
      .value_name("HOST:PORT")
      .one_by_one();
  join_app.add_option("--output", options->output, "Folder to make; without one, SESSION")
      .value_name("DIR");
  join_app.add_footer("Then it checks what it has made, as `check` does.");
}

int drain(const std::string& setting, int patience_s) {
  const auto answer = ask_server(setting, "drain", std::chrono::seconds(patience_s));
  if (answer) return EXIT_SUCCESS;
  log_error("drain: {}", answer.error().text);
  return EXIT_FAILURE;
}

void add_drain(CommandLine& app, std::function<int()>& command) {
  constexpr int kPatience = 60;
  const auto socket = std::make_shared<std::string>(kAutomaticSocket);
  const auto patience = std::make_shared<int>(kPatience);
  auto drain_app = app.add_subcommand(
      "drain", "Have the server that runs send its robots to other servers of its fleet, and wait",
      [&command, socket, patience] {
        command = [socket, patience] { return drain(*socket, *patience); };
      });
  drain_app.add_option("SOCKET", *socket, "Its status.socket; without one, this user's server")
      .value_name("");
  drain_app.add_option("--timeout", *patience, "Wait so long at most, in seconds")
      .value_name("SECONDS")
      .in_range(1, 1e6);
  drain_app.add_footer(
      "Exit status 0: no robot is there any more, others have all, and the server can be stopped.\n"
      "It takes none until it is started again.");
}

}  // namespace

void add_fleet_commands(CommandLine& app, std::function<int()>& command) {
  add_join(app, command);
  add_drain(app, command);
}

}  // namespace orbbuf
