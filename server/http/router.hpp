// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "server/http/request_reader.hpp"
#include "server/http/response.hpp"
#include "server/live/metrics.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {

/// What there is to be seen, by path (docs/live-page.md). Read-only. Thread-bound to `main`; what
/// reads the disk is done on `files`, one thing at a time: robots' frames wait for no more of it.
class Router {
 public:
  using Answer = std::function<void(HttpResponse)>;

  /// `folder`: where sessions are kept; empty: nowhere. `is_local`: only this machine can connect,
  /// so a request for another host was sent by a page from there that misleads a browser here.
  Router(boost::asio::io_context& main, PoolStrand files, const Metrics& metrics,
         std::filesystem::path folder, bool is_local);

  /// Runs `answer` once, from within the call or later.
  void answer(const HttpRequest& request, Answer answer) const;

  /// False: it was sent by a page that misleads a browser here (`is_local`).
  bool is_for_this_host(const HttpRequest& request) const;

 private:
  using Words = std::vector<std::string>;  // of a path, between the slashes

  void answer_path(const HttpRequest& request, const Words& words, Answer answer) const;
  HttpResponse prometheus() const;
  HttpResponse robots(const std::string& query) const;
  HttpResponse image(const std::string& robot) const;
  void session_file(const Words& words, Answer answer) const;
  void sessions(const Words& words, Answer answer) const;
  void run_on_files(std::function<HttpResponse()> work, Answer answer) const;

  boost::asio::io_context& main_;
  mutable PoolStrand files_;
  const Metrics& metrics_;
  const std::filesystem::path folder_;
  const bool is_local_;
};

}  // namespace orbbuf
