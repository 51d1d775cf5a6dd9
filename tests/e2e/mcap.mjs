// SPDX-License-Identifier: Apache-2.0
// Compares the parts of a session's MCAP recording, as the format's own library reads them from front to back and by
// their indexes, with the files beside them:
//   node mcap.mjs whole|killed SESSION CALIBRATED
// whole: they have all messages. killed: those of the first frames.
import assert from "node:assert/strict";
import { readFile, readdir } from "node:fs/promises";
import { createRequire } from "node:module";
import { join } from "node:path";

const require = createRequire(join(process.cwd(), "package.json"));  // where npm has put them
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const protobuf = require("protobufjs");
const { FileDescriptorSet } = require("protobufjs/ext/descriptor");

const [mode, session, calibrated] = process.argv.slice(2);
const nanoseconds = (text) => BigInt(text.replace(".", ""));  // they have nine digits behind it

async function lines(name) {
  const text = await readFile(join(session, name), "utf8").catch(() => "");
  return text.split("\n").filter((line) => line !== "");
}

/// What the session's files say, in the form of decoded() below.
async function recorded() {
  const frames = (await lines("times.txt")).map((line) => line.split(" "));
  const drops = (await lines("drops.csv")).slice(1).map((line) => line.split(","));
  return {
    frames: frames.map(([sequence, time]) =>
      ({ sequence: Number(sequence), time: nanoseconds(time) })),
    drops: drops.map(([sequence, reason, time]) =>
      ({ sequence: Number(sequence), reason, time: nanoseconds(time) })),
    qualities: (await lines("quality.csv")).slice(1).map((line) => line.split(","))
      .map(([sequence, quality, bytes, crc]) =>
        [Number(sequence), Number(quality), Number(bytes), parseInt(crc, 16)]),
    isStereo: (await readdir(session)).includes("images_right"),
  };
}

function stream(data) {
  const reader = new McapStreamReader({ validateCrcs: true });
  reader.append(data);
  const schemas = new Map();
  const channels = new Map();
  const messages = [];
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type === "Message") messages.push(record);
  }
  return { schemas, channels, messages, isDone: reader.done() };
}

async function indexed(data) {
  const readable = {
    size: async () => BigInt(data.length),
    read: async (at, count) => data.subarray(Number(at), Number(at + count)),
  };
  const reader = await McapIndexedReader.Initialize({ readable });
  const messages = [];
  let previous = 0n;
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    assert(message.logTime >= previous, "in the order of time");
    previous = message.logTime;
    messages.push(message);
  }
  assert.equal(reader.statistics.messageCount, BigInt(messages.length));
  assert.equal(reader.statistics.chunkCount, reader.chunkIndexes.length);
  for (const [id, count] of reader.statistics.channelMessageCounts) {
    assert.equal(count, BigInt(messages.filter((message) => message.channelId === id).length));
  }
  return { schemas: reader.schemasById, channels: reader.channelsById, messages };
}

const types = new Map();

function decode(schema, data) {
  if (schema.encoding === "jsonschema") {
    JSON.parse(Buffer.from(schema.data).toString());
    return JSON.parse(Buffer.from(data).toString());
  }
  assert.equal(schema.encoding, "protobuf");
  if (!types.has(schema.id)) {
    const root = protobuf.Root.fromDescriptor(FileDescriptorSet.decode(schema.data));
    types.set(schema.id, root.lookupType(schema.name));
  }
  return types.get(schema.id).toObject(types.get(schema.id).decode(data), { longs: Number });
}

const time_of = ({ seconds, nanos }) => BigInt(seconds ?? 0) * 1000000000n + BigInt(nanos ?? 0);

/// By topic without the robot: the messages in the order of their numbers, which are unique.
function decoded({ schemas, channels, messages }) {
  const topics = {};
  for (const message of messages) {
    const channel = channels.get(message.channelId);
    const schema = schemas.get(channel.schemaId);
    assert.equal(message.publishTime, message.logTime);
    const topic = channel.topic.split("/").slice(2).join("/");
    const list = (topics[topic] ??= []);
    list.push({ number: message.sequence, time: message.logTime, schema: schema.name,
                value: decode(schema, message.data) });
  }
  for (const [topic, list] of Object.entries(topics)) {
    list.sort((a, b) => a.number - b.number);
    list.forEach(({ number }, i) =>
      assert(i === 0 || list[i - 1].number < number, `${topic}: ${number} twice`));
  }
  return topics;
}

async function check_images(list, frames, folder) {
  assert.deepEqual(list.map(({ number }) => number), frames.map(({ sequence }) => sequence));
  for (const [i, { number, time, schema, value }] of list.entries()) {
    assert.equal(schema, "foxglove.CompressedImage");
    assert.equal(value.format, "jpeg");
    assert.equal(time, frames[i].time);
    assert.equal(time_of(value.timestamp), time);
    const file = join(session, folder, `${String(number).padStart(6, "0")}.jpg`);
    assert(Buffer.from(value.data).equals(await readFile(file)), `${file} differs`);
  }
}

function check_calibrations(list, frames, tx) {
  assert.deepEqual(list.map(({ number, time }) => [number, time]),
                   frames.map(({ sequence, time }) => [sequence, time]));
  for (const { schema, time, value } of list) {
    assert.equal(schema, "foxglove.CameraCalibration");
    assert.equal(time_of(value.timestamp), time);
    const model = value.distortionModel ?? value.distortion_model;
    assert.deepEqual([value.width, value.height, model], [160, 120, "plumb_bob"]);
    assert.deepEqual(value.K, [100, 0, 80, 0, 101, 60, 0, 0, 1]);
    assert.deepEqual(value.P, [100, 0, 80, tx, 0, 101, 60, 0, 0, 0, 1, 0]);
    assert.deepEqual(value.D, [-0.1, 0.01, 0.001, -0.001, 0]);
  }
}

/// What the parts must have: after a kill they have the first ones.
function expected_of(list, all) {
  return mode === "killed" ? all.slice(0, list.length) : all;
}

/// Parts as one: the ids of schemas and channels are the same in all.
function joined(contents) {
  return {
    schemas: new Map(contents.flatMap(({ schemas }) => [...schemas])),
    channels: new Map(contents.flatMap(({ channels }) => [...channels])),
    messages: contents.flatMap(({ messages }) => messages),
  };
}

async function check(contents, expected) {
  const topics = decoded(contents);
  const { frames, drops, qualities, isStereo } = expected;
  const sides = isStereo ? [["left/", "images", 0], ["right/", "images_right", -10]]
                         : [["", "images", 0]];
  const kinds = calibrated === "yes" ? ["image", "calibration"] : ["image"];
  const names = sides.flatMap(([side]) => kinds.map((kind) => side + kind));
  if (topics.drops) names.push("drops");
  if (topics.quality || (mode === "whole" && qualities.length > 0)) names.push("quality");
  if (mode === "whole" || contents.messages.length > 0) {
    assert.deepEqual(Object.keys(topics).sort(), names.sort());
  }
  for (const [side, folder, tx] of sides) {
    const images = topics[`${side}image`] ?? [];
    await check_images(images, expected_of(images, frames), folder);
    if (calibrated !== "yes") continue;
    const calibrations = topics[`${side}calibration`] ?? [];
    check_calibrations(calibrations, expected_of(calibrations, frames), tx);
  }
  const told = (topics.quality ?? []).map(({ number, value }) =>
    [number, value.quality ?? 0, value.whole_bytes ?? 0, value.whole_crc ?? 0]);
  assert.deepEqual(told, expected_of(told, qualities));
  const dropped = (topics.drops ?? []).map(({ time, value }) => {
    assert.equal(BigInt(value.timestamp.sec) * 1000000000n + BigInt(value.timestamp.nsec), time);
    return { sequence: value.sequence, reason: value.reason, time };
  });
  const named = new Set(dropped.map(({ sequence }) => sequence));
  assert.deepEqual(dropped, mode === "killed" ? drops.filter(({ sequence }) => named.has(sequence)) : drops);
  return contents.messages.length;
}

const names = (await readdir(session)).filter((file) => file.endsWith(".mcap")).sort();
const parts = await Promise.all(names.map((name) => readFile(join(session, name))));
const expected = await recorded();
const streamed = parts.map(stream);
assert(streamed.every(({ isDone }) => isDone));
const count = await check(joined(streamed), expected);
assert.equal(await check(joined(await Promise.all(parts.map(indexed))), expected), count);
const { frames, drops } = expected;
console.log(`mcap ${mode}: ${names.length} parts, ${count} messages, ${frames.length} frames, ${drops.length} drops`);
