// SPDX-License-Identifier: Apache-2.0
#include "server/serve.hpp"

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "common/log.hpp"
#include "common/service_status.hpp"
#include "server/dataset/mcap/recording_parts.hpp"
#include "server/http/http_server.hpp"
#include "server/link/listener.hpp"
#include "server/live/control_socket.hpp"
#include "server/live/metrics.hpp"
#include "server/retention/retention.hpp"
#include "server/runtime/descriptors.hpp"
#include "server/runtime/listen_on.hpp"
#include "server/runtime/lock_folder.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::chrono::seconds kLastReaping{1};
/// A session occupies one at most. More than processors, since most wait for the disk.
constexpr unsigned kFilesThreads = 4;

std::shared_ptr<Retention> make_retention(asio::io_context& main, asio::thread_pool& files,
                                          const Settings& settings, const Listener& listener) {
  return std::make_shared<Retention>(
      main, files,
      Retention::Options{settings.sinks.files_path, settings.quota, settings.session_timeout},
      [&listener](const std::string& robot_id, const std::string& session_id) {
        return listener.is_in_use(robot_id, session_id);
      });
}

std::unique_ptr<RecordingParts> make_parts(asio::io_context& main, asio::thread_pool& files,
                                           const SinkSettings& sinks, Listener& listener) {
  if (!sinks.mcap_enabled) return nullptr;
  return std::make_unique<RecordingParts>(
      main, files, *listener.stores(),
      RecordingParts::Options{sinks.files_path, sinks.mcap_split, !sinks.files_enabled});
}

struct JoinAtEnd {
  asio::thread_pool& pool;
  ~JoinAtEnd() { pool.join(); }
};

/// Tells the service manager how the server does. Ready: from start() on. Fed: each time that a
/// message has gone from `main` to the `files` pool and back. So a `main` that is stuck is noticed,
/// and a disk on which all threads of the pool are; one slow session is not a reason to restart the
/// server. Thread-bound to `main`.
class Health {
 public:
  /// All must outlive it, and its run of `main`.
  Health(asio::io_context& main, asio::thread_pool& files, ServiceStatus& service,
         const Listener& listener)
      : main_(main),
        files_(files),
        service_(service),
        listener_(listener),
        address_(to_text(listener.endpoint())),
        timer_(main),
        interval_(service.interval()) {}

  void start() {
    service_.ready();
    report();
  }
  /// Nothing more is told, and no timer is left in `main`.
  void stop() {
    is_stopped_ = true;
    timer_.cancel();
  }

 private:
  void report() {
    if (is_stopped_) return;
    service_.status(
        fmt::format("listening on {}; robots connected: {}", address_, listener_.robots()));
    if (!std::exchange(is_asking_, true)) ask_files();
    timer_.expires_after(interval_);
    timer_.async_wait([this](const error_code& /*error*/) { report(); });
  }

  void ask_files() {
    asio::post(files_, [this] {
      asio::post(main_, [this] {
        is_asking_ = false;
        service_.feed();
      });
    });
  }

  asio::io_context& main_;
  asio::thread_pool& files_;
  ServiceStatus& service_;
  const Listener& listener_;
  const std::string address_;
  asio::steady_timer timer_;
  const std::chrono::microseconds interval_;
  bool is_asking_ = false;
  bool is_stopped_ = false;
};

/// SIGHUP never ends the server.
void await_reload(asio::signal_set& reload, const std::function<void()>& run) {
  reload.async_wait([&](const error_code& failed, int /*signal*/) {
    if (failed) return;
    run();
    await_reload(reload, run);
  });
}

void reload_robots(Listener& listener,
                   const std::function<std::vector<std::string>()>& read_robots) {
  try {
    auto robots = read_robots();
    log_info("SIGHUP: read listen.robots again: {}",
             robots.empty() ? "all robots" : fmt::format("{} robots", robots.size()));
    listener.allow(std::move(robots));
  } catch (const std::runtime_error& error) {
    log_error("SIGHUP: listen.robots stays as it was: {}", error.what());
  }
}

/// Where the place is ours to choose, that it is taken is no reason not to serve.
std::unique_ptr<ControlSocket> open_control(
    asio::io_context& main, const std::string& setting,
    std::map<std::string, ControlSocket::Command> commands) {
  const auto path = control_socket_path(setting);
  if (path.empty() && setting == kAutomaticSocket) {
    log_info(
        "`orbbuf-server status` will not show this server: XDG_RUNTIME_DIR is not set; set "
        "status.socket to a path");
  }
  if (path.empty()) return nullptr;
  try {
    return std::make_unique<ControlSocket>(main, path, std::move(commands));
  } catch (const std::runtime_error& error) {
    if (setting != kAutomaticSocket) throw;
    log_info("`orbbuf-server status` will not show this server: {}", error.what());
    return nullptr;
  }
}

/// The folders of the sessions that are open, a line each.
std::string folders_of(const Metrics& metrics, const std::filesystem::path& files) {
  std::error_code ignored;  // then there are none
  const auto folder = std::filesystem::canonical(files, ignored);
  std::string lines;
  for (const auto& [id, robot] : metrics.robots()) {
    if (!robot->is_ended()) lines += (folder / id / robot->info().session_id).string() + '\n';
  }
  return lines;
}

/// What `orbbuf-server status`, `check` and `drain` ask for. `listener` is there before the first
/// command.
std::map<std::string, ControlSocket::Command> commands_of(const Metrics& metrics,
                                                          const std::filesystem::path& files,
                                                          std::optional<Listener>& listener) {
  return {{"sessions",
           [&metrics, files](const ControlSocket::Answer& answer) {
             answer(folders_of(metrics, files));
           }},
          {"status",
           [&metrics](const ControlSocket::Answer& answer) {
             answer(to_table(metrics, RobotMetrics::Clock::now()));
           }},
          {"drain", [&listener](ControlSocket::Answer answer) {
             listener->drain([answer = std::move(answer)] { answer("drained\n"); });
           }}};
}

}  // namespace

void serve(const Settings& settings, const std::function<std::vector<std::string>()>& read_robots) {
  for (const int ignored : {SIGPIPE, SIGUSR1, SIGUSR2}) std::signal(ignored, SIG_IGN);
  std::signal(SIGCHLD, SIG_DFL);  // ignored, as some programs leave it, a child has no status
  check_sinks(settings.sinks);
  const UniqueFd lock =
      settings.sinks.is_kept() ? lock_folder(settings.sinks.files_path) : UniqueFd();
  allow_descriptors_for(settings.listen.max_connections + HttpServer::kMaxConnections +
                        FoxgloveServer::kMaxViewers);
  asio::thread_pool files(kFilesThreads);  // outlives `main`, whose queue has strands of it
  asio::io_context main(1);
  const JoinAtEnd end_of_files{files};  // its work reports to `main`
  name_threads(files, "files", kFilesThreads);
  begin_sinks(settings.sinks);
  Metrics metrics(settings.listen.max_robots, settings.http_address.has_value());
  std::optional<Listener> listening;
  const auto control = open_control(main, settings.status_socket,
                                    commands_of(metrics, settings.sinks.files_path, listening));
  std::optional<HttpServer> http;
  if (settings.http_address) http.emplace(main, files, settings, metrics);
  Listener& listener =
      listening.emplace(main, files, settings, http || control ? &metrics : nullptr);
  ServiceStatus service;
  Health health(main, files, service, listener);
  const auto retention = make_retention(main, files, settings, listener);
  listener.on_sink_failed([&] { retention->wake(); });
  const auto parts = make_parts(main, files, settings.sinks, listener);

  asio::signal_set reload(main, SIGHUP);
  const std::function<void()> on_reload = [&] {
    listener.reload_tls();
    if (http) http->use_tls(listener.tls());
    reload_robots(listener, read_robots);
  };
  await_reload(reload, on_reload);
  asio::signal_set signals(main, SIGINT, SIGTERM);
  signals.async_wait([&](const error_code& failed, int signal) {
    if (failed) return;
    log_info("stopping on signal {}", signal);
    service.stopping();
    signals.async_wait([](const error_code& aborted, int /*signal*/) {
      if (!aborted) std::_Exit(EXIT_FAILURE);
    });
    const auto end = [&] {
      signals.clear();  // from here on a signal ends the process as usual
      signals.cancel();
      reload.cancel();
      health.stop();
      retention->stop();
      if (http) http->stop();
      if (control) control->stop();
      main.stop();
    };
    listener.stop([&parts, end] { parts ? parts->stop(end) : end(); });
  });
  if (http) http->start();
  if (control) control->start();
  if (parts) parts->start();
  listener.start();
  health.start();
  if (settings.quota.is_set()) retention->start();
  main.run();
  main.restart();
  main.run_for(kLastReaping);  // commands that end soon after their input leave their status
  files.join();                // recordings get their index
}

}  // namespace orbbuf
