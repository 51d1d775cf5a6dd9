// SPDX-License-Identifier: Apache-2.0
// Compares a session's MCAP file, as the format's own library reads it, with the files beside it:
//   node mcap.mjs whole|killed SESSION CALIBRATED
// whole: finished; read from front to back and by its index, both with all messages.
// killed: without an end; all chunks, of which the last may hold one frame more than the files.
import assert from "node:assert/strict";
import { readFile, readdir } from "node:fs/promises";
import { createRequire } from "node:module";
import { join } from "node:path";

const require = createRequire(join(process.cwd(), "package.json"));  // where npm has put them
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const protobuf = require("protobufjs");
const { FileDescriptorSet } = require("protobufjs/ext/descriptor");

const [mode, session, calibrated] = process.argv.slice(2);
const kKills = 5;  // as many as mcap.sh makes
const nanoseconds = (text) => BigInt(text.replace(".", ""));  // they have nine digits behind it

async function lines(name) {
  const text = await readFile(join(session, name), "utf8").catch(() => "");
  return text.split("\n").filter((line) => line !== "");
}

/// What the session's files say, in the form of decoded() below.
async function recorded() {
  const frames = (await lines("times.txt")).map((line) => line.split(" "));
  const drops = (await lines("drops.csv")).slice(1).map((line) => line.split(","));
  const taken = new Set(frames.map(([sequence]) => Number(sequence)));
  // Of two lines for one frame the last counts; those of late frames stand behind the others.
  const qualities = [...new Map((await lines("quality.csv")).slice(1).map((line) => line.split(","))
    .map(([sequence, quality, bytes, crc]) => [Number(sequence),
      [Number(sequence), Number(quality), Number(bytes), parseInt(crc, 16)]])).values()]
    .sort(([a], [b]) => a - b);
  // A kill between the two lists leaves the line of a frame that was not taken, and that the robot may pass over
  // afterwards: at most one of each kill, and the next start removes its image.
  const images = new Set(await readdir(join(session, "images")));
  const left_over = qualities.filter(([sequence]) => !taken.has(sequence));
  assert(left_over.length <= kKills);
  if (mode === "whole") {
    assert(left_over.every(([sequence]) => !images.has(`${String(sequence).padStart(6, "0")}.jpg`)));
  }
  return {
    frames: frames.map(([sequence, time]) =>
      ({ sequence: Number(sequence), time: nanoseconds(time) })),
    drops: drops.map(([sequence, reason, time]) =>
      ({ sequence: Number(sequence), reason, time: nanoseconds(time) })),
    qualities: qualities.filter(([sequence]) => taken.has(sequence)),
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

/// The one that the files may lack after a kill: it is written before them.
function without_last(list, expected) {
  return mode === "killed" && list.length === expected.length + 1 ? list.slice(0, -1) : list;
}

async function check(contents, expected) {
  const topics = decoded(contents);
  const { frames, drops, qualities, isStereo } = expected;
  const sides = isStereo ? [["left/", "images", 0], ["right/", "images_right", -10]]
                         : [["", "images", 0]];
  const kinds = calibrated === "yes" ? ["image", "calibration"] : ["image"];
  const names = sides.flatMap(([side]) => kinds.map((kind) => side + kind));
  if (topics.drops) names.push("drops");
  if (qualities.length > 0) names.push("quality");
  assert.deepEqual(Object.keys(topics).sort(), names.sort());
  for (const [side, folder, tx] of sides) {
    await check_images(without_last(topics[`${side}image`], frames), frames, folder);
    if (calibrated !== "yes") continue;
    check_calibrations(without_last(topics[`${side}calibration`], frames), frames, tx);
  }
  const told = (topics.quality ?? []).map(({ number, value }) =>
    [number, value.quality ?? 0, value.whole_bytes ?? 0, value.whole_crc ?? 0]);
  assert.deepEqual(without_last(told, qualities), qualities);
  const late = new Set(drops.filter(({ reason }) => reason === "late").map(({ sequence }) => sequence));
  const dropped = (topics.drops ?? []).map(({ time, value }) => {
    assert.equal(BigInt(value.timestamp.sec) * 1000000000n + BigInt(value.timestamp.nsec), time);
    // The files say of a frame that arrived late that it did, the recording why it did not come live.
    const isLate = late.has(value.sequence) && value.reason !== "late";
    return { sequence: value.sequence, reason: isLate ? "late" : value.reason, time };
  });
  assert.deepEqual(mode === "killed" ? dropped.slice(0, drops.length) : dropped, drops);
  return contents.messages.length;
}

const [name] = (await readdir(session)).filter((file) => file.endsWith(".mcap"));
const data = await readFile(join(session, name));
const expected = await recorded();
const streamed = stream(data);
const count = await check(streamed, expected);
if (mode === "whole") {
  assert(streamed.isDone);
  assert.equal(await check(await indexed(data), expected), count);
} else {
  assert(!streamed.isDone);
}
const { frames, drops } = expected;
console.log(`mcap ${mode}: ${count} messages, ${frames.length} frames, ${drops.length} drops`);
