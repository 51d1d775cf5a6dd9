// SPDX-License-Identifier: Apache-2.0
#include "bench/chaos/stage.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "daemon/buffer/make_policy.hpp"

namespace orbbuf::chaos {
namespace {

namespace fs = std::filesystem;
using test::Process;
using test::with_settings;
using test::word_after;
using Words = std::vector<std::string>;

constexpr const char* kNetwork = "10.77.0.";
constexpr std::chrono::seconds kPatience{120};
constexpr int kKilled = 128 + SIGKILL;
constexpr const char* kCalmMbit = "20mbit";
constexpr std::uintmax_t kDiskBytes = std::uintmax_t{4} << 30U;  // of a file with holes

Words operator+(Words words, const Words& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

void must(const Words& command) {
  const test::Finished done = test::run(command);
  if (done.status == 0) return;
  throw std::runtime_error(fmt::format("{}: {}", fmt::join(command, " "), done.output));
}

void save(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }

Words shape(const std::string& rate, const char* link = test::Namespaces::kLink) {
  return {"tc",   "qdisc", "replace", "dev",  link,      "root", "tbf",
          "rate", rate,    "burst",   "32kb", "latency", "100ms"};
}

Words congestion_route(const std::string& address, const std::string& control) {
  return {"ip", "route", "replace", address + "/32", "dev", "wire", "congctl", control};
}

Words second_route(const std::string& address, const std::string& control) {
  return {"ip",    "route",  "add", address + "/32", "via",  "10.78.0.2", "dev",
          "wire2", "metric", "9",   "congctl",       control};
}

}  // namespace

std::vector<std::string> Stage::available(const Words& wanted, std::string& why) {
  const test::Namespaces hosts;
  why = hosts.why();
  Words found;
  for (const std::string& control : wanted) {
    if (!hosts.exist()) break;
    const auto tried = test::run(hosts.on_robot() + congestion_route("10.77.0.9", control));
    if (tried.status == 0) {
      found.push_back(control);
    } else {
      why = "no congestion control " + control + " here: " + tried.output;
    }
  }
  return found;
}

Stage::Stage(Programs programs, fs::path work, const Words& controls, LinkKind kind)
    : programs_(std::move(programs)),
      work_(std::move(work)),
      links_(kind.links),
      has_spool_(kind.has_spool),
      hosts_(links_) {
  if (!hosts_.exist()) throw std::runtime_error(hosts_.why());
  fs::create_directories(work_);
  make_source();
  for (std::size_t i = 0; i < controls.size(); ++i) {
    const std::string address = kNetwork + std::to_string(i + 2);
    if (i > 0) on_server({"ip", "addr", "add", address + "/24", "dev", "wire"});
    on_robot(congestion_route(address, controls[i]));
    if (links_ == 2) on_robot(second_route(address, controls[i]));
    robots_.push_back({"robot-" + controls[i], address, nullptr, 0, nullptr});
    if (!kind.has_power_cuts) continue;
    auto& disk = robots_.back().disk;
    disk = std::make_unique<bench::PowerDisk>(work_, ("disk-" + controls[i]).c_str(), kDiskBytes);
    if (!disk->mount()) throw std::runtime_error("cannot mount a loop device");
  }
  on_robot(shape(kCalmMbit));
  if (links_ == 2) on_robot(shape(kCalmMbit, test::Namespaces::kSecondLink));
  if (kind.has_tls) make_keys();
}

void Stage::make_keys() {
  keys_ = std::make_unique<test::Certificates>();
  std::string addresses;
  for (const Robot& robot : robots_) {
    keys_->make("robot", "robot=turtlebot1", "robot=" + robot.id);
    addresses += (addresses.empty() ? "IP:" : ",IP:") + robot.address;
  }
  keys_->make("server", "IP:127.0.0.1", addresses);
}

/// Captures once what all robots will replay: JPEGs, so that they arrive byte for byte.
void Stage::make_source() {
  Process server(
      with_settings({programs_.server.string()},
                    {"listen.address=127.0.0.1:0", "files.path=" + (work_ / "captured").string()}));
  const auto line = server.require_line("listening on ");
  must(with_settings(
      {programs_.robot.string()},
      {"robot.id=r", "link.server=" + word_after(line, "listening on "), "source.frames=241",
       "source.realtime=false", "source.width=320", "source.height=240"}));
  const fs::path session = *fs::directory_iterator(work_ / "captured" / "r");
  fs::rename(session / "images", source());
  fs::remove_all(work_ / "captured");
}

void Stage::on_robot(const Words& command) const { must(hosts_.on_robot() + command); }
void Stage::on_server(const Words& command) const { must(hosts_.on_server() + command); }

void Stage::begin() {
  start_server();
  for (Robot& robot : robots_) start_robot(robot);
}

void Stage::start_server() {
  server_ = std::make_unique<Process>(with_settings(
      hosts_.on_server() + Words{programs_.server.string()},
      Words{"listen.address=0.0.0.0:" + port_, "files.path=" + (work_ / "out").string()} +
          (keys_ ? test::Certificates::overrides(keys_->server())
                 : Words{"listen.insecure=true"})));
  const auto line = server_->require_line("listening on ");
  port_ = line.substr(line.rfind(':') + 1);
}

void Stage::start_robot(Robot& robot, double fps) {
  static constexpr std::array kCapacities{25, 3, 60, 10};
  const std::size_t n = sessions_.size();
  Session session;
  session.log = work_ / fmt::format("robot-{}.log", n);
  const fs::path disk = robot.disk ? robot.disk->folder() : work_;
  const fs::path record = disk / ("record-" + robot.id);  // the next one tells what this one cannot
  Words settings{"robot.id=" + robot.id,
                 "link.server=" + robot.address + ":" + port_,
                 "link.drain_timeout=1 min",
                 "source.kind=folder",
                 "source.path=" + source().string(),
                 fmt::format("source.fps={}", fps),
                 "source.loop=true",
                 "buffer.policy=" + std::string(kPolicies.at(n % kPolicies.size())),
                 fmt::format("buffer.capacity={}", kCapacities.at(n % kCapacities.size())),
                 (has_spool_ ? "spool.path=" : "buffer.drop_log=") + record.string()};
  if (links_ == 2) {
    settings = settings + Words{R"(link.interfaces=["wire", "wire2"])", "link.return_after=1 s"};
  }
  if (keys_) settings = settings + test::Certificates::overrides(keys_->of(robot.id));
  robot.process = std::make_unique<Process>(
      with_settings(hosts_.on_robot() + Words{programs_.robot.string()}, settings));
  const auto id = word_after(robot.process->require_line(", session "), ", session ");
  session.name = robot.id + " " + id;
  session.files = work_ / "out" / robot.id / id;
  session.has_spool = has_spool_;
  robot.session = n;
  sessions_.push_back(session);
}

void Stage::bury_robot(Robot& robot, bool was_killed) {
  Session& session = sessions_.at(robot.session);
  session.was_killed = was_killed;
  save(session.log, robot.process->output());
  robot.process.reset();
}

void Stage::stop_server(int signal) {
  server_->signal(signal);
  const int status = server_->wait(kPatience);
  save(work_ / fmt::format("server-{}.log", servers_++), server_->output());
  server_.reset();
  if (status == (signal == SIGKILL ? kKilled : 0)) return;
  throw std::runtime_error(fmt::format("the server ended with status {}", status));
}

void Stage::cut() {
  const int turn = cuts_++ % 3;
  if (links_ == 1 || turn != 1) cut_links_.emplace_back(test::Namespaces::kLink);
  if (links_ == 2 && turn != 0) cut_links_.emplace_back(test::Namespaces::kSecondLink);
  for (const std::string& link : cut_links_) hosts_.cut_link(link);
}

void Stage::mend() {
  for (const std::string& link : std::exchange(cut_links_, {})) hosts_.mend_link(link);
}

void Stage::apply(const Step& step) {
  switch (step.action) {
    case Action::kRate:
      return on_robot(shape(fmt::format("{:.0f}kbit", step.value * 1000)));
    case Action::kCut:
      return cut();
    case Action::kMend:
      return mend();
    case Action::kReset:
      return on_server({"nft",
                        "add table inet resets; add chain inet resets in { type filter hook input "
                        "priority 0; }; add rule inet resets in meta l4proto tcp reject with tcp "
                        "reset"});
    case Action::kEndReset:
      return on_server({"nft", "delete table inet resets"});
    case Action::kKillServer:
    case Action::kEndServer:
      return stop_server(step.action == Action::kKillServer ? SIGKILL : SIGTERM);
    case Action::kStartServer:
      return start_server();
    case Action::kPauseServer:
      return server_->signal(SIGSTOP);
    case Action::kResumeServer:
      return server_->signal(SIGCONT);
    case Action::kKillRobot:
      return kill(robots_.at(static_cast<std::size_t>(step.value)));
  }
}

void Stage::kill(Robot& robot) {
  const bool loses_power = robot.disk && kills_++ % 2 == 0;
  if (loses_power && !robot.disk->cut()) throw std::runtime_error("cannot cut a disk's power");
  robot.process->signal(SIGKILL);
  const int status = robot.process->wait(kPatience);
  bury_robot(robot, true);
  sessions_.at(robot.session).lost_power = loses_power;
  if (status != kKilled) throw std::runtime_error(robot.id + " had ended on its own");
  if (loses_power && (!robot.disk->unmount() || !robot.disk->mount())) {
    throw std::runtime_error("cannot mount a disk again");
  }
  start_robot(robot);
}

void Stage::end_robots() {
  std::string failed;
  for (const Robot& robot : robots_) robot.process->signal(SIGTERM);
  for (Robot& robot : robots_) {
    if (robot.process->wait(kPatience) != 0) failed += robot.id + " ended badly; ";
    bury_robot(robot, false);
  }
  if (!failed.empty()) throw std::runtime_error(failed + "logs in " + work_.string());
}

/// A last session of each robot, with little of its own to send, until the server has all that is
/// late and has merged it.
void Stage::send_spools() {
  for (Robot& robot : robots_) start_robot(robot, 2);
  const auto is_merged = [this](const Session& session) {
    const fs::path late = session.files / "late";
    const auto robot = std::ranges::find(
        robots_, session.files, [&](const Robot& one) { return sessions_.at(one.session).files; });
    return robot != robots_.end() || !fs::exists(late);
  };
  for (Robot& robot : robots_) {
    if (!robot.process->wait_for_line(" spooled 0", std::chrono::seconds(600))) {
      throw std::runtime_error(robot.id + " never sent all that it kept");
    }
  }
  const auto limit = std::chrono::steady_clock::now() + kPatience;
  while (!std::ranges::all_of(sessions_, is_merged)) {
    if (std::chrono::steady_clock::now() > limit) {
      throw std::runtime_error("the server never merged the late frames");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

void Stage::end() {
  on_robot(shape(kCalmMbit));
  end_robots();
  if (has_spool_) {
    send_spools();
    end_robots();
  }
  stop_server(SIGTERM);
}

}  // namespace orbbuf::chaos
