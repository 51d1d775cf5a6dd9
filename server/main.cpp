// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/command_line.hpp"
#include "common/config.hpp"
#include "common/log.hpp"
#include "common/net/tls.hpp"
#include "common/wire.hpp"
#include "server/dataset/check_session.hpp"
#include "server/dataset/export_session.hpp"
#include "server/dataset/join_session.hpp"
#include "server/live/control_socket.hpp"
#include "server/runtime/lock_folder.hpp"
#include "server/serve.hpp"
#include "server/session/views.hpp"
#include "server/settings.hpp"
#include "server/sink/make_sinks.hpp"

namespace {

/// What the command line asks for, to be run when all of it has been read: the exit status.
using Command = std::function<int()>;

struct ServeOptions {
  std::string config;
  std::vector<std::string> overrides;
  bool is_check = false;
};

int serve(const ServeOptions& options) {
  orbbuf::ConfigReader reader(options.config, options.overrides);
  const orbbuf::Settings settings = orbbuf::load_settings(reader);
  if (options.is_check) {
    orbbuf::make_tls_context(settings.listen.tls);
    std::cout << (options.config.empty() ? "defaults" : options.config) << ": OK\n";
    return EXIT_SUCCESS;
  }
  orbbuf::set_log_level(settings.log_level);
  orbbuf::serve(settings, [&options] {
    orbbuf::ConfigReader again(options.config, options.overrides);
    return orbbuf::load_settings(again).listen.robots;
  });
  if (!end_sinks(settings.sinks)) std::_Exit(EXIT_SUCCESS);
  return EXIT_SUCCESS;
}

/// Without a subcommand.
void add_serve(orbbuf::CommandLine& app, Command& command) {
  const auto options = std::make_shared<ServeOptions>();
  app.add_option("--config", options->config,
                 "Configuration file (TOML); without one, the defaults")
      .value_name("FILE");
  app.add_option("--set", options->overrides, "Override a configuration value; repeatable")
      .value_name("TABLE.KEY=VALUE")
      .one_by_one();
  app.add_flag("--check-config", options->is_check, "Check the configuration and exit");
  command = [options] { return serve(*options); };
}

/// Whether `folder` is among the sessions that a server has open, as it says.
bool is_open(const std::string& folder, const std::string& open_sessions) {
  std::error_code ignored;  // then checking says why
  const auto path = std::filesystem::canonical(folder, ignored).string();
  return ('\n' + open_sessions).find('\n' + path + '\n') != std::string::npos;
}

int check(const std::vector<std::string>& sessions) {
  bool is_good = true;
  const auto open =
      orbbuf::ask_server(orbbuf::kAutomaticSocket, "sessions", std::chrono::seconds(5));
  for (const std::string& session : sessions) {
    const auto report = orbbuf::check_session(session, open && is_open(session, open.value()));
    if (!report) {
      orbbuf::log_error("{}", report.error().text);
      is_good = false;
      continue;
    }
    for (const std::string& problem : report.value().problems) {
      std::cout << session << ": " << problem << '\n';
    }
    for (const std::string& note : report.value().notes) {
      std::cout << session << ": " << note << '\n';
    }
    std::cout << session << ": " << summary(report.value()) << std::endl;
    is_good = is_good && report.value().problems.empty();
  }
  return is_good ? EXIT_SUCCESS : EXIT_FAILURE;
}

/// While a server uses the folder of all sessions it keeps times.txt up itself.
std::optional<orbbuf::Error> make_views(const std::filesystem::path& session) {
  orbbuf::UniqueFd lock;
  auto views = orbbuf::Views::kAll;
  try {
    lock = orbbuf::lock_folder(std::filesystem::absolute(session / ".." / ".."));
  } catch (const std::runtime_error&) {
    orbbuf::log_info("{}: a server uses its folder, so times.txt stays as it is", session.string());
    views = orbbuf::Views::kAllButTimes;
  }
  return orbbuf::make_views(session, views);
}

int make_all_views(const std::vector<std::string>& sessions) {
  bool is_good = true;
  for (const std::string& session : sessions) {
    const auto error = make_views(session);
    if (error) orbbuf::log_error("{}", error->text);
    is_good = is_good && !error;
  }
  return is_good ? EXIT_SUCCESS : EXIT_FAILURE;
}

/// A subcommand whose arguments are folders of sessions.
orbbuf::CommandLine add_for_sessions(orbbuf::CommandLine& app, Command& command,
                                     const std::string& name, const std::string& about,
                                     int (*run)(const std::vector<std::string>& sessions)) {
  const auto sessions = std::make_shared<std::vector<std::string>>();
  auto added = app.add_subcommand(name, about, [&command, sessions, run] {
    command = [sessions, run] { return run(*sessions); };
  });
  added.add_option("SESSION", *sessions, "Folder of a session, PATH/ROBOT/SESSION")
      .required()
      .value_name("");
  return added;
}

struct ExportOptions {
  std::string layout;
  bool has_png_names = false;
  std::string session;
  std::string out;
};

int export_session(const ExportOptions& options) {
  const auto at = std::ranges::find(orbbuf::kLayouts, options.layout) - orbbuf::kLayouts.begin();
  const auto report =
      orbbuf::export_session(options.session, options.out, static_cast<orbbuf::Layout>(at),
                             options.has_png_names ? "png" : "jpg");
  if (!report) throw std::runtime_error(report.error().text);
  for (const std::string& note : report.value().notes) orbbuf::log_warn("{}", note);
  std::cout << options.out << ": " << options.layout << ", " << report.value().frames
            << " frames; images linked: " << report.value().linked
            << ", copied: " << report.value().copied << '\n';
  return EXIT_SUCCESS;
}

void add_export(orbbuf::CommandLine& app, Command& command) {
  const auto options = std::make_shared<ExportOptions>();
  auto export_app = app.add_subcommand(
      "export", "Make a data set of a recorded session: EuRoC, KITTI, TUM RGB-D, TUM monoVO, MCAP",
      [&command, options] { command = [options] { return export_session(*options); }; });
  const std::vector<std::string> layouts(orbbuf::kLayouts.begin(), orbbuf::kLayouts.end());
  export_app.add_option("--layout", options->layout, "tum-mono, euroc, kitti, tum-rgbd or mcap")
      .required()
      .value_name("LAYOUT")
      .one_of(layouts);
  export_app.add_flag("--png-names", options->has_png_names,
                      "Name the images .png, JPEG as they are: for loaders that look for nothing "
                      "else and open them with OpenCV, which goes by the content");
  export_app.add_option("SESSION", options->session, "Folder of a session, PATH/ROBOT/SESSION")
      .required()
      .value_name("");
  export_app.add_option("OUT", options->out, "Folder to make; it must not be there, or be empty")
      .required()
      .value_name("");
  export_app.add_footer(
      "Images are hard links to the session's where the file system allows it, else copies; do "
      "not\n"
      "edit them in place. The session may still be recorded: what it has by then is exported.");
}

int status(const std::string& socket) {
  const auto table = orbbuf::ask_server(socket, "status", std::chrono::seconds(5));
  if (!table) {
    orbbuf::log_error("{}", table.error().text);
    return EXIT_FAILURE;
  }
  std::cout << table.value();
  return EXIT_SUCCESS;
}

void add_status(orbbuf::CommandLine& app, Command& command) {
  const auto socket = std::make_shared<std::string>(orbbuf::kAutomaticSocket);
  auto status_app =
      app.add_subcommand("status", "Show the robots of the server that runs, and how they do",
                         [&command, socket] { command = [socket] { return status(*socket); }; });
  status_app
      .add_option("SOCKET", *socket,
                  "Its status.socket; without one, this user's server, or the machine's service")
      .value_name("");
}

struct JoinOptions {
  std::string session;
  std::vector<std::filesystem::path> paths;
  std::filesystem::path output;
};

int join(const JoinOptions& options) {
  const auto slash = options.session.find('/');
  if (slash == std::string::npos ||
      !orbbuf::wire::is_valid_id(std::string_view(options.session).substr(0, slash)) ||
      !orbbuf::wire::is_valid_id(std::string_view(options.session).substr(slash + 1))) {
    throw std::runtime_error("not ROBOT/SESSION: " + options.session);
  }
  const std::filesystem::path out =
      options.output.empty() ? options.session.substr(slash + 1) : options.output.string();
  std::vector<std::filesystem::path> folders;
  for (const auto& path : options.paths) {
    if (exists(path / options.session)) folders.push_back(path / options.session);
  }
  const auto joined = orbbuf::join_session(folders, out);
  if (!joined) throw std::runtime_error(joined.error().text);
  for (const std::string& problem : joined.value().problems) {
    std::cout << out.string() << ": " << problem << '\n';
  }
  std::cout << out.string() << ": " << joined.value().parts << " folders, " << joined.value().frames
            << " frames; in two folders: " << joined.value().repeats << '\n';
  const int checked = check({out.string()});
  return joined.value().problems.empty() ? checked : EXIT_FAILURE;
}

void add_join(orbbuf::CommandLine& app, Command& command) {
  const auto options = std::make_shared<JoinOptions>();
  auto join_app =
      app.add_subcommand("join", "Make one session of what several servers have of it",
                         [&command, options] { command = [options] { return join(*options); }; });
  join_app.add_option("SESSION", options->session, "ROBOT/SESSION").required().value_name("");
  join_app.add_option("PATH", options->paths, "files.path of a server, or a copy of it")
      .required()
      .value_name("");
  join_app.add_option("--output", options->output, "Folder to make; without one, SESSION")
      .value_name("DIR");
  join_app.add_footer("Then it checks what it has made, as `check` does.");
}

int drain(const std::string& socket, int patience_s) {
  const auto answer = orbbuf::ask_server(socket, "drain", std::chrono::seconds(patience_s));
  if (answer) return EXIT_SUCCESS;
  orbbuf::log_error("drain: {}", answer.error().text);
  return EXIT_FAILURE;
}

void add_drain(orbbuf::CommandLine& app, Command& command) {
  constexpr int kPatience = 60;
  const auto socket = std::make_shared<std::string>(orbbuf::kAutomaticSocket);
  const auto patience = std::make_shared<int>(kPatience);
  auto drain_app = app.add_subcommand(
      "drain", "Have the server that runs take no robots any more, end its sessions, and wait",
      [&command, socket, patience] {
        command = [socket, patience] { return drain(*socket, *patience); };
      });
  drain_app.add_option("SOCKET", *socket, "Its status.socket; without one, this user's server")
      .value_name("");
  drain_app.add_option("--timeout", *patience, "Wait so long at most, in seconds")
      .value_name("SECONDS")
      .in_range(1, 1e6);
  drain_app.add_footer(
      "Exit status 0: no robot is there any more, and the server can be stopped.\n"
      "It takes none until it is started again.");
}

}  // namespace

int main(int argc, char** argv) try {
  orbbuf::set_up_log("info");
  orbbuf::CommandLine app("Receives frames from robots and hands them to SLAM programs.",
                          "orbbuf-server");
  app.add_version("orbbuf-server " ORBBUF_VERSION);
  Command command;
  add_serve(app, command);
  add_for_sessions(
      app, command, "check",
      "Compare recorded sessions with what was received: checksums, order, times, drops", check)
      .add_footer("A line for each problem and one for each session; exit status 0: no problem.");
  add_for_sessions(app, command, "views",
                   "Make the text files of recorded sessions again from their journals",
                   make_all_views);
  add_export(app, command);
  add_status(app, command);
  app.add_script(
      "add-robot", "Make a robot's key, certificate and configuration, for TLS",
      "Usage: orbbuf-server add-robot [OPTIONS] ROBOT\n\n"
      "Writes FOLDER/robots/ROBOT.tar, which `orbbufd setup` reads on the robot. The first "
      "time\nit also makes a CA and the server's certificate, and turns TLS on in\n"
      "FOLDER/orbbuf-server.toml.\n\nOptions:\n"
      "  --server HOST[:PORT]        Where robots reach the server; by default its first "
      "address\n"
      "  --folder FOLDER             By default /etc/orbbuf");
  app.add_script("doctor", "Name what is wrong on this machine, and what to do",
                 "Option:\n"
                 "  --config FILE               By default /etc/orbbuf/orbbuf-server.toml");
  add_join(app, command);
  add_drain(app, command);
  if (const auto status = app.parse(argc, argv)) return *status;
  return command();
} catch (const std::exception& error) {
  orbbuf::log_error("{}", error.what());
  return EXIT_FAILURE;
}
