// SPDX-License-Identifier: Apache-2.0
#include "testing/real_etcd.hpp"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <csignal>
#include <cstdlib>
#include <stdexcept>

namespace orbbuf::test {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

const char* model() { return std::getenv("ORBBUF_ETCD_MODEL"); }

constexpr int kTries = 5;  // another program may take a port that was free

}  // namespace

std::vector<std::uint16_t> free_ports(std::size_t count) {
  asio::io_context io;
  std::vector<tcp::acceptor> acceptors;
  std::vector<std::uint16_t> ports;
  for (std::size_t i = 0; i < count; ++i) {
    acceptors.emplace_back(io, tcp::endpoint(asio::ip::address_v4::loopback(), 0));
    ports.push_back(acceptors.back().local_endpoint().port());
  }
  return ports;
}

bool RealEtcd::is_installed() {
  return model() != nullptr || run({"sh", "-c", "command -v etcd"}).status == 0;
}

RealEtcd::RealEtcd() {
  for (int i = 0; i < kTries; ++i) {
    const auto ports = free_ports(2);
    port_ = ports[0];
    peer_port_ = ports[1];
    try {
      start();
      return;
    } catch (const std::runtime_error&) {
      if (i + 1 == kTries) throw;
    }
  }
}

void RealEtcd::start() {
  const std::string peer = "http://127.0.0.1:" + std::to_string(peer_port_);
  const std::string client = "http://" + endpoint();
  const std::string folder = (folder_ / "etcd").string();
  std::vector<std::string> command{"etcd",
                                   "--name=e",
                                   "--data-dir=" + folder,
                                   "--listen-client-urls=" + client,
                                   "--advertise-client-urls=" + client,
                                   "--listen-peer-urls=" + peer,
                                   "--initial-advertise-peer-urls=" + peer,
                                   "--initial-cluster=e=" + peer,
                                   "--log-outputs=stderr"};
  if (model() != nullptr) command = {model(), std::to_string(port_), folder};
  process_ = std::make_unique<Process>(command);
  if (!process_->wait_for_line("ready to serve client requests")) {
    throw std::runtime_error("etcd does not begin: " + process_->output());
  }
}

void RealEtcd::pause() const { process_->signal(SIGSTOP); }
void RealEtcd::resume() const { process_->signal(SIGCONT); }

void RealEtcd::kill() {
  process_->signal(SIGKILL);
  process_->wait();
}

}  // namespace orbbuf::test
