// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/etcd_client.hpp"

#include <fmt/core.h>
#include <openssl/evp.h>

#include <algorithm>
#include <boost/asio/connect.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::uint64_t kMostBytes = 64UL * 1024 * 1024;
constexpr std::chrono::milliseconds kRound{200};  // when all endpoints have failed in turn
constexpr unsigned kFirstOfServer = 500;

using nlohmann::json;

std::string to_base64(std::string_view text) {
  std::string out(4 * ((text.size() + 2) / 3), '\0');
  EVP_EncodeBlock(reinterpret_cast<unsigned char*>(out.data()),
                  reinterpret_cast<const unsigned char*>(text.data()),
                  static_cast<int>(text.size()));
  return out;
}

std::string from_base64(const std::string& text) {
  std::string out(3 * (text.size() / 4), '\0');
  const int bytes = EVP_DecodeBlock(reinterpret_cast<unsigned char*>(out.data()),
                                    reinterpret_cast<const unsigned char*>(text.data()),
                                    static_cast<int>(text.size()));
  if (bytes < 0) throw std::invalid_argument("not base64");
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with("=") ? 1 : 0;
  out.resize(static_cast<std::size_t>(bytes) - padding);
  return out;
}

/// The gateway writes 64 bits as text, and leaves out what is 0.
std::int64_t number(const json& object, const char* name) {
  const auto found = object.find(name);
  if (found == object.end()) return 0;
  if (found->is_number()) return found->get<std::int64_t>();
  return parse_number<std::int64_t>(found->get_ref<const std::string&>()).value_or(0);
}

json request_of(const KeyTxn& txn) {
  json compare = json::array();
  for (const auto& [key, revision, value] : txn.compare) {
    json one{{"key", to_base64(key)}, {"target", value ? "VALUE" : "MOD"}, {"result", "EQUAL"}};
    if (value) one["value"] = to_base64(*value);
    if (!value) one["mod_revision"] = std::to_string(revision);
    compare.push_back(one);
  }
  json success = json::array();
  for (const auto& [key, value, lease] : txn.puts) {
    json put{{"key", to_base64(key)}, {"value", to_base64(value)}};
    if (lease != 0) put["lease"] = std::to_string(lease);
    success.push_back({{"request_put", put}});
  }
  json failure = json::array();
  for (const std::string& key : txn.reads) {
    const json read{{"request_range", {{"key", to_base64(key)}}}};
    success.push_back(read);
    failure.push_back(read);
  }
  for (const std::string& key : txn.reads_if_refused) {
    failure.push_back({{"request_range", {{"key", to_base64(key)}}}});
  }
  return {{"compare", compare}, {"success", success}, {"failure", failure}};
}

void take_kvs(const json& range, std::vector<KeyValue>& found) {
  if (!range.contains("kvs")) return;
  for (const json& kv : range["kvs"]) {
    found.push_back({from_base64(kv.value("key", "")), from_base64(kv.value("value", "")),
                     number(kv, "mod_revision")});
  }
}

std::vector<KeyTxnOutcome> outcomes_of(const json& answer) {
  const std::int64_t revision = number(answer.at("header"), "revision");
  std::vector<KeyTxnOutcome> outcomes;
  for (const json& response : answer.at("responses")) {
    const json& txn = response.at("response_txn");
    KeyTxnOutcome& outcome = outcomes.emplace_back();
    outcome.is_done = txn.value("succeeded", false);
    outcome.revision = revision;
    for (const json& each : txn.value("responses", json::array())) {
      if (each.contains("response_range")) take_kvs(each["response_range"], outcome.found);
    }
  }
  return outcomes;
}

/// `done` with what `read` makes of the answer.
template <class T, class Read>
EtcdChannel::Done reader(KeyStore::Done<T> done, Read read) {
  return [done = std::move(done), read = std::move(read)](const Result<std::string>& answer) {
    if (!answer) return done(answer.error());
    std::optional<Result<T>> result;
    try {
      result = read(json::parse(answer.value()));
    } catch (const std::exception& error) {  // json's, or from_base64()'s
      result = Error{std::string("etcd: an answer that cannot be read: ") + error.what()};
    }
    done(std::move(*result));
  };
}

/// One beyond all keys that begin with it.
std::string end_of(std::string prefix) {
  ++prefix.back();
  return prefix;
}

}  // namespace

EtcdChannel::EtcdChannel(asio::io_context& main, Options options)
    : main_(main),
      options_(std::move(options)),
      tls_(make_tls_context(options_.tls)),
      resolver_(main),
      timer_(main) {}

void EtcdChannel::async_post(std::string path, std::string body, Done done) {
  if (is_stopped_) {
    asio::post(main_, [done = std::move(done)] { done(Error{"etcd: the server stops"}); });
    return;
  }
  calls_.push_back(
      {std::move(path), std::move(body), std::move(done), Clock::now() + options_.patience});
  asio::post(main_, [this] { next(); });
}

/// Its operations end, unheard.
void EtcdChannel::disconnect() {
  is_connected_ = false;
  resolver_.cancel();
  error_code ignored;  // there is nothing to do about it
  if (const auto link = std::exchange(link_, nullptr)) link->stream.socket().close(ignored);
}

void EtcdChannel::stop() {
  is_stopped_ = true;
  disconnect();
  timer_.cancel();
  for (auto& call : std::exchange(calls_, {})) {
    asio::post(main_, [done = std::move(call.done)] { done(Error{"etcd: the server stops"}); });
  }
}

void EtcdChannel::next() {
  if (is_busy_ || calls_.empty() || is_stopped_) return;
  is_busy_ = true;
  ++requests_;
  begun_ = Clock::now();
  attempt();
}

void EtcdChannel::attempt() {
  if (is_stopped_) return;
  if (Clock::now() >= calls_.front().limit) {
    return finish(Error{fmt::format("etcd: {} did not answer in time", to_string(endpoint()))});
  }
  timer_.expires_after(options_.attempt);
  timer_.async_wait([this](const error_code& aborted) {
    if (aborted || is_stopped_ || !is_busy_) return;  // the answer has come as well
    if (timer_.expiry() <= Clock::now()) on_failed("no answer");
  });
  if (is_connected_) return send();
  connect();
}

template <class Step>
auto EtcdChannel::guarded(const char* what, Step step) {
  return [this, what, step, link = link_](const error_code& failed, const auto&... /*rest*/) {
    if (link != link_ || is_stopped_) return;
    if (failed) return on_failed(fmt::format("{}: {}", what, link->stream.explain(failed)));
    step();
  };
}

void EtcdChannel::connect() {
  link_ = std::make_shared<Link>(tcp::socket(main_), tls_.get());
  resolver_.async_resolve(
      endpoint().host, std::to_string(endpoint().port),
      [this, link = link_](const error_code& failed, const tcp::resolver::results_type& found) {
        if (link != link_ || is_stopped_) return;
        if (failed) return on_failed("resolve: " + failed.message());
        asio::async_connect(link->stream.socket(), found, guarded("connect", [this] {
                              error_code ignored;  // requests are then merely later
                              link_->stream.socket().set_option(tcp::no_delay(true), ignored);
                              const auto ready = [this] {
                                is_connected_ = true;
                                send();
                              };
                              if (!link_->stream.is_tls()) return ready();
                              link_->stream.async_handshake_as_robot(endpoint().host,
                                                                     guarded("TLS", ready));
                            }));
      });
}

void EtcdChannel::send() {
  const Call& call = calls_.front();
  Request& request = link_->request;
  request = Request(http::verb::post, call.path, 11);
  request.set(http::field::host, to_string(endpoint()));
  request.set(http::field::content_type, "application/json");
  request.body() = call.body;
  request.prepare_payload();
  http::async_write(link_->stream, request, guarded("write", [this] {
                      Parser& parser = link_->parser.emplace();
                      parser.body_limit(kMostBytes);
                      http::async_read(link_->stream, link_->buffer, parser,
                                       guarded("read", [this] { on_answer(); }));
                    }));
}

/// A server error, no leader for one, is an endpoint's; what another endpoint would say as well is
/// the answer.
void EtcdChannel::on_answer() {
  auto response = link_->parser->release();
  const unsigned status = response.result_int();
  if (status >= kFirstOfServer) return on_failed(fmt::format("HTTP {}", status));
  if (!response.keep_alive()) disconnect();
  failed_in_turn_ = 0;
  time_spent_ += Clock::now() - begun_;
  if (status == 200) return finish(std::move(response.body()));
  finish(Error{fmt::format("etcd: HTTP {}: {}", status, response.body())});
}

void EtcdChannel::on_failed(const std::string& why) {
  ++failures_;
  disconnect();
  timer_.cancel();
  const std::string what = fmt::format("etcd: {}: {}", to_string(endpoint()), why);
  endpoint_ = (endpoint_ + 1) % options_.endpoints.size();
  if (Clock::now() + kRound >= calls_.front().limit) return finish(Error{what});
  if (++failed_in_turn_ % options_.endpoints.size() != 0) return attempt();
  timer_.expires_after(kRound);
  timer_.async_wait([this](const error_code& aborted) {
    if (!aborted) attempt();
  });
}

void EtcdChannel::finish(Result<std::string> answer) {
  timer_.cancel();
  const Done done = std::move(calls_.front().done);
  calls_.pop_front();
  is_busy_ = false;
  asio::post(main_, [this] { next(); });
  done(std::move(answer));
}

void EtcdClient::async_txns(std::vector<KeyTxn> txns, Done<std::vector<KeyTxnOutcome>> done) {
  waiting_.push_back({std::move(txns), std::move(done)});
  boost::asio::post(main_, [this] { send_txns(); });
}

/// The first call, and with it those after it that fit: etcd refuses a request that puts a key
/// twice.
std::vector<EtcdClient::Call> EtcdClient::take_calls() {
  std::vector<Call> taken;
  std::set<std::string> puts;
  std::size_t count = 0;
  while (!waiting_.empty()) {
    const auto& txns = waiting_.front().txns;
    const bool is_clash = std::ranges::any_of(txns, [&](const KeyTxn& txn) {
      return std::ranges::any_of(txn.puts, [&](const auto& put) { return puts.contains(put.key); });
    });
    if (!taken.empty() && (is_clash || count + txns.size() > kMostTxns)) break;
    for (const KeyTxn& txn : txns) {
      for (const auto& put : txn.puts) puts.insert(put.key);
    }
    count += txns.size();
    taken.push_back(std::move(waiting_.front()));
    waiting_.pop_front();
  }
  return taken;
}

void EtcdClient::send_txns() {
  if (is_sent_ || waiting_.empty()) return;
  is_sent_ = true;
  json success = json::array();
  std::vector<Done<std::vector<KeyTxnOutcome>>> dones;
  std::vector<std::size_t> counts;
  for (Call& call : take_calls()) {
    for (const KeyTxn& txn : call.txns) success.push_back({{"request_txn", request_of(txn)}});
    dones.push_back(std::move(call.done));
    counts.push_back(call.txns.size());
  }
  const std::size_t count = success.size();
  const auto answered = [this, dones = std::move(dones),
                         counts = std::move(counts)](Result<std::vector<KeyTxnOutcome>> answer) {
    is_sent_ = false;
    boost::asio::post(main_, [this] { send_txns(); });
    if (!answer) {
      for (const auto& done : dones) done(answer.error());
      return;
    }
    auto next = std::make_move_iterator(answer.value().begin());
    for (std::size_t i = 0; i < dones.size(); ++i) {
      const auto end = next + static_cast<std::ptrdiff_t>(counts[i]);
      dones[i](std::vector<KeyTxnOutcome>(next, end));
      next = end;
    }
  };
  channel_.async_post("/v3/kv/txn", json{{"success", success}}.dump(),
                      reader<std::vector<KeyTxnOutcome>>(answered, [count](const json& answer) {
                        auto outcomes = outcomes_of(answer);
                        if (outcomes.size() != count) {
                          throw std::invalid_argument("not all txns answered");
                        }
                        return outcomes;
                      }));
}

void EtcdClient::async_range(KeyRange range, Done<std::vector<KeyValue>> done) {
  json request{{"key", to_base64(range.prefix + range.from)},
               {"range_end", to_base64(end_of(range.prefix))}};
  if (range.most > 0) request["limit"] = std::to_string(range.most);
  channel_.async_post("/v3/kv/range", request.dump(),
                      reader<std::vector<KeyValue>>(std::move(done), [](const json& answer) {
                        std::vector<KeyValue> found;
                        take_kvs(answer, found);
                        return found;
                      }));
}

void EtcdClient::async_grant(std::chrono::seconds ttl, Done<std::int64_t> done) {
  const json request{{"TTL", std::to_string(ttl.count())}};
  channel_.async_post("/v3/lease/grant", request.dump(),
                      reader<std::int64_t>(std::move(done), [](const json& answer) {
                        const auto lease = number(answer, "ID");
                        if (lease == 0) throw std::invalid_argument("no lease");
                        return lease;
                      }));
}

void EtcdClient::async_keep_alive(std::int64_t lease, Done<bool> done) {
  const json request{{"ID", std::to_string(lease)}};
  channel_.async_post("/v3/lease/keepalive", request.dump(),
                      reader<bool>(std::move(done), [](const json& answer) {
                        return number(answer.at("result"), "TTL") > 0;
                      }));
}

void EtcdClient::async_revoke(std::int64_t lease, Done<bool> done) {
  const json request{{"ID", std::to_string(lease)}};
  channel_.async_post("/v3/lease/revoke", request.dump(),
                      reader<bool>(std::move(done), [](const json& /*answer*/) { return true; }));
}

}  // namespace orbbuf
