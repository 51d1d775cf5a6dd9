// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "testing/process.hpp"

namespace orbbuf::fleet_bench {

/// Three members of etcd and some servers, or one server that is in no fleet, as processes on
/// loopback, and what can happen to them.
/// Under root and in a network namespace of its own (run.sh) a server can be cut off from etcd or
/// from the robots: each has a user of its own, by whom nftables knows what it sends.
class Stage {
 public:
  /// servers: 1 is in no fleet, and there is no etcd.
  Stage(std::filesystem::path server, std::filesystem::path work, std::size_t servers,
        bool is_alone);
  ~Stage();

  std::size_t servers() const { return servers_.size(); }
  std::vector<boost::asio::ip::tcp::endpoint> endpoints() const;
  std::filesystem::path files(std::size_t server) const;
  pid_t pid(std::size_t server) const { return servers_[server].process->pid(); }
  std::vector<std::string> etcd() const;

  void kill_server(std::size_t server);
  void start_server(std::size_t server);
  void pause_server(std::size_t server) const;
  void resume_server(std::size_t server) const;
  bool can_cut_off() const { return has_nft_; }
  /// All that it sends to etcd, or to the robots, is lost until mend().
  void cut_off_etcd(std::size_t server) const;
  void cut_off_robots(std::size_t server) const;
  void mend() const;
  void kill_etcd_leader();
  void start_etcd();
  /// Sends its robots away, ends it, and starts it again. Blocking; throws std::runtime_error.
  void roll(std::size_t server);
  /// All end in peace; throws std::runtime_error if one does not.
  void end();
  /// Successful changes of etcd's keys so far.
  std::uint64_t etcd_revision() const;

 private:
  struct Server {
    std::uint16_t port;
    std::uint16_t http_port;
    std::unique_ptr<test::Process> process;
  };
  struct Etcd {
    std::uint16_t client_port;
    std::uint16_t peer_port;
    std::unique_ptr<test::Process> process;
  };

  bool is_fleet() const { return !etcd_.empty(); }
  void begin_etcd(std::size_t member);
  void await_start(std::size_t server) const;
  void nft(const std::string& words) const;

  const std::filesystem::path program_;
  const std::filesystem::path work_;
  bool has_nft_ = false;
  std::vector<Server> servers_;
  std::vector<Etcd> etcd_;
  int starts_ = 0;
};

}  // namespace orbbuf::fleet_bench
