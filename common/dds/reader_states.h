/* SPDX-License-Identifier: Apache-2.0 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* How far a reliable reader in another process is. */
struct orbbuf_reader_state {
  unsigned char guid[16];
  uint64_t acknowledged; /* the last message of those that it has without a gap */
};

/* The reliable readers of a writer, `most` of them at most, and in `kept_from` the oldest message
   that the writer still has for them, 0 if it has none. Cyclone DDS has this in headers that it
   installs but does not promise to keep, and that are not of C++. */
size_t orbbuf_reader_states(int writer, struct orbbuf_reader_state* to, size_t most,
                            uint64_t* kept_from);

#ifdef __cplusplus
}
#endif
