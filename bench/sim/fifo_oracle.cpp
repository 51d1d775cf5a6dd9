// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/fifo_oracle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace orbbuf::sim {
namespace {

/// How good a sequence is up to one of its frames.
struct Worth {
  int smallest = -1;
  double log_product = 0;

  std::pair<int, double> order() const { return {smallest, log_product}; }
};

/// One frame that received[k] may be: the best sequence that ends with it.
struct Node {
  std::size_t frame = 0;
  Worth worth;
  std::size_t previous = 0;  ///< index in the layer before
};

Node best_node(std::size_t frame, const std::vector<Node>& before,
               const PairSimilarity& similarity) {
  Node node{frame, {}, 0};
  for (std::size_t i = 0; i < before.size() && before[i].frame < frame; ++i) {
    if (before[i].worth.smallest < node.worth.smallest) continue;
    const int value = similarity(before[i].frame, frame);
    const Worth worth{std::min(before[i].worth.smallest, value),
                      before[i].worth.log_product + std::log1p(value)};
    if (worth.order() > node.worth.order()) {
      node.worth = worth;
      node.previous = i;
    }
  }
  return node;
}

}  // namespace

Choices choices(const Delivery& delivery) {
  const std::size_t count = delivery.received.size();
  Choices choices{std::vector<std::size_t>(count), std::vector<std::size_t>(count)};
  for (std::size_t k = 0; k < count; ++k) {
    choices.first[k] = k;
    choices.last[k] = k + delivery.drops_before[k];
  }
  for (std::size_t arrived = 0; arrived < delivery.drops_after.size(); ++arrived) {
    const std::size_t k = arrived - delivery.drops_after[arrived];
    if (k < count) choices.first[k] = std::max(choices.first[k], arrived);
  }
  for (std::size_t k = 1; k < count; ++k) {
    choices.first[k] = std::max(choices.first[k], choices.first[k - 1] + 1);
    const std::size_t back = count - 1 - k;
    choices.last[back] = std::min(choices.last[back], choices.last[back + 1] - 1);
  }
  return choices;
}

std::vector<std::size_t> fifo_oracle(const Delivery& delivery, const PairSimilarity& similarity) {
  const Choices range = choices(delivery);
  std::vector<std::vector<Node>> layers(range.first.size());
  for (std::size_t k = 0; k < layers.size(); ++k) {
    for (std::size_t frame = range.first[k]; frame <= range.last[k]; ++frame) {
      layers[k].push_back(k == 0 ? Node{frame, {std::numeric_limits<int>::max(), 0}, 0}
                                 : best_node(frame, layers[k - 1], similarity));
    }
  }
  std::vector<std::size_t> received(layers.size());
  std::size_t choice = 0;
  for (std::size_t k = layers.size(); k-- > 0;) {
    if (k + 1 == layers.size()) {
      const auto best = std::ranges::max_element(
          layers[k], {}, [](const Node& node) { return node.worth.order(); });
      choice = static_cast<std::size_t>(best - layers[k].begin());
    }
    received[k] = layers[k][choice].frame;
    choice = layers[k][choice].previous;
  }
  return received;
}

}  // namespace orbbuf::sim
