// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace orbbuf::bench {

/// Prints what reducing a JPEG of quality 80 costs, in JPEG encodes at quality 80 of the same
/// image, and how its luma and its bytes compare with an image encoded so from the start. `data`:
/// the folder of the recorded sequences; without them the images are of the generated scene.
void measure_requantising(const std::filesystem::path& data);

}  // namespace orbbuf::bench
