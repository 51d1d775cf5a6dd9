// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf::test {

/// The folder of this checkout. It is in one object file, so that a compiler's cache serves
/// checkouts in other folders.
extern const char* const kSourceFolder;

}  // namespace orbbuf::test
