// SPDX-License-Identifier: Apache-2.0
#include "server/fleet_member.hpp"

#include <optional>
#include <utility>
#include <vector>

#include "common/log.hpp"
#include "server/fleet/fleet.hpp"

namespace orbbuf {
namespace {

class EtcdFleetMember final : public FleetMember {
 public:
  EtcdFleetMember(boost::asio::io_context& main, boost::asio::thread_pool& files,
                  const Settings& settings)
      : fleet_(main, files, settings.fleet, settings.sinks.files_path,
               [this] { return listener_ == nullptr ? 0 : listener_->robots(); }) {}

  FleetPage page() override {
    return {[this](const auto& from, auto answer) { fleet_.overview().async_page(from, answer); },
            [this] { return fleet_.metrics(); }};
  }

  void share(Listener& listener) override {
    listener_ = &listener;
    listener.share_by(fleet_);
  }

  void drain(ControlSocket::Answer answer) override {
    if (is_drained_) return answer(kDrained);
    draining_.push_back(std::move(answer));
    if (draining_.size() > 1) return;
    fleet_.async_drain([this](const std::optional<Error>& error) {
      if (error) return on_drained(*error);
      log_info("draining: the robots are sent to other servers");
      listener_->move_all([this](const std::vector<SessionKey>& told) {
        log_info("drained: no robot is here any more");
        for (const auto& [robot_id, session_id] : told) leaving_.push_back({robot_id, session_id});
        fleet_.async_leave(leaving_, [this](const auto& left) { on_left(left); });
      });
    });
  }

  void start() override { fleet_.start(); }
  void async_stop(std::function<void()> stopped) override {
    draining_.clear();
    fleet_.async_stop(std::move(stopped));
  }

 private:
  static constexpr const char* kDrained = "drained\n";

  void on_left(const Result<std::vector<fleet::SessionName>>& staying) {
    if (!staying) return on_drained(staying.error());
    leaving_ = staying.value();
    is_drained_ = leaving_.empty();
    if (is_drained_) return on_drained(kDrained);
    std::string names;
    for (const auto& session : leaving_) names += " " + session.text();
    Error error{"these robots do not reach another server; is its fleet.address right?" + names};
    log_error("drain: {}", error.text);
    on_drained(std::move(error));
  }

  void on_drained(const Result<std::string>& outcome) {
    for (const auto& answer : std::exchange(draining_, {})) answer(outcome);
  }

  Listener* listener_ = nullptr;
  fleet::Fleet fleet_;
  std::vector<ControlSocket::Answer> draining_;  // those who wait
  std::vector<fleet::SessionName> leaving_;      // told to, and not yet elsewhere
  bool is_drained_ = false;
};

}  // namespace

std::unique_ptr<FleetMember> make_fleet_member(boost::asio::io_context& main,
                                               boost::asio::thread_pool& files,
                                               const Settings& settings) {
  if (!settings.fleet.is_on()) return nullptr;
  return std::make_unique<EtcdFleetMember>(main, files, settings);
}

}  // namespace orbbuf
