// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace orbbuf {

/// Whether `host`, that of a request, is localhost or an address, with or without a port. A page of
/// another machine that has a name cannot make a browser say so.
bool is_own_host(const std::string& host);

/// Whether a page from `page_host` may see what a request to `host` shows: it comes from the
/// viewer's own machine, or from the very address that the request is sent to. Ports do not count.
bool is_own_page(const std::string& page_host, const std::string& host);

}  // namespace orbbuf
