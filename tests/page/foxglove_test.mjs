// SPDX-License-Identifier: Apache-2.0
// node foxglove_test.mjs ORBBUFD ORBBUF_SERVER: see page.sh. Foxglove's own client of its WebSocket protocol sees each
// image that the server writes to its files from then on, byte for byte.
import assert from "node:assert/strict";
import { mkdtempSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import protocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";
import { Program, set } from "./program.mjs";

const [orbbufd, orbbufServer] = process.argv.slice(2);
const work = mkdtempSync(path.join(tmpdir(), "orbbuf-foxglove-"));

/** The field of a protobuf message that has this number and is bytes or a text. */
function field(message, wanted) {
  let at = 0;
  const varint = () => {
    let value = 0n;
    for (let shift = 0n; ; shift += 7n) {
      const byte = message[at++];
      value |= BigInt(byte & 0x7f) << shift;
      if (byte < 0x80) return Number(value);
    }
  };
  while (at < message.length) {
    const tag = varint();
    assert.equal(tag & 7, 2, "bytes, a text or a message");
    const length = varint();
    if (tag >> 3 === wanted) return message.subarray(at, at + length);
    at += length;
  }
  return undefined;
}

const server = new Program(orbbufServer, set({ "listen.address": "127.0.0.1:0", "http.address": "127.0.0.1:0",
  "files.path": `${work}/data` }));
const origin = (await server.line(/live page on http:(\S+)\//))[1];
const port = (await server.line(/ listening on \S+:(\d+)/))[1];

/** A viewer by one of the subprotocols, and the images that it is shown, by time. */
async function view(subprotocol) {
  const viewer = { images: new Map(), topics: new Map() };
  const socket = new WebSocket(`ws:${origin}`, [subprotocol]);
  const client = new protocol.FoxgloveClient({ ws: socket });
  viewer.close = () => client.close();
  client.on("advertise", (channels) => {
    for (const channel of channels) {
      viewer.topics.set(channel.topic, channel);
      if (channel.topic === "/r/image") client.subscribe(channel.id);
    }
  });
  client.on("message", ({ timestamp, data }) => {
    const image = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    assert.equal(new TextDecoder().decode(field(image, 3)), "jpeg");
    viewer.images.set(timestamp, Buffer.from(field(image, 2)));
  });
  await new Promise((resolve, reject) => {
    client.on("serverInfo", resolve);
    client.on("error", reject);
  });
  assert.equal(socket.protocol, subprotocol);
  return viewer;
}

const viewers = [await view("foxglove.websocket.v1"), await view("foxglove.sdk.v1")];
const robot = new Program(orbbufd, set({ "robot.id": "r", "link.server": `127.0.0.1:${port}`, "source.frames": 100,
  "source.width": 320, "source.height": 180 }));
await robot.ended;
await server.line(/the robot ended the session/);
await server.stop();

const session = path.join(work, "data/r", readdirSync(path.join(work, "data/r"))[0]);
const written = new Map();
for (const line of readFileSync(path.join(session, "times.txt"), "utf8").trim().split("\n")) {
  const [sequence, seconds] = line.split(" ");
  written.set(BigInt(seconds.replace(".", "")), sequence.padStart(6, "0"));
}
for (const viewer of viewers) {
  assert.equal(viewer.topics.get("/r/image").schemaName, "foxglove.CompressedImage");
  assert.ok(viewer.topics.has("/r/drops") && viewer.topics.has("/r/status"));
  for (const [time, image] of viewer.images) {
    assert.ok(image.equals(readFileSync(path.join(session, "images", `${written.get(time)}.jpg`))), `at ${time}`);
  }
  // Its subscription may come after the first frames, no later.
  assert.ok(viewer.images.size > written.size / 2, `${viewer.images.size} of ${written.size} images`);
  console.log(`foxglove: ${viewer.images.size} of ${written.size} images, byte for byte`);
  viewer.close();
}
rmSync(work, { recursive: true });
