// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "daemon/capture/frame_source.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

/// Opens the source that `settings.kind` names; what is not a camera is paced and looped as asked.
/// Throws std::runtime_error saying what was tried, on what and why, if it cannot deliver a first
/// frame.
std::unique_ptr<FrameSource> make_source(const SourceSettings& settings);

}  // namespace orbbuf
