// SPDX-License-Identifier: Apache-2.0
#include "testing/source_folder.hpp"

namespace orbbuf::test {

const char* const kSourceFolder = ORBBUF_SOURCE_FOLDER;

}  // namespace orbbuf::test
