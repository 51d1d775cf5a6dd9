// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/name_lookup.hpp"

#include <netdb.h>

#include <boost/asio/post.hpp>
#include <cstring>
#include <map>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using Endpoint = asio::ip::tcp::endpoint;

constexpr int kMostAtOnce = 5;

Error failure(const Address& server, const char* why) {
  return {"cannot resolve " + server.host + ": " + why};
}

Result<NameLookup::Endpoints> resolve(const Address& server) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_ADDRCONFIG;
  addrinfo* found = nullptr;
  const int failed = ::getaddrinfo(server.host.c_str(), nullptr, &hints, &found);
  if (failed != 0) return failure(server, ::gai_strerror(failed));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owned(found, &::freeaddrinfo);
  NameLookup::Endpoints endpoints;
  for (const addrinfo* one = found; one != nullptr; one = one->ai_next) {
    Endpoint endpoint;
    if (one->ai_addrlen > endpoint.capacity()) continue;
    std::memcpy(endpoint.data(), one->ai_addr, one->ai_addrlen);
    endpoint.resize(one->ai_addrlen);
    endpoint.port(server.port);
    endpoints.push_back(endpoint);
  }
  if (endpoints.empty()) return failure(server, "the name has no address");
  return endpoints;
}

}  // namespace

/// What a lookup's thread may touch: it may outlive all else.
struct NameLookup::Shared {
  std::mutex mutex;
  asio::io_context* io;  // null: nothing waits for an answer any more; guarded by mutex
  Found found;           // of the io_context's thread, like the rest
  std::map<std::string, int> pending;  // by HOST:PORT; none is 0
};

NameLookup::NameLookup(asio::io_context& io, Found found) : shared_(std::make_shared<Shared>()) {
  shared_->io = &io;
  shared_->found = std::move(found);
}

NameLookup::~NameLookup() {
  shared_->found = nullptr;
  const std::lock_guard lock(shared_->mutex);
  shared_->io = nullptr;
}

void NameLookup::start(const Address& server) {
  const std::string name = to_string(server);
  if (shared_->pending[name] == kMostAtOnce) return;
  const auto look_up = [shared = shared_, server, name] {
    name_this_thread("lookup");
    auto result = resolve(server);
    const std::lock_guard lock(shared->mutex);
    if (shared->io == nullptr) return;
    asio::post(*shared->io, [shared, server, name, result = std::move(result)] {
      if (--shared->pending[name] == 0) shared->pending.erase(name);
      if (shared->found) shared->found(server, result);
    });
  };
  try {
    std::thread(look_up).detach();
    ++shared_->pending[name];
  } catch (const std::system_error& error) {
    asio::post(*shared_->io, [shared = shared_, server, why = failure(server, error.what())] {
      if (shared->found) shared->found(server, why);
    });
  }
}

}  // namespace orbbuf
