// SPDX-License-Identifier: Apache-2.0
// node page_test.mjs ORBBUFD ORBBUF_SERVER FOLDER: see page.sh.
import assert from "node:assert/strict";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import net from "node:net";
import { tmpdir } from "node:os";
import path from "node:path";
import { chromium } from "playwright-core";
import { Program, set, sleep } from "./program.mjs";

const [orbbufd, orbbufServer, folder] = process.argv.slice(2);
const work = mkdtempSync(path.join(tmpdir(), "orbbuf-page-"));

/** The link: a relay that can be cut off for a while. */
class Link {
  constructor(port) {
    this.port = port;
    this.sockets = new Set();
  }
  async open(at = this.at ?? 0) {
    this.server = net.createServer((robot) => {
      const server = net.connect(this.port, "127.0.0.1");
      for (const socket of [robot, server]) {
        this.sockets.add(socket);
        socket.on("error", () => {}).on("close", () => (robot.destroy(), server.destroy()));
      }
      robot.pipe(server).pipe(robot);
    });
    await new Promise((resolve) => this.server.listen(at, "127.0.0.1", resolve));
    this.at = this.server.address().port;
  }
  cut() {
    this.server.close();
    for (const socket of this.sockets) socket.destroy();
    this.sockets.clear();
  }
}

const server = new Program(orbbufServer, set({ "listen.address": "127.0.0.1:0", "http.address": "127.0.0.1:0",
  "files.path": `${work}/data` }));
const origin = (await server.line(/live page on (http:\S+)\//))[1];
const link = new Link(Number((await server.line(/ listening on \S+:(\d+)/))[1]));
await link.open();

const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu",
  "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync"] });
const problems = [];
const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, colorScheme: "light" });
const page = await context.newPage();
page.on("console", (message) => message.type() === "error" && problems.push(message.text()));
page.on("pageerror", (error) => problems.push(String(error)));
page.on("request", (request) => {
  if (!request.url().startsWith(origin) && !request.url().startsWith("data:")) problems.push(`asks ${request.url()}`);
});

async function picture(name, scheme, width, height = 900) {
  await page.emulateMedia({ colorScheme: scheme });
  await page.setViewportSize({ width, height });
  await sleep(300);
  await page.screenshot({ path: path.join(folder, `${name}.png`), fullPage: true });
  const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  assert.ok(over <= 0, `${name}: ${over} px wider than the screen`);
}

async function pictures(name) {
  await picture(`${name}-phone`, "light", 360, 740);
  await picture(name, "light", 1280);
}

const value = async (name) =>
  Number(await page.locator(`article[data-robot="front"] [data-name="${name}"]`).getAttribute("data-value"));

async function load() {
  const bytes = (await (await fetch(`${origin}/`)).arrayBuffer()).byteLength;
  const times = [];
  for (let i = 0; i < 5; ++i) {
    await page.goto(`${origin}/`, { waitUntil: "load" });
    times.push(await page.evaluate(() => performance.getEntriesByType("navigation")[0].loadEventEnd));
  }
  console.log(`RESULT page.bytes ${bytes}`);
  console.log(`RESULT page.load_ms ${times.sort((a, b) => a - b)[2].toFixed(0)}`);
  assert.ok(bytes < 150_000, `${bytes} bytes`);
}

/** A server that stands still is not shown as if it went on. */
async function freeze() {
  await page.waitForSelector("#summary:not(.bad)");
  server.process.kill("SIGSTOP");
  await page.waitForSelector('#summary.bad:has-text("has not answered for")');
  server.process.kill("SIGCONT");
  await page.waitForSelector("#summary:not(.bad)");
}

/** The newest image is there, and another one a moment later. */
async function watch() {
  const image = page.locator('article[data-robot="front"] img');
  await image.waitFor({ state: "visible" });
  const size = await image.evaluate((at) => [at.naturalWidth, at.naturalHeight]);
  assert.deepEqual(size, [640, 480]);
  const first = await image.getAttribute("src");
  await page.waitForFunction((src) => document.querySelector("img").getAttribute("src") !== src, first);
}

/** 200 a second from now on, but for 150 ms; for a second of them the sensor turns at 86 degrees per second. */
function writeSamples(file) {
  const begin = BigInt(Date.now()) * 1000000n;
  const lines = [];
  for (let ms = 0; ms < 300000; ms += 5) {
    if (ms > 3000 && ms < 3155) continue;
    lines.push(`${begin + BigInt(ms) * 1000000n},0,0,${ms >= 2000 && ms < 3000 ? 1.5 : 0.01},0,0,9.81\n`);
  }
  writeFileSync(file, lines.join(""));
}

/** Each sensor has a line, and a picture that is drawn. */
async function samplesAreShown() {
  const sensor = page.locator('article[data-robot="front"] .streams');
  await sensor.locator("p").filter({ hasText:
    /^imu0: (19|20)\d\.\d\/s, longest gap 155 ms, newest \d+ ms, \d+ wait, 0 lost$/ }).waitFor();
  const canvas = sensor.locator("canvas");
  assert.match(await canvas.getAttribute("aria-label"),
    /^imu0, last two minutes: [1-9]\d+ samples, 0 lost, turns of up to 86 °\/s$/);
  const drawn = await canvas.evaluate((at) =>
    at.getContext("2d").getImageData(0, 0, at.width, at.height).data.filter((byte, i) => i % 4 === 3 && byte > 0).length);
  assert.ok(drawn > 200, `${drawn} pixels`);
  assert.equal(await page.locator('article[data-robot="rear"] .streams').textContent(), "");
}

/** Whoever has no robot yet is told how to add one. */
async function empty() {
  const hint = page.locator(".hint");
  await hint.waitFor();
  assert.match(await hint.innerText(), /sudo orbbuf-server add-robot NAME[^]*sudo orbbufd setup NAME.tar/);
  assert.equal(await page.locator(".key").first().isVisible(), false);
  await pictures("empty");
}

async function stream() {
  const samples = `${work}/imu.csv`;
  writeSamples(samples);
  const robots = ["front", "rear"].map((id) => new Program(orbbufd, set({ "robot.id": id,
    "link.server": `127.0.0.1:${link.at}`, "buffer.policy": "uniform", "buffer.capacity": 15,
    "source.frames": 100000, ...(id === "front" && { "stream.imu0.kind": "euroc", "stream.imu0.path": samples }) })));
  await page.waitForSelector('article[data-robot="front"] .badge.connected');
  assert.equal(await page.locator(".hint").count(), 0);
  await watch();
  await pictures("live");
  await sleep(5000);
  await samplesAreShown();
  link.cut();
  await page.waitForSelector('article[data-robot="front"] .badge.disconnected');
  await sleep(3000);
  await pictures("outage");
  await link.open();
  await page.waitForSelector('article[data-robot="front"] .badge.connected');
  await sleep(4000);
  await samplesAreShown(); // those of the outage came, too
  await pictures("after");
  await picture("after-dark", "dark", 1280);
  await picture("after-phone-dark", "dark", 360, 740);
  const label = await page.locator('article[data-robot="front"] > canvas').getAttribute("aria-label");
  assert.match(label, /, [1-9]\d* dropped, [1-9]\d* outages/);
  for (const robot of robots) await robot.stop();
  return robots[0];
}

/** Page, /metrics and the robot's last line tell the same. */
async function compare(robot) {
  await page.waitForSelector('article[data-robot="front"] [data-name="state"][data-value="ended"]');
  const words = (await robot.line(/session ended: (.*)/))[1];
  const metrics = await (await fetch(`${origin}/metrics`)).text();
  const names = { captured: "robot_captured_total", skipped: "robot_skipped_total", failed: "robot_failed_total",
    dropped: "robot_dropped_total", acknowledged: "robot_acknowledged_total", in_flight: "robot_in_flight_frames" };
  for (const [name, metric] of Object.entries(names)) {
    const logged = Number(words.match(new RegExp(`${name.replace("_", " ")} (\\d+)`))[1]);
    assert.equal(await value(name), logged, `page: ${name}`);
    assert.equal(Number(metrics.match(new RegExp(`orbbuf_${metric}\\{robot="front"\\} (\\d+)`))[1]), logged, metric);
  }
  await pictures("ended");
  assert.equal(await value("buffer"), 0);
  assert.ok((await value("dropped")) > 0, "nothing was dropped in the outage");
  console.log(`page, /metrics and the robot's log agree: ${words}`);
}

async function sessionPages() {
  for (const at of ["/sessions", "/sessions/front"]) {
    await page.goto(origin + at);
    await page.click('.list a:has-text("2"), .list a:has-text("front")');
  }
  await page.waitForSelector(".wide img:not([hidden])");
  const delivered = Number(await page.locator('[data-name="delivered"]').getAttribute("data-value"));
  await page.locator("input[type=range]").fill(String(delivered - 1));
  await page.waitForFunction(() => document.querySelector(".wide img").complete);
  await picture("session", "light", 1280);
  await picture("session-phone-dark", "dark", 360, 740);
  return delivered;
}

try {
  await load();
  await freeze();
  await empty();
  const robot = await stream();
  await compare(robot);
  const delivered = await value("acknowledged");
  assert.equal(await sessionPages(), delivered);
  assert.deepEqual(problems, []);
  console.log(`page: passed; pictures in ${folder}`);
} finally {
  await browser.close();
  await server.stop();
  link.cut();
  rmSync(work, { recursive: true });
}
