// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// A line for `orbbufd --probe`: how many samples the stream has in `time`, or a file in all, at
/// what rate, and how long from one to the next. Blocks for `time`, unless it is a file. Throws
/// std::runtime_error if the source cannot be opened.
std::string probe_samples(const SampleStreamSettings& settings, std::chrono::seconds time);

}  // namespace orbbuf
