// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace orbbuf {

/// Whether `host`, of a request or of the page that sent it, is localhost or an address, with or
/// without a port. No page of another machine can make a browser say so.
bool is_own_host(const std::string& host);

}  // namespace orbbuf
