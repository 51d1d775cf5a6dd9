// SPDX-License-Identifier: Apache-2.0
// The parts of Beast that are no templates, compiled here once (BOOST_BEAST_SEPARATE_COMPILATION).
#include <boost/beast/src.hpp>
