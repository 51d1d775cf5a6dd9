// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

/// What is seen of a machine from outside, for the judge.
namespace orbbuf::simulation {

/// Its program has written that to its log.
void note_log(int machine, std::string_view text);
/// Its program opens a file to read it: perhaps a frame.
void note_open(int machine, std::string_view path);

}  // namespace orbbuf::simulation
