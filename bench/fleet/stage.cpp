// SPDX-License-Identifier: Apache-2.0
#include "bench/fleet/stage.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>

#include "testing/real_etcd.hpp"

namespace orbbuf::fleet_bench {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMembers = 3;
constexpr int kFirstUser = 61000;

/// What etcdctl says of an endpoint, a field of its JSON that is a number; 0 if it does not answer.
std::uint64_t status_of(const std::string& endpoint, const std::string& field) {
  const auto got = test::run({"env", "ETCDCTL_API=3", "etcdctl", "--endpoints=" + endpoint,
                              "--command-timeout=2s", "endpoint", "status", "-w=json"});
  const auto at = got.output.find('"' + field + "\":");
  return at == std::string::npos ? 0 : std::stoull(got.output.substr(at + field.size() + 3));
}

}  // namespace

Stage::Stage(fs::path server, fs::path work, std::size_t servers, bool is_alone)
    : program_(std::move(server)), work_(std::move(work)) {
  const std::size_t members = servers > 1 ? kMembers : 0;
  const auto ports = test::free_ports(2 * (members + servers));
  for (std::size_t i = 0; i < members; ++i) {
    etcd_.push_back({ports[2 * i], ports[2 * i + 1], nullptr});
  }
  for (std::size_t i = 0; i < members; ++i) begin_etcd(i);
  for (auto& member : etcd_) member.process->require_line("ready to serve client requests");
  if (is_alone) {
    nft("add table ip fleet");
    nft("add chain ip fleet out { type filter hook output priority 0; }");
    has_nft_ = true;
  }
  for (std::size_t i = 0; i < servers; ++i) {
    servers_.push_back({ports[2 * (members + i)], ports[2 * (members + i) + 1], nullptr});
    fs::create_directories(files(i));
    if (::chown(files(i).c_str(), static_cast<uid_t>(kFirstUser + static_cast<int>(i)), 0) != 0) {
      has_nft_ = false;
    }
    start_server(i);
  }
  for (std::size_t i = 0; i < servers; ++i) await_start(i);
}

void Stage::await_start(std::size_t server) const {
  servers_[server].process->require_line(is_fleet() ? "has joined" : "listening on");
}

Stage::~Stage() {
  if (has_nft_) test::run({"nft", "delete", "table", "ip", "fleet"});
}

void Stage::begin_etcd(std::size_t member) {
  std::string cluster;
  for (std::size_t i = 0; i < etcd_.size(); ++i) {
    cluster += fmt::format("{}e{}=http://127.0.0.1:{}", i == 0 ? "" : ",", i, etcd_[i].peer_port);
  }
  const Etcd& etcd = etcd_[member];
  const auto client = fmt::format("http://127.0.0.1:{}", etcd.client_port);
  const auto peer = fmt::format("http://127.0.0.1:{}", etcd.peer_port);
  etcd_[member].process = std::make_unique<test::Process>(std::vector<std::string>{
      "etcd", fmt::format("--name=e{}", member),
      fmt::format("--data-dir={}", (work_ / fmt::format("etcd{}", member)).string()),
      "--listen-client-urls=" + client, "--advertise-client-urls=" + client,
      "--listen-peer-urls=" + peer, "--initial-advertise-peer-urls=" + peer,
      "--initial-cluster=" + cluster, "--log-outputs=stderr"});
}

std::vector<boost::asio::ip::tcp::endpoint> Stage::endpoints() const {
  std::vector<boost::asio::ip::tcp::endpoint> all;
  for (const Server& server : servers_) {
    all.emplace_back(boost::asio::ip::address_v4::loopback(), server.port);
  }
  return all;
}

fs::path Stage::files(std::size_t server) const { return work_ / fmt::format("server{}", server); }

std::vector<std::string> Stage::etcd() const {
  std::vector<std::string> endpoints;
  for (const Etcd& each : etcd_) endpoints.push_back(fmt::format("127.0.0.1:{}", each.client_port));
  return endpoints;
}

void Stage::start_server(std::size_t server) {
  std::string endpoints;
  for (const std::string& each : etcd()) {
    endpoints += (endpoints.empty() ? "\"" : ", \"") + each + "\"";
  }
  std::vector<std::string> command;
  if (has_nft_) {
    const auto user = std::to_string(kFirstUser + static_cast<int>(server));
    command = {"setpriv", "--reuid=" + user, "--clear-groups"};
  }
  command.push_back(program_.string());
  std::vector<std::string> settings = {
      fmt::format("listen.address=127.0.0.1:{}", servers_[server].port),
      std::string("listen.max_connections_per_address=1000"),
      fmt::format("http.address=127.0.0.1:{}", servers_[server].http_port),
      fmt::format("files.path={}", files(server).string()),
      fmt::format("status.socket={}/status", files(server).string())};
  if (is_fleet()) {
    settings.push_back(fmt::format("fleet.etcd=[{}]", endpoints));
    settings.push_back(fmt::format("fleet.name=server{}", server));
  }
  auto& process = servers_[server].process;
  if (process) {
    std::ofstream(work_ / fmt::format("server{}.{}.log", server, ++starts_)) << process->output();
  }
  process = std::make_unique<test::Process>(test::with_settings(command, settings));
}

void Stage::kill_server(std::size_t server) {
  servers_[server].process->signal(SIGKILL);
  servers_[server].process->wait();
}

void Stage::pause_server(std::size_t server) const { servers_[server].process->signal(SIGSTOP); }
void Stage::resume_server(std::size_t server) const { servers_[server].process->signal(SIGCONT); }

void Stage::nft(const std::string& words) const {
  const auto done = test::run({"nft", words});
  if (done.status != 0) throw std::runtime_error("nft " + words + ": " + done.output);
}

void Stage::cut_off_etcd(std::size_t server) const {
  for (const Etcd& each : etcd_) {
    nft(fmt::format("add rule ip fleet out meta skuid {} tcp dport {} drop",
                    kFirstUser + static_cast<int>(server), each.client_port));
  }
}

void Stage::cut_off_robots(std::size_t server) const {
  nft(fmt::format("add rule ip fleet out tcp sport {} drop", servers_[server].port));
  nft(fmt::format("add rule ip fleet out tcp dport {} drop", servers_[server].port));
}

void Stage::mend() const {
  if (has_nft_) nft("flush chain ip fleet out");
}

void Stage::kill_etcd_leader() {
  for (Etcd& each : etcd_) {
    const auto endpoint = fmt::format("127.0.0.1:{}", each.client_port);
    const auto leader = status_of(endpoint, "leader");
    if (leader == 0 || leader != status_of(endpoint, "member_id")) continue;
    each.process->signal(SIGKILL);
    each.process->wait();
    each.process = nullptr;
    return;
  }
}

void Stage::start_etcd() {
  for (std::size_t i = 0; i < etcd_.size(); ++i) {
    if (!etcd_[i].process) begin_etcd(i);
  }
}

void Stage::roll(std::size_t server) {
  const auto done = test::run({program_.string(), "drain", (files(server) / "status").string()});
  if (done.status != 0) throw std::runtime_error("drain: " + done.output);
  servers_[server].process->signal(SIGTERM);
  if (const int status = servers_[server].process->wait(); status != 0) {
    throw std::runtime_error(fmt::format("server {} ends with {}", server, status));
  }
  start_server(server);
  await_start(server);
}

void Stage::end() {
  for (std::size_t i = 0; i < servers_.size(); ++i) {
    servers_[i].process->signal(SIGTERM);
    const int status = servers_[i].process->wait();
    std::ofstream(work_ / fmt::format("server{}.{}.log", i, ++starts_))
        << servers_[i].process->output();
    if (status != 0) throw std::runtime_error(fmt::format("server {} ends with {}", i, status));
  }
}

std::uint64_t Stage::etcd_revision() const {
  std::uint64_t revision = 0;
  for (const std::string& endpoint : etcd()) {
    revision = std::max(revision, status_of(endpoint, "revision"));
  }
  return revision;
}

}  // namespace orbbuf::fleet_bench
