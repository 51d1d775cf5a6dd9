/* SPDX-License-Identifier: Apache-2.0 */
#include "common/dds/reader_states.h"

#include <dds/dds.h>
// clang-format off: the others need these
#include <dds/ddsi/ddsi_entity.h>
#include <dds/ddsi/q_hbcontrol.h>
// clang-format on
#include <dds/ddsi/ddsi_domaingv.h>
#include <dds/ddsi/ddsi_endpoint.h>
#include <dds/ddsi/ddsi_entity_index.h>
#include <dds/ddsi/ddsi_entity_match.h>
#include <dds/ddsi/q_bswap.h>
#include <dds/ddsi/q_thread.h>
#include <dds/ddsi/q_whc.h>
#include <string.h>

size_t orbbuf_reader_states(int writer, struct orbbuf_reader_state* to, size_t most,
                            uint64_t* kept_from) {
  size_t count = 0;
  dds_guid_t guid;
  *kept_from = 0;
  /* The first call notes the domain for this thread. */
  if (dds_get_matched_subscriptions(writer, NULL, 0) <= 0) return 0;
  if (dds_get_guid(writer, &guid) != DDS_RETCODE_OK) return 0;
  ddsi_guid_t key;
  memcpy(&key, &guid, sizeof key);
  key = nn_ntoh_guid(key);
  struct thread_state* const thread = lookup_thread_state();
  const struct ddsi_domaingv* const domain = ddsrt_atomic_ldvoidp(&thread->gv);
  thread_state_awake(thread, domain);
  struct ddsi_writer* const found = entidx_lookup_writer_guid(domain->entity_index, &key);
  if (found != NULL) {
    ddsrt_mutex_lock(&found->e.lock);
    struct whc_state kept;
    whc_get_state(found->whc, &kept);
    *kept_from = WHCST_ISEMPTY(&kept) ? 0 : (uint64_t)kept.min_seq;
    ddsrt_avl_iter_t each;
    const struct ddsi_wr_prd_match* reader =
        ddsrt_avl_iter_first(&ddsi_wr_readers_treedef, &found->readers, &each);
    for (; reader != NULL && count < most; reader = ddsrt_avl_iter_next(&each)) {
      if (!reader->is_reliable) continue;
      const ddsi_guid_t id = nn_hton_guid(reader->prd_guid);
      memcpy(to[count].guid, &id, sizeof to[count].guid);
      to[count].acknowledged = (uint64_t)reader->seq;
      ++count;
    }
    ddsrt_mutex_unlock(&found->e.lock);
  }
  thread_state_asleep(thread);
  return count;
}
