// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <cstddef>
#include <map>
#include <utility>

namespace orbbuf {

/// Who has to leave when there is no room for one more: of the connections (pointers) of which
/// `may_end` is true, the one that has waited for longest, of the address that has the most of
/// them. So a host that fills the room loses its own connections. Null: none may end.
template <class Connections, class MayEnd>
auto longest_waiting(const Connections& connections, MayEnd may_end) ->
    typename Connections::value_type {
  struct Waiting {
    std::ptrdiff_t count = 0;
    typename Connections::value_type oldest{};
    auto rank() const { return std::pair(-count, oldest->since()); }
  };
  std::map<boost::asio::ip::address, Waiting> by_address;
  for (const auto& connection : connections) {
    if (!may_end(*connection)) continue;
    Waiting& waiting = by_address[connection->peer().address()];
    ++waiting.count;
    const bool is_older = !waiting.oldest || connection->since() < waiting.oldest->since();
    if (is_older) waiting.oldest = connection;
  }
  const auto most = std::min_element(
      by_address.begin(), by_address.end(),
      [](const auto& a, const auto& b) { return a.second.rank() < b.second.rank(); });
  return most == by_address.end() ? nullptr : most->second.oldest;
}

}  // namespace orbbuf
