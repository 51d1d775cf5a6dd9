// SPDX-License-Identifier: Apache-2.0
// Frames over a stream of NATS JetStream's: send URL defaults|best | receive URL. `best` publishes
// without waiting for each acknowledgement, and reconnects as fast and as long as it can.
#include <nats/nats.h>

#include <string>

#include "bench/rivals/peers/messages.hpp"

namespace {

void require(natsStatus status, const char* attempt) {
  if (status == NATS_OK) return;
  std::fprintf(stderr, "%s: %s\n", attempt, natsStatus_GetText(status));
  std::exit(EXIT_FAILURE);
}

natsConnection* connect(const char* url, bool is_best) {
  constexpr std::int64_t kSecondMs = 1000;
  natsOptions* options = nullptr;
  require(natsOptions_Create(&options), "options");
  natsOptions_SetURL(options, url);
  if (is_best) {
    natsOptions_SetMaxReconnect(options, -1);
    natsOptions_SetReconnectWait(options, kSecondMs / 4);
    natsOptions_SetReconnectJitter(options, 0, 0);
    natsOptions_SetPingInterval(options, kSecondMs);
    natsOptions_SetReconnectBufSize(options, 1 << 30);
  }
  natsConnection* connection = nullptr;
  for (int tries = 0; natsConnection_Connect(&connection, options) != NATS_OK; ++tries) {
    if (tries == 50) require(NATS_NO_SERVER, url);
    nats_Sleep(kSecondMs / 10);
  }
  return connection;
}

void on_frame(natsConnection*, natsSubscription*, natsMsg* message, void*) {
  orbbuf::bench::print_arrival(reinterpret_cast<const std::uint8_t*>(natsMsg_GetData(message)),
                               static_cast<std::size_t>(natsMsg_GetDataLength(message)));
  natsMsg_Ack(message, nullptr);
  natsMsg_Destroy(message);
}

[[noreturn]] void send(jsCtx* stream, bool is_best) {
  for (;;) {
    const orbbuf::bench::Message message = orbbuf::bench::next_message();
    const auto size = static_cast<int>(message.size());
    const natsStatus status =
        is_best ? js_PublishAsync(stream, "camera", message.data(), size, nullptr)
                : js_Publish(nullptr, stream, "camera", message.data(), size, nullptr, nullptr);
    if (status != NATS_OK) std::fprintf(stderr, "publish: %s\n", natsStatus_GetText(status));
  }
}

void receive(jsCtx* stream) {
  jsStreamConfig config;
  const char* subjects[] = {"camera"};
  require(jsStreamConfig_Init(&config), "stream");
  config.Name = "CAMERA";
  config.Subjects = subjects;
  config.SubjectsLen = 1;
  config.Storage = js_MemoryStorage;
  config.MaxMsgs = 1000;
  require(js_AddStream(nullptr, stream, &config, nullptr, nullptr), "stream");
  natsSubscription* subscription = nullptr;
  require(
      js_Subscribe(&subscription, stream, "camera", on_frame, nullptr, nullptr, nullptr, nullptr),
      "subscribe");
  for (;;) nats_Sleep(1000);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const bool is_best = argc > 3 && std::string(argv[3]) == "best";
  natsConnection* connection = connect(argv[2], is_best || std::string(argv[1]) == "receive");
  jsCtx* stream = nullptr;
  jsOptions options;
  jsOptions_Init(&options);
  options.PublishAsync.MaxPending = 0;  // no bound
  require(natsConnection_JetStream(&stream, connection, &options), "JetStream");
  if (std::string(argv[1]) == "receive") receive(stream);
  send(stream, is_best);
}
