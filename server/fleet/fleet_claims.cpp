// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fleet_claims.hpp"

#include <utility>

#include "server/fleet/earlier_segments.hpp"

namespace orbbuf::fleet {

class FleetClaims::FleetClaim final : public SessionClaim {
 public:
  FleetClaim(Fleet& fleet, Owned owned) : fleet_(fleet), owned_(std::move(owned)) {}

  void async_may_acknowledge(const wire::Position& position, Answer answer) override {
    fleet_.recorder().async_record(owned_.claim, position, std::move(answer));
  }
  void hurry() override { fleet_.recorder().hurry(); }
  void leave(bool has_ended) override {
    if (has_ended) fleet_.end(owned_);
  }
  wire::Position acknowledged_before() const override { return owned_.recorded; }
  std::int64_t revision() const { return owned_.claim.revision; }

 private:
  Fleet& fleet_;
  const Owned owned_;
};

FleetClaims::FleetClaims(boost::asio::io_context& main, boost::asio::thread_pool& files,
                         Fleet& fleet, std::string server, std::filesystem::path folder)
    : main_(main),
      files_(files),
      fleet_(fleet),
      server_(std::move(server)),
      folder_(std::move(folder)) {}

std::string FleetClaims::session_in(const std::string& folder) const {
  return parse_folder(folder).session_id;
}

void FleetClaims::async_enter(const SessionKey& session, std::function<void(Outcome)> entered) {
  if (parse_folder(session.second).epoch > 1) {
    return entered(Error{session.second + " is the name of a later part of a session"});
  }
  fleet_.async_enter({session.first, session.second},
                     [this, session, entered = std::move(entered)](const auto& outcome) {
                       if (!outcome) return entered(outcome.error());
                       if (const auto* owned = std::get_if<Owned>(&outcome.value())) {
                         return entered(grant(session, *owned));
                       }
                       entered(Moved{std::get<Fleet::Moved>(outcome.value()).address});
                     });
}

FleetClaims::Granted FleetClaims::grant(const SessionKey& session, const Owned& owned) {
  std::erase_if(claims_, [](const auto& entry) { return entry.second.expired(); });
  auto claim = claims_[session].lock();
  if (!claim || claim->revision() != owned.claim.revision) {
    claim = std::make_shared<FleetClaim>(fleet_, owned);
    claims_[session] = claim;
  }
  const auto& [server, epoch, from] = owned.segment;
  Granted granted{std::move(claim), {epoch, from}, nullptr};
  if (!granted.segment.is_first()) {
    granted.earlier = std::make_shared<EarlierSegments>(
        main_, files_, fleet_.store(),
        EarlierSegments::Options{{session.first, session.second}, epoch, server_, folder_});
  }
  return granted;
}

}  // namespace orbbuf::fleet
