// SPDX-License-Identifier: Apache-2.0
// Half hellos, half requests, half handshakes, sessions without end, and servers that send robots
// to nowhere, while three real robots stream whose links are cut, and a probe asks for /healthz.
#include <fmt/core.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/run_program.hpp"
#include "bench/strangers/crowd.hpp"
#include "bench/strangers/probe.hpp"
#include "bench/strangers/relay.hpp"
#include "bench/watched_process.hpp"
#include "common/address.hpp"
#include "common/command_line.hpp"
#include "common/wire.hpp"
#include "testing/certificates.hpp"
#include "testing/process.hpp"
#include "testing/robot_client.hpp"

namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
namespace wire = orbbuf::wire;
using asio::ip::tcp;
using orbbuf::bench::Crowd;
using orbbuf::bench::Probe;
using orbbuf::bench::Relay;
using orbbuf::test::Certificates;
using orbbuf::test::Process;
using orbbuf::test::with_settings;
using Bytes = std::vector<std::uint8_t>;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using Words = std::vector<std::string>;

constexpr std::size_t kRobots = 3;
constexpr std::size_t kHalfHellos = 1100;
constexpr std::size_t kHalfRequests = 200;
constexpr std::size_t kHalfHandshakes = 1000;
constexpr std::uint64_t kMostMib = 64;
constexpr double kMostReconnectS = 3;

struct Options {
  fs::path robot;
  fs::path server;
  fs::path work;
  double seconds = 10;
};

struct Totals {
  std::uint64_t captured = 0;
  std::uint64_t lost = 0;
  std::size_t probes = 0;
  std::size_t probe_failures = 0;
  double probe_longest_s = 0;
  std::uint64_t server_kib = 0;
  double reconnect_worst_s = 0;
  std::size_t strangers = 0;
  std::size_t sessions = 0;
  double redirected_hellos_per_s = 0;
};

Words operator+(Words words, const Words& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

tcp::endpoint endpoint_in(const std::string& line, const std::string& before) {
  const auto address = orbbuf::parse_address(orbbuf::test::word_after(line, before)).value();
  return {asio::ip::make_address(address.host), address.port};
}

/// The number before `name` or behind it, of the robot's closing line.
std::uint64_t count_of(const std::string& line, const std::string& name) {
  const auto at = line.find(name + " ");
  if (at == std::string::npos) throw std::runtime_error("no " + name + " in: " + line);
  return std::stoull(line.substr(at + name.size() + 1));
}

Bytes hello(const std::string& robot, const std::string& session) {
  wire::Hello hello;
  hello.robot_id = robot;
  hello.session_id = session;
  hello.software = "stranger";
  return wire::encode(hello);
}

Bytes text(std::string_view words) { return {words.begin(), words.end()}; }

/// What a client of TLS says first.
Bytes client_hello() {
  const std::unique_ptr<SSL_CTX, void (*)(SSL_CTX*)> context(::SSL_CTX_new(::TLS_client_method()),
                                                             &::SSL_CTX_free);
  const std::unique_ptr<SSL, void (*)(SSL*)> tls(::SSL_new(context.get()), &::SSL_free);
  ::SSL_set_bio(tls.get(), ::BIO_new(::BIO_s_mem()), ::BIO_new(::BIO_s_mem()));
  ::SSL_connect(tls.get());
  Bytes bytes(4096);
  const int count = ::BIO_read(::SSL_get_wbio(tls.get()), bytes.data(), int(bytes.size()));
  if (count <= 0) throw std::runtime_error("OpenSSL begins no handshake");
  bytes.resize(static_cast<std::size_t>(count));
  return bytes;
}

/// An io_context and the thread that runs it.
class Loop {
 public:
  Loop() : work_(io_.get_executor()), thread_([this] { io_.run(); }) {}
  ~Loop() { stop(); }
  /// What is there stays, and nothing runs any more. Harmless when repeated.
  void stop() {
    io_.stop();
    if (thread_.joinable()) thread_.join();
  }
  asio::io_context& io() { return io_; }
  /// Returns when that thread has run it.
  template <class Run>
  void on(Run run) {
    std::promise<void> done;
    asio::post(io_, [&] {
      run();
      done.set_value();
    });
    done.get_future().get();
  }

 private:
  asio::io_context io_;
  asio::executor_work_guard<asio::io_context::executor_type> work_;
  std::thread thread_;
};

/// A real server, three real robots whose links can be cut, and the probe.
class Stage {
 public:
  Stage(const Options& options, const std::string& name, const Certificates* keys, Totals& totals)
      : options_(options),
        totals_(totals),
        files_(options.work / name),
        server_(with_settings({options.server.string()},
                              Words{"listen.address=127.0.0.1:0", "http.address=127.0.0.1:0",
                                    "files.path=" + files_.string(), "status.socket="} +
                                  (keys ? Certificates::overrides(keys->server()) : Words{}))) {
    link_ = endpoint_in(server_.require_line("listening on "), "listening on ");
    const std::string scheme = keys ? "https://" : "http://";
    page_ = endpoint_in(server_.require_line("live page on "), scheme);
    for (std::size_t i = 0; i < kRobots; ++i) {
      auto& relay = relays_.emplace_back();
      loop_.on([&] { relay = std::make_unique<Relay>(loop_.io(), link_); });
      const std::string id = fmt::format("r{}", i);
      robots_.push_back(std::make_unique<Process>(with_settings(
          {options.robot.string()},
          Words{"robot.id=" + id, "link.server=127.0.0.1:" + std::to_string(relay->port()),
                "link.drain_timeout=1 min", "buffer.policy=uniform", "buffer.capacity=1000",
                "source.fps=25", "source.width=160", "source.height=120",
                "source.frames=1000000000"} +
              (keys ? Certificates::overrides(keys->of(id)) : Words{}))));
      robots_.back()->require_line("connected to ");
    }
    probe_ = std::make_unique<Probe>(page_, keys ? keys->of("r0") : orbbuf::TlsSettings{});
  }

  ~Stage() { loop_.stop(); }
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

  asio::io_context& io() { return loop_.io(); }
  const tcp::endpoint& link() const { return link_; }
  const tcp::endpoint& page() const { return page_; }

  void bear(const char* what, const tcp::endpoint& to, std::size_t size,
            std::function<Bytes()> words, bool leaves_when_answered = false) {
    auto crowd = std::make_shared<Crowd>(
        io(), Crowd::Options{to, size, 2000, leaves_when_answered, std::move(words)});
    loop_.on([&] { crowd->start(); });
    bear(what);
    loop_.on([&] { crowd->stop(); });
    std::printf("strangers: %s: %zu connections\n", what, crowd->count());
    totals_.strangers += crowd->count();
  }
  /// The robots' links are cut meanwhile, one after the other.
  void bear(const char* what) {
    const auto end =
        Clock::now() + std::chrono::duration_cast<Clock::duration>(Seconds(options_.seconds));
    std::this_thread::sleep_for(Seconds(options_.seconds / 4));
    for (std::size_t i = 0; i < kRobots; ++i) {
      const int before = robots_[i]->count_lines("connected to ");
      const auto begun = Clock::now();
      loop_.on([&] { relays_[i]->cut(); });
      if (!robots_[i]->wait_for_lines("connected to ", before + 1)) {
        throw std::runtime_error(std::string(what) +
                                 ": a robot does not come back: " + robots_[i]->output());
      }
      totals_.reconnect_worst_s =
          std::max(totals_.reconnect_worst_s, Seconds(Clock::now() - begun).count());
    }
    std::this_thread::sleep_until(end);
  }
  void end() {
    probe_->stop();
    totals_.probes += probe_->count();
    totals_.probe_failures += probe_->failures();
    totals_.probe_longest_s = std::max(totals_.probe_longest_s, Seconds(probe_->longest()).count());
    for (const auto& robot : robots_) {
      robot->signal(SIGTERM);
      robot->wait();
      const std::string line = robot->require_line("session ended: ");
      const auto captured = count_of(line, "captured");
      totals_.captured += captured;
      totals_.lost += captured - count_of(line, "acknowledged") - count_of(line, "skipped");
    }
    loop_.on([&] {
      for (const auto& relay : relays_) relay->stop();
    });
    const orbbuf::bench::WatchedProcess watched(server_.pid());
    totals_.server_kib = std::max(totals_.server_kib, watched.peak_kib());
    server_.signal(SIGTERM);
    if (server_.wait() != 0) throw std::runtime_error("the server failed: " + server_.output());
  }
  std::size_t folders() const {
    std::size_t count = 0;
    for (const auto& entry : fs::recursive_directory_iterator(files_)) {
      count += entry.path().filename() == "images" ? 1 : 0;
    }
    return count;
  }

 private:
  const Options& options_;
  Totals& totals_;
  const fs::path files_;
  Process server_;
  tcp::endpoint link_;
  tcp::endpoint page_;
  Loop loop_;
  std::vector<std::unique_ptr<Relay>> relays_;
  std::vector<std::unique_ptr<Process>> robots_;
  std::unique_ptr<Probe> probe_;
};

/// One robot that names ever more sessions of its own.
void name_sessions(const tcp::endpoint& link, const std::atomic<bool>& is_over) {
  const orbbuf::test::RobotClient liar(link.port());
  if (!liar.hello("liar", "present")) return;
  for (std::uint64_t i = 0; !is_over; ++i) {
    wire::Account account;
    account.session_id = fmt::format("s{}", i);
    account.is_final = true;
    account.captured = 9;
    liar.send_account(i, account);
    if (!liar.acked(i + 1, wire::kAccounts)) return;
  }
}

void without_tls(const Options& options, Totals& totals) {
  Stage stage(options, "plain", nullptr, totals);
  Bytes half = hello("stranger", "s");
  half.resize(half.size() / 2);
  stage.bear("half hellos", stage.link(), kHalfHellos, [half] { return half; });
  stage.bear("half requests", stage.page(), kHalfRequests, [] { return text("GET /heal"); });
  std::atomic<bool> is_over = false;
  std::jthread liar([&] { name_sessions(stage.link(), is_over); });
  stage.bear("accounts");
  is_over = true;
  liar.join();
  stage.bear(
      "sessions", stage.link(), 64,
      [n = std::make_shared<int>()] { return hello(fmt::format("x{}", ++*n), "s"); }, true);

  // A server that sends each robot away at its hello.
  tcp::acceptor nowhere(stage.io(), {asio::ip::address_v4::loopback(), 0});
  std::atomic<std::size_t> hellos = 0;
  std::jthread redirector([&] {
    const Bytes away = wire::encode(wire::ErrorMessage{wire::ErrorCode::kSentAway, "full"});
    boost::system::error_code failed;
    while (!failed) {
      tcp::socket socket(stage.io());
      nowhere.accept(socket, failed);
      Bytes bytes(4096);
      boost::system::error_code gone;
      if (failed || socket.read_some(asio::buffer(bytes), gone) == 0) continue;
      ++hellos;
      asio::write(socket, asio::buffer(away), gone);
    }
  });
  {
    Process lost(with_settings(
        {options.robot.string()},
        {"robot.id=lost", "source.frames=1000000000", "source.width=160", "source.height=120",
         "link.server=127.0.0.1:" + std::to_string(nowhere.local_endpoint().port())}));
    const auto begun = Clock::now();
    stage.bear("redirects");
    totals.redirected_hellos_per_s =
        static_cast<double>(hellos) / Seconds(Clock::now() - begun).count();
    lost.signal(SIGKILL);
  }
  ::shutdown(nowhere.native_handle(), SHUT_RDWR);  // ends the accept that waits
  redirector.join();
  stage.end();
  totals.sessions = stage.folders() - kRobots;
}

void with_tls(const Options& options, Totals& totals) {
  const Certificates keys;
  for (std::size_t i = 0; i < kRobots; ++i) {
    keys.make("robot", "robot=turtlebot1", fmt::format("robot=r{}", i));
  }
  Stage stage(options, "tls", &keys, totals);
  Bytes words = client_hello();
  stage.bear("half handshakes", stage.link(), kHalfHandshakes, [words] { return words; });
  stage.bear("half handshakes with the page", stage.page(), kHalfRequests,
             [words] { return words; });
  stage.end();
}

int run(const Options& options) {
  Totals totals;
  without_tls(options, totals);
  with_tls(options, totals);
  const auto result = [](const char* name, double value) {
    std::printf("RESULT strangers.%s %g\n", name, value);
  };
  const auto mib = static_cast<double>(totals.server_kib) / 1024;
  result("connections", static_cast<double>(totals.strangers));
  result("session_folders", static_cast<double>(totals.sessions));
  result("redirected_hellos_per_s", totals.redirected_hellos_per_s);
  result("robots_frames", static_cast<double>(totals.captured));
  result("probes", static_cast<double>(totals.probes));
  result("probe_longest_s", totals.probe_longest_s);
  result("robots_frames_lost", static_cast<double>(totals.lost));
  result("probe_failures", static_cast<double>(totals.probe_failures));
  result("server_mib", mib);
  result("reconnect_worst_s", totals.reconnect_worst_s);
  const bool is_well = totals.lost == 0 && totals.probe_failures == 0 && mib <= kMostMib &&
                       totals.reconnect_worst_s <= kMostReconnectS;
  return is_well ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  Options options;
  orbbuf::CommandLine app(
      "Strangers at a server's ports, which robots and a probe must not notice");
  app.add_option("--robot", options.robot, "orbbufd").required();
  app.add_option("--server", options.server, "orbbuf-server").required();
  app.add_option("--work", options.work, "an empty folder for all that is written").required();
  app.add_option("--seconds", options.seconds, "of each kind").in_range(0.1, 1e6);
  app.add_flag(
      "--quick", [&] { options.seconds = 2; }, "2 s of each kind");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("strangers", [&] { return run(options); });
}
