// SPDX-License-Identifier: Apache-2.0
#include "server/serve.hpp"

#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <latch>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "common/log.hpp"
#include "common/service_status.hpp"
#include "server/fleet/drain_socket.hpp"
#include "server/fleet/fleet.hpp"
#include "server/health.hpp"
#include "server/http/http_server.hpp"
#include "server/link/listener.hpp"
#include "server/live/status_socket.hpp"
#include "server/retention/retention.hpp"
#include "server/runtime/descriptors.hpp"
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

void name_threads(asio::thread_pool& files) {
  const auto all_there = std::make_shared<std::latch>(kFilesThreads);
  for (unsigned i = 0; i < kFilesThreads; ++i) {
    asio::post(files, [all_there] {
      name_this_thread("files");
      all_there->arrive_and_wait();  // so each thread runs this once
    });
  }
  all_there->wait();  // a pool that is stopped before would leave some waiting for the others
}

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
    spdlog::info("SIGHUP: read listen.robots again: {}",
                 robots.empty() ? "all robots" : fmt::format("{} robots", robots.size()));
    listener.allow(std::move(robots));
  } catch (const std::runtime_error& error) {
    spdlog::error("SIGHUP: listen.robots stays as it was: {}", error.what());
  }
}

/// Sends the robots away, for `orbbuf-server drain`.
std::function<void(fleet::DrainSocket::Done)> drain_of(fleet::Fleet& fleet, Listener& listener) {
  return [&](fleet::DrainSocket::Done done) {
    fleet.async_drain([&listener, done = std::move(done)](const std::optional<Error>& error) {
      if (error) return done(error);
      spdlog::info("draining: the robots are sent to other servers");
      listener.move_all([done] {
        spdlog::info("drained: no robot is here any more");
        done(std::nullopt);
      });
    });
  };
}

std::unique_ptr<fleet::DrainSocket> open_drain(asio::io_context& main, const std::string& setting,
                                               fleet::Fleet& fleet, Listener& listener) {
  const auto path = fleet::drain_socket_of(status_socket_path(setting));
  if (path.empty()) return nullptr;
  return std::make_unique<fleet::DrainSocket>(main, path, drain_of(fleet, listener));
}

/// Where the place is ours to choose, that it is taken is no reason not to serve.
std::unique_ptr<StatusSocket> open_status(asio::io_context& main, const std::string& setting,
                                          const Metrics& metrics) {
  const auto path = status_socket_path(setting);
  if (path.empty()) return nullptr;
  try {
    return std::make_unique<StatusSocket>(main, path, metrics);
  } catch (const std::runtime_error& error) {
    if (setting != kAutomaticSocket) throw;
    spdlog::info("`orbbuf-server status` will not show this server: {}", error.what());
    return nullptr;
  }
}

}  // namespace

void serve(const Settings& settings, const std::function<std::vector<std::string>()>& read_robots) {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGCHLD, SIG_DFL);  // ignored, as some programs leave it, a child has no status
  check_sinks(settings.sinks);
  const UniqueFd lock =
      settings.sinks.is_kept() ? lock_folder(settings.sinks.files_path) : UniqueFd();
  allow_descriptors_for(settings.listen.max_connections + HttpServer::kMaxConnections +
                        FoxgloveServer::kMaxViewers);
  asio::io_context main(1);
  asio::thread_pool files(kFilesThreads);  // ends before `main`, to which its work reports
  name_threads(files);
  begin_sinks(settings.sinks);
  Metrics metrics(settings.listen.max_robots, settings.http_address.has_value());
  const auto status = open_status(main, settings.status_socket, metrics);
  std::optional<HttpServer> http;
  const Listener* counted = nullptr;
  std::optional<fleet::Fleet> fleet;
  if (settings.fleet.is_on()) {
    fleet.emplace(main, settings.fleet,
                  [&counted] { return counted == nullptr ? 0 : counted->robots(); });
  }
  if (settings.http_address) {
    http.emplace(main, files, settings, metrics, fleet ? &*fleet : nullptr);
  }
  Listener listener(main, files, settings, http || status ? &metrics : nullptr);
  counted = &listener;
  std::unique_ptr<fleet::DrainSocket> drain;
  if (fleet) {
    listener.join(*fleet);
    drain = open_drain(main, status ? settings.status_socket : "", *fleet, listener);
  }
  ServiceStatus service;
  Health health(main, files, service, listener);
  const auto retention = make_retention(main, files, settings, listener);
  listener.on_sink_failed([&] { retention->wake(); });

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
    spdlog::info("stopping on signal {}", signal);
    service.stopping();
    signals.async_wait([](const error_code& aborted, int /*signal*/) {
      if (!aborted) std::_Exit(EXIT_FAILURE);
    });
    listener.stop([&] {
      signals.clear();  // from here on a signal ends the process as usual
      signals.cancel();
      reload.cancel();
      health.stop();
      retention->stop();
      if (http) http->stop();
      if (status) status->stop();
      if (drain) drain->stop();
      if (!fleet) return main.stop();
      fleet->async_stop([&main] { main.stop(); });
    });
  });
  if (http) http->start();
  if (status) status->start();
  if (fleet) fleet->start();
  if (drain) drain->start();
  listener.start();
  health.start();
  if (settings.quota.is_set()) retention->start();
  main.run();
  main.restart();
  main.run_for(kLastReaping);  // commands that end soon after their input leave their status
  files.join();                // recordings get their index
}

}  // namespace orbbuf
