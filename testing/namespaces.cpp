// SPDX-License-Identifier: Apache-2.0
#include "testing/namespaces.hpp"

#include <unistd.h>

#include <atomic>
#include <stdexcept>

#include "testing/process.hpp"

namespace orbbuf::test {
namespace {

constexpr const char* kDropAll =
    "add table inet cut; add chain inet cut in { type filter hook input priority 0; policy drop; }";

}  // namespace

Namespaces::Namespaces() {
  static std::atomic<int> count = 0;
  const std::string id = std::to_string(::getpid()) + "-" + std::to_string(count++);
  robot_ = "orbbuf-r" + id;
  server_ = "orbbuf-s" + id;
  const std::vector<std::vector<std::string>> steps = {
      {"ip", "netns", "add", robot_},
      {"ip", "netns", "add", server_},
      {"ip", "-n", robot_, "link", "add", "wire", "type", "veth", "peer", "name", "wire", "netns",
       server_},
      {"ip", "-n", robot_, "addr", "add", "10.77.0.1/24", "dev", "wire"},
      {"ip", "-n", server_, "addr", "add", "10.77.0.2/24", "dev", "wire"},
      {"ip", "-n", robot_, "link", "set", "wire", "up"},
      {"ip", "-n", server_, "link", "set", "wire", "up"},
      {"ip", "netns", "exec", server_, "nft", "list", "ruleset"}};
  for (const auto& step : steps) {
    const Finished done = run(step);
    if (done.status == 0) continue;
    why_ = "cannot make network namespaces (not root?): " + done.output;
    return;
  }
}

Namespaces::~Namespaces() {
  run({"ip", "netns", "del", robot_});
  run({"ip", "netns", "del", server_});
}

void Namespaces::cut_link() const {
  const Finished done = run({"ip", "netns", "exec", server_, "nft", kDropAll});
  if (done.status != 0) throw std::runtime_error("nft: " + done.output);
}

void Namespaces::mend_link() const {
  const Finished done =
      run({"ip", "netns", "exec", server_, "nft", "delete", "table", "inet", "cut"});
  if (done.status != 0) throw std::runtime_error("nft: " + done.output);
}

}  // namespace orbbuf::test
