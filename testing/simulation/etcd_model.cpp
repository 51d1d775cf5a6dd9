// SPDX-License-Identifier: Apache-2.0
// What the servers of a fleet need of etcd's JSON gateway (v3, as 3.4 answers): transactions,
// ranges and leases. It stands for a whole cluster: what it has answered it knows after its next
// start, and with the start each lease lasts for its whole time again, as with a new leader.
//   orbbuf-etcd-model PORT FILE
// FILE: what has changed, a line a request. One thread; ends by a signal only.
#include <openssl/evp.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace orbbuf::simulation {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kLeastTtl{2};  // of etcd's usual election timeout
constexpr std::size_t kMostOperations = 128;

/// Answered with that HTTP status, and gRPC's code.
struct Refusal {
  int status;
  int code;
  std::string text;
};
const Refusal kDuplicateKey{400, 3, "etcdserver: duplicate key given in txn request"};
const Refusal kTooMany{400, 3, "etcdserver: too many operations in txn request"};
const Refusal kNoLease{404, 5, "etcdserver: requested lease not found"};
const Refusal kLeaseExists{412, 9, "etcdserver: lease already exists"};

/// Keys are in order of their bytes; values are only compared, and stay as they come.
std::string from_base64(const std::string& text) {
  std::string out(3 * (text.size() / 4), '\0');
  const int bytes = EVP_DecodeBlock(reinterpret_cast<unsigned char*>(out.data()),
                                    reinterpret_cast<const unsigned char*>(text.data()),
                                    static_cast<int>(text.size()));
  if (bytes < 0 || text.size() % 4 != 0) throw Refusal{400, 3, "illegal base64 data"};
  out.resize(out.size() - (text.ends_with("==") ? 2 : text.ends_with("=") ? 1 : 0));
  return out;
}
std::string to_base64(const std::string& text) {
  std::string out(4 * ((text.size() + 2) / 3), '\0');
  EVP_EncodeBlock(reinterpret_cast<unsigned char*>(out.data()),
                  reinterpret_cast<const unsigned char*>(text.data()),
                  static_cast<int>(text.size()));
  return out;
}

/// 64 bits are text in JSON, and may be a number; what is left out is 0.
std::int64_t number(const json& object, const char* name) {
  const auto found = object.find(name);
  if (found == object.end()) return 0;
  if (found->is_number()) return found->get<std::int64_t>();
  std::istringstream in(found->get<std::string>());
  std::int64_t value = 0;
  if (!(in >> value)) throw Refusal{400, 3, "not a number"};
  return value;
}
std::string text(const json& object, const char* name) { return object.value(name, ""); }
std::string key_of(const json& object) { return from_base64(text(object, "key")); }
json list(const json& object, const char* name) { return object.value(name, json::array()); }

/// A txn may put a key once, whichever branches are taken.
std::set<std::string> puts_in(const json& requests) {
  std::set<std::string> all;
  const auto add = [&all](const std::set<std::string>& more) {
    for (const std::string& key : more) {
      if (!all.insert(key).second) throw kDuplicateKey;
    }
  };
  for (const json& request : requests) {
    if (request.contains("request_put")) add({key_of(request["request_put"])});
    if (!request.contains("request_txn")) continue;
    auto either = puts_in(list(request["request_txn"], "success"));
    either.merge(puts_in(list(request["request_txn"], "failure")));
    add(either);
  }
  return all;
}

void check_size(const json& txn, std::size_t most) {
  std::size_t count = list(txn, "compare").size();
  for (const char* const branch : {"success", "failure"}) {
    count = std::max(count, list(txn, branch).size());
  }
  if (count > most) throw kTooMany;
  for (const char* const branch : {"success", "failure"}) {
    for (const json& request : list(txn, branch)) {
      if (request.contains("request_txn")) check_size(request["request_txn"], most - count);
    }
  }
}

class Etcd {
 public:
  explicit Etcd(const std::string& file) {
    std::ifstream in(file);
    std::uintmax_t whole = 0;
    for (std::string line; std::getline(in, line) && !in.eof();) {
      const json change = json::parse(line);
      apply(change["path"], change["request"]);
      whole += line.size() + 1;
    }
    if (in.is_open())
      std::filesystem::resize_file(file, whole);  // a kill may have cut the last one
    log_.open(file, std::ios::app);
  }

  /// Throws Refusal, or json's errors.
  json answer(const std::string& path, json request) {
    end_leases();
    if (path == "/v3/kv/range") return with_header(range(request));
    if (path == "/v3/lease/keepalive") return {{"result", with_header(keep_alive(request))}};
    if (path == "/v3/lease/grant" && number(request, "ID") == 0) request["ID"] = new_lease();
    const std::int64_t before = revision_;
    json result = apply(path, request);
    if (path != "/v3/kv/txn" || revision_ > before) remember(path, request);
    return with_header(std::move(result));
  }

 private:
  struct Item {
    std::string value;
    std::int64_t created = 0;
    std::int64_t modified = 0;
    std::int64_t version = 0;
    std::int64_t lease = 0;
  };
  struct Lease {
    std::chrono::seconds ttl;
    Clock::time_point end;
  };

  json apply(const std::string& path, const json& request) {
    if (path == "/v3/kv/txn") return txn(request);
    if (path == "/v3/lease/grant") return grant(request);
    if (path == "/v3/lease/revoke") return revoke(number(request, "ID"));
    throw Refusal{404, 5, "Not Found"};
  }

  void remember(const std::string& path, const json& request) {
    log_ << json{{"path", path}, {"request", request}}.dump() << std::endl;
    if (!log_) throw std::runtime_error("cannot write what has changed");
  }

  json with_header(json answer) const {
    answer["header"] = {{"cluster_id", "1"},
                        {"member_id", "1"},
                        {"revision", std::to_string(revision_)},
                        {"raft_term", "2"}};
    return answer;
  }

  json grant(const json& request) {
    const std::int64_t id = number(request, "ID");
    const auto ttl = std::max(kLeastTtl, std::chrono::seconds(number(request, "TTL")));
    if (!leases_.emplace(id, Lease{ttl, Clock::now() + ttl}).second) throw kLeaseExists;
    return {{"ID", std::to_string(id)}, {"TTL", std::to_string(ttl.count())}};
  }
  std::string new_lease() const {
    std::random_device random;
    for (;;) {
      const std::uint64_t high = random(), low = random();
      const auto id = static_cast<std::int64_t>((high << 32U | low) >> 1U);
      if (id != 0 && !leases_.contains(id)) return std::to_string(id);
    }
  }

  json keep_alive(const json& request) {
    const std::int64_t id = number(request, "ID");
    json answer{{"ID", std::to_string(id)}};
    if (const auto found = leases_.find(id); found != leases_.end()) {
      found->second.end = Clock::now() + found->second.ttl;
      answer["TTL"] = std::to_string(found->second.ttl.count());
    }
    return answer;
  }

  /// Its keys go with it, all in one revision.
  json revoke(std::int64_t id) {
    if (leases_.erase(id) == 0) throw kNoLease;
    if (std::erase_if(items_, [id](const auto& item) { return item.second.lease == id; }) > 0) {
      ++revision_;
    }
    return json::object();
  }

  void end_leases() {
    std::vector<std::int64_t> over;
    for (const auto& [id, lease] : leases_) {
      if (lease.end <= Clock::now()) over.push_back(id);
    }
    for (const std::int64_t id : over) {
      revoke(id);
      remember("/v3/lease/revoke", {{"ID", std::to_string(id)}});
    }
  }

  json range(const json& request) const {
    const std::string first = key_of(request);
    const std::string end = from_base64(text(request, "range_end"));
    const auto behind = end.empty() ? items_.upper_bound(first) : items_.lower_bound(end);
    const std::int64_t limit = number(request, "limit");
    std::int64_t count = 0;
    json kvs = json::array();
    for (auto at = items_.lower_bound(first); at != behind && at != items_.end(); ++at) {
      if (++count > limit && limit > 0) continue;
      const auto& [key, item] = *at;
      kvs.push_back({{"key", to_base64(key)},
                     {"value", item.value},
                     {"create_revision", std::to_string(item.created)},
                     {"mod_revision", std::to_string(item.modified)},
                     {"version", std::to_string(item.version)}});
      if (item.lease != 0) kvs.back()["lease"] = std::to_string(item.lease);
    }
    if (kvs.empty()) return json::object();
    json answer{{"count", std::to_string(count)}, {"kvs", kvs}};
    if (static_cast<std::int64_t>(kvs.size()) < count) answer["more"] = true;
    return answer;
  }

  /// All comparisons, also those of txns within it, are made before the first change.
  json txn(const json& request) {
    check_size(request, kMostOperations);
    puts_in(list(request, "success"));
    puts_in(list(request, "failure"));
    const json taken = branch_of(request);
    check_leases(taken);
    const std::int64_t before = revision_;
    has_put_ = false;
    json answer = run(taken, before + 1);
    if (has_put_) revision_ = before + 1;
    return answer;
  }

  bool is_equal(const json& compare) const {
    const auto found = items_.find(key_of(compare));
    const Item item = found == items_.end() ? Item() : found->second;
    if (compare.value("result", "EQUAL") != "EQUAL") throw Refusal{501, 12, "not of the model"};
    const std::string target = text(compare, "target");
    if (target == "MOD") return item.modified == number(compare, "mod_revision");
    // Of a key that is not there no value is equal, not even the empty one.
    if (target == "VALUE") return item.modified != 0 && item.value == text(compare, "value");
    throw Refusal{501, 12, "not of the model"};
  }

  /// {"succeeded": ..., "requests": [...]}, also for the txns in it.
  json branch_of(const json& txn) const {
    bool is_met = true;
    for (const json& compare : list(txn, "compare")) is_met = is_met && is_equal(compare);
    json requests = list(txn, is_met ? "success" : "failure");
    for (json& request : requests) {
      if (request.contains("request_txn")) {
        request["request_txn"] = branch_of(request["request_txn"]);
      }
    }
    return {{"succeeded", is_met}, {"requests", requests}};
  }

  void check_leases(const json& branch) const {
    for (const json& request : branch["requests"]) {
      if (request.contains("request_txn")) check_leases(request["request_txn"]);
      if (!request.contains("request_put")) continue;
      const std::int64_t lease = number(request["request_put"], "lease");
      if (lease != 0 && !leases_.contains(lease)) throw kNoLease;
    }
  }

  json run(const json& branch, std::int64_t revision) {
    json responses = json::array();
    for (const json& request : branch["requests"]) {
      const auto now = [&] { return json{{"revision", std::to_string(revision_ + has_put_)}}; };
      if (request.contains("request_put")) {
        put(request["request_put"], revision);
        responses.push_back({{"response_put", {{"header", now()}}}});
      } else if (request.contains("request_range")) {
        json found = range(request["request_range"]);
        found["header"] = now();
        responses.push_back({{"response_range", found}});
      } else if (request.contains("request_txn")) {
        json answer = run(request["request_txn"], revision);
        answer["header"] = json::object();
        responses.push_back({{"response_txn", answer}});
      } else {
        throw Refusal{501, 12, "not of the model"};
      }
    }
    json answer = json::object();
    if (branch["succeeded"].get<bool>()) answer["succeeded"] = true;
    if (!responses.empty()) answer["responses"] = responses;
    return answer;
  }

  void put(const json& request, std::int64_t revision) {
    Item& item = items_[key_of(request)];
    if (item.version == 0) item.created = revision;
    item.modified = revision;
    ++item.version;
    item.value = text(request, "value");
    item.lease = number(request, "lease");
    has_put_ = true;
  }

  std::map<std::string, Item> items_;
  std::map<std::int64_t, Lease> leases_;
  std::int64_t revision_ = 1;
  bool has_put_ = false;  // the txn that runs
  std::ofstream log_;
};

/// One connection, which the client keeps.
class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(tcp::socket socket, Etcd& etcd) : socket_(std::move(socket)), etcd_(etcd) {}

  void read() {
    request_ = {};
    http::async_read(socket_, buffer_, request_,
                     [self = shared_from_this()](const error_code& failed, std::size_t) {
                       if (!failed) self->answer();
                     });
  }

 private:
  void answer() {
    response_ = http::response<http::string_body>(http::status::ok, request_.version());
    try {
      const std::string path(request_.target());
      response_.body() = etcd_.answer(path, json::parse(request_.body())).dump();
    } catch (const Refusal& refusal) {
      refuse(refusal);
    } catch (const json::exception& error) {
      refuse({400, 3, error.what()});
    }
    response_.set(http::field::content_type, "application/json");
    response_.keep_alive(request_.keep_alive());
    response_.prepare_payload();
    http::async_write(socket_, response_,
                      [self = shared_from_this()](const error_code& failed, std::size_t) {
                        if (!failed && self->response_.keep_alive()) self->read();
                      });
  }
  void refuse(const Refusal& refusal) {
    response_.result(static_cast<unsigned>(refusal.status));
    response_.body() =
        json{{"error", refusal.text}, {"message", refusal.text}, {"code", refusal.code}}.dump();
  }

  tcp::socket socket_;
  Etcd& etcd_;
  boost::beast::flat_buffer buffer_;
  http::request<http::string_body> request_;
  http::response<http::string_body> response_;
};

void accept(tcp::acceptor& acceptor, Etcd& etcd) {
  acceptor.async_accept([&](const error_code& failed, tcp::socket socket) {
    error_code ignored;  // answers are then merely later
    if (!failed) socket.set_option(tcp::no_delay(true), ignored);
    if (!failed) std::make_shared<Client>(std::move(socket), etcd)->read();
    accept(acceptor, etcd);
  });
}

}  // namespace
}  // namespace orbbuf::simulation

int main(int argc, char** argv) try {
  using namespace orbbuf::simulation;  // NOLINT: of this file
  if (argc != 3) throw std::invalid_argument("give PORT FILE");
  Etcd etcd(argv[2]);
  asio::io_context io(1);
  tcp::acceptor acceptor(io, {tcp::v4(), static_cast<std::uint16_t>(std::stoi(argv[1]))});
  accept(acceptor, etcd);
  std::cerr << "ready to serve client requests" << std::endl;
  io.run();
  return EXIT_SUCCESS;
} catch (const std::exception& error) {
  std::cerr << "orbbuf-etcd-model: " << error.what() << '\n';
  return EXIT_FAILURE;
}
