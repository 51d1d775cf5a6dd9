// SPDX-License-Identifier: Apache-2.0
#include "common/dds/raw_topic.hpp"

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <dds/ddsi/q_radmin.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

#include "common/dds/dds_participant.hpp"

namespace orbbuf {
namespace {

/// What Cyclone keeps of a message; the bytes follow it in memory.
struct Serdata : ddsi_serdata {
  std::size_t size;
  std::uint8_t* bytes() { return reinterpret_cast<std::uint8_t*>(this + 1); }
};
Serdata& own(ddsi_serdata* data) { return *static_cast<Serdata*>(data); }
/// Its bytes do not change.
Serdata& own(const ddsi_serdata* data) { return own(const_cast<ddsi_serdata*>(data)); }

/// DDS sends units of 4 bytes: up to 3 behind the end are read.
Serdata* make(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size) {
  void* const memory = std::calloc(1, sizeof(Serdata) + (size + 3) / 4 * 4);
  if (memory == nullptr) return nullptr;
  auto* const data = new (memory) Serdata{};
  ddsi_serdata_init(data, type, kind);
  data->hash = type->serdata_basehash;
  data->size = size;
  return data;
}

ddsi_serdata* from_fragments(const ddsi_sertype* type, ddsi_serdata_kind kind,
                             const nn_rdata* fragment, std::size_t size) {
  Serdata* const data = make(type, kind, size);
  if (data == nullptr) return nullptr;
  std::size_t have = 0;
  for (; fragment != nullptr && have < size; fragment = fragment->nextfrag) {
    if (fragment->maxp1 <= have || fragment->min > have) continue;  // they may overlap
    const std::size_t end = std::min<std::size_t>(fragment->maxp1, size);
    const unsigned char* const payload =
        NN_RMSG_PAYLOADOFF(fragment->rmsg, NN_RDATA_PAYLOAD_OFF(fragment));
    std::memcpy(data->bytes() + have, payload + (have - fragment->min), end - have);
    have = end;
  }
  return data;
}

ddsi_serdata* from_pieces(const ddsi_sertype* type, ddsi_serdata_kind kind,
                          ddsrt_msg_iovlen_t count, const ddsrt_iovec_t* pieces, std::size_t size) {
  Serdata* const data = make(type, kind, size);
  if (data == nullptr) return nullptr;
  std::size_t have = 0;
  for (ddsrt_msg_iovlen_t i = 0; i < count && have < size; ++i) {
    const std::size_t bytes = std::min<std::size_t>(pieces[i].iov_len, size - have);
    std::memcpy(data->bytes() + have, pieces[i].iov_base, bytes);
    have += bytes;
  }
  return data;
}

ddsi_serdata* to_untyped(const ddsi_serdata* data) {
  Serdata* const key = make(data->type, SDK_KEY, 0);
  if (key != nullptr) key->type = nullptr;
  return key;
}

ddsi_serdata* lend(const ddsi_serdata* data, std::size_t offset, std::size_t size,
                   ddsrt_iovec_t* to) {
  to->iov_base = own(data).bytes() + offset;
  to->iov_len = size;
  return ddsi_serdata_ref(data);
}

/// Member by member: later releases have more of them.
const ddsi_serdata_ops kDataOps = [] {
  using Data = ddsi_serdata;
  using Type = ddsi_sertype;
  ddsi_serdata_ops ops{};
  ops.eqkey = [](const Data*, const Data*) { return true; };
  ops.get_size = [](const Data* data) { return static_cast<std::uint32_t>(own(data).size); };
  ops.from_ser = from_fragments;
  ops.from_ser_iov = from_pieces;
  ops.from_keyhash = [](const Type* type, const ddsi_keyhash*) -> Data* {
    return make(type, SDK_KEY, 0);
  };
  ops.from_sample = [](const Type*, ddsi_serdata_kind, const void*) -> Data* { return nullptr; };
  ops.to_ser = [](const Data* data, std::size_t offset, std::size_t size, void* to) {
    std::memcpy(to, own(data).bytes() + offset, size);
  };
  ops.to_ser_ref = lend;
  ops.to_ser_unref = [](Data* data, const ddsrt_iovec_t*) { ddsi_serdata_unref(data); };
  ops.to_sample = [](const Data*, void*, void**, void*) { return false; };
  ops.to_untyped = to_untyped;
  ops.untyped_to_sample = [](const Type*, const Data*, void*, void**, void*) { return false; };
  ops.free = [](Data* data) { std::free(&own(data)); };
  ops.print = [](const Type*, const Data*, char* to, std::size_t size) {
    return static_cast<std::size_t>(std::snprintf(to, size, "bytes"));
  };
  ops.get_keyhash = [](const Data*, ddsi_keyhash* to, bool) { *to = {}; };
  return ops;
}();

const ddsi_sertype_ops kTypeOps = [] {
  using Type = ddsi_sertype;
  ddsi_sertype_ops ops{};
  ops.version = ddsi_sertype_v0;
  ops.free = [](Type* type) {
    ddsi_sertype_fini(type);
    std::free(type);
  };
  ops.zero_samples = [](const Type*, void*, std::size_t) {};
  ops.realloc_samples = [](void** to, const Type*, void*, std::size_t, std::size_t) {
    *to = nullptr;
  };
  ops.free_samples = [](const Type*, void**, std::size_t, dds_free_op_t) {};
  ops.equal = [](const Type*, const Type*) { return true; };  // the names are compared before
  ops.hash = [](const Type*) { return 0U; };
  return ops;
}();

}  // namespace

RawTopic::RawTopic(int participant, const std::string& name, const std::string& type) {
  auto* own_type = static_cast<ddsi_sertype*>(std::calloc(1, sizeof(ddsi_sertype)));
  if (own_type == nullptr) throw std::bad_alloc();
  constexpr bool kHasNoKey = true;
  ddsi_sertype_init(own_type, type.c_str(), &kTypeOps, &kDataOps, kHasNoKey);
  entity_ =
      dds_create_topic_sertype(participant, name.c_str(), &own_type, nullptr, nullptr, nullptr);
  if (entity_ < 0) ddsi_sertype_unref(own_type);
  require_dds(entity_, "make the topic " + name);
  type_ = own_type;  // an equal one, if there was one
}

RawTopic::~RawTopic() { dds_delete(entity_); }

int RawTopic::write(int writer, std::span<const std::uint8_t> cdr, std::int64_t time_ns) const {
  Serdata* const data = make(type_, SDK_DATA, cdr.size());
  if (data == nullptr) return DDS_RETCODE_OUT_OF_RESOURCES;
  std::ranges::copy(cdr, data->bytes());
  data->timestamp.v = time_ns;
  data->statusinfo = 0;
  return dds_forwardcdr(writer, data);  // which takes it
}

std::optional<RawMessage> take_raw(int reader) {
  for (;;) {
    ddsi_serdata* data = nullptr;
    dds_sample_info_t info{};
    if (dds_takecdr(reader, &data, 1, &info, DDS_ANY_STATE) <= 0) return std::nullopt;
    std::optional<RawMessage> message;
    if (info.valid_data) {
      const std::span<const std::uint8_t> cdr(own(data).bytes(), own(data).size);
      message = RawMessage{{cdr.begin(), cdr.end()},
                           info.source_timestamp == DDS_TIME_INVALID ? 0 : info.source_timestamp,
                           info.publication_handle};
    }
    ddsi_serdata_unref(data);
    if (message) return message;
  }
}

}  // namespace orbbuf
