// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/facts.hpp"

#include <algorithm>
#include <charconv>
#include <string>

#include "testing/simulation/disk.hpp"
#include "testing/simulation/world.hpp"

namespace orbbuf::simulation {
namespace {

/// The number behind `word`; 0: there is none.
std::uint64_t number_after(std::string_view text, std::string_view word) {
  const std::size_t at = text.find(word);
  std::uint64_t number = 0;
  if (at != std::string_view::npos) {
    std::from_chars(text.data() + at + word.size(), text.data() + text.size(), number);
  }
  return number;
}

SessionFacts* session_of(int number) {
  const int session = machine(number).session;
  return session < 0 ? nullptr : &world->sessions[static_cast<std::size_t>(session)];
}

void note_line(int number, std::string_view line) {
  constexpr std::size_t kTimeChars = 25;  // the machine's clock; the trace has the world's
  std::string text(line.substr(std::min(kTimeChars, line.size())));
  for (std::size_t at; (at = text.find(world_folder)) != std::string::npos;) {
    text.erase(at, world_folder.size());
  }
  if (SessionFacts* const facts = session_of(number)) {
    if (const std::size_t at = text.find(", session ");
        at != std::string::npos && facts->id[0] == 0) {
      const auto id = std::string_view(text).substr(at + 10);
      id.substr(0, id.find(',')).copy(facts->id.data(), facts->id.size() - 1);
    }
    if (text.find("captured ") != std::string::npos) {
      facts->acknowledged = std::max(facts->acknowledged, number_after(text, "acknowledged "));
      facts->spooled = number_after(text, "spooled ");
      facts->most_held = std::max(
          facts->most_held, number_after(text, "waiting ") + number_after(text, "in flight "));
      facts->most_in_flight = std::max(facts->most_in_flight, number_after(text, "in flight "));
    }
    if (text.find("the server has lost frames that it had acknowledged") != std::string::npos) {
      facts->was_forgotten = true;
    }
    if (text.find("session ended: captured ") != std::string::npos) {
      facts->has_closed = true;
      facts->left += number_after(text, "waiting ") + number_after(text, "in flight ");
    }
    if (text.find(" frames are still undelivered after ") != std::string::npos) {
      facts->left += number_after(text, "link: ");
    }
  }
  trace_line(number, text);
}

}  // namespace

void note_log(int number, std::string_view text) {
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    note_line(number, text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
}

void note_open(int number, std::string_view path) {
  if (path.find("/source/") == std::string_view::npos || !path.ends_with(".jpg")) return;
  if (SessionFacts* const facts = session_of(number)) ++facts->opened;
}

}  // namespace orbbuf::simulation
