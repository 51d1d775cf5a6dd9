// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/etcd_client.hpp"

#include <openssl/evp.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <charconv>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

namespace orbbuf {
namespace {

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
  const auto& text = found->get_ref<const std::string&>();
  std::int64_t value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

json request_of(const KeyTxn& txn) {
  json compare = json::array();
  for (const auto& [key, revision] : txn.compare) {
    compare.push_back({{"key", to_base64(key)},
                       {"target", "MOD"},
                       {"result", "EQUAL"},
                       {"mod_revision", std::to_string(revision)}});
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
