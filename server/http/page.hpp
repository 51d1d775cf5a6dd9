// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/http/response.hpp"

namespace orbbuf {

/// The one page there is, with its style and its script in it: what it shows depends on the path.
/// Its policy of contents allows these two, by their hashes, and what this server sends; nothing
/// else.
HttpResponse page();

}  // namespace orbbuf
