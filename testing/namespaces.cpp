// SPDX-License-Identifier: Apache-2.0
#include "testing/namespaces.hpp"

#include <unistd.h>

#include <atomic>
#include <stdexcept>

#include "testing/process.hpp"

namespace orbbuf::test {

Namespaces::Namespaces(int links) {
  static std::atomic<int> count = 0;
  const std::string id = std::to_string(::getpid()) + "-" + std::to_string(count++);
  robot_ = "orbbuf-r" + id;
  server_ = "orbbuf-s" + id;
  take({{"ip", "netns", "add", robot_}, {"ip", "netns", "add", server_}});
  take(cable(kLink, "10.77.0."));
  if (links == 2) {
    take(cable(kSecondLink, "10.78.0."));
    take({{"ip", "-n", server_, "link", "set", "lo", "up"},
          {"ip", "-n", server_, "addr", "add", "10.79.0.2/32", "dev", "lo"},
          {"ip", "-n", robot_, "route", "add", "10.79.0.2", "via", "10.77.0.2", "metric", "1"},
          {"ip", "-n", robot_, "route", "add", "10.79.0.2", "via", "10.78.0.2", "metric", "2"}});
  }
  take({{"ip", "netns", "exec", server_, "nft", "list", "ruleset"}});
}

Namespaces::~Namespaces() {
  run({"ip", "netns", "del", robot_});
  run({"ip", "netns", "del", server_});
}

Namespaces::Steps Namespaces::cable(const std::string& name, const std::string& network) const {
  return {{"ip", "-n", robot_, "link", "add", name, "type", "veth", "peer", "name", name, "netns",
           server_},
          {"ip", "-n", robot_, "addr", "add", network + "1/24", "dev", name},
          {"ip", "-n", server_, "addr", "add", network + "2/24", "dev", name},
          {"ip", "-n", robot_, "link", "set", name, "up"},
          {"ip", "-n", server_, "link", "set", name, "up"}};
}

void Namespaces::take(const Steps& steps) {
  for (const auto& step : steps) {
    if (!exist()) return;
    const Finished done = run(step);
    if (done.status != 0) why_ = "cannot make network namespaces (not root?): " + done.output;
  }
}

void Namespaces::cut_link(const std::string& link) const {
  nft("add table inet cut-" + link + "; add chain inet cut-" + link +
      " in { type filter hook input priority 0; }; add rule inet cut-" + link + " in iifname " +
      link + " drop");
}

void Namespaces::mend_link(const std::string& link) const { nft("delete table inet cut-" + link); }

void Namespaces::shape_link(const std::string& rate) const {
  const Finished done = run({"tc", "-n", robot_, "qdisc", "replace", "dev", kLink, "root", "tbf",
                             "rate", rate, "burst", "8kb", "latency", "100ms"});
  if (done.status != 0) throw std::runtime_error("tc: " + done.output);
}

void Namespaces::nft(const std::string& words) const {
  const Finished done = run({"ip", "netns", "exec", server_, "nft", words});
  if (done.status != 0) throw std::runtime_error("nft: " + done.output);
}

}  // namespace orbbuf::test
