// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf {

/// How often this thread has called operator new, which is replaced in the whole test binary. (In
/// a file of its own: where GCC inlines only one of the pair, it warns that they do not match.)
int allocations();

}  // namespace orbbuf
