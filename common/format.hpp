// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

/// Of the precompiled headers: fmt before its version 10 compiles all its formatting again in each
/// file that formats. Here log.cpp does that for all.
#if FMT_VERSION < 100000
extern template void fmt::detail::vformat_to<char>(fmt::detail::buffer<char>&, fmt::string_view,
                                                   fmt::format_args, fmt::detail::locale_ref);
#endif
