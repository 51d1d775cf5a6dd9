"use strict";

const kPollMs = 1000;
const kPatienceMs = 3000;
const kLongestPatienceMs = 60000;
const kTimelineSeconds = 120;
const $ = (id) => document.getElementById(id);
const main = $("main");

// Everything that comes from robots goes through textContent or encodeURIComponent.
const field = (root, name) => root.querySelector(`[data-name="${name}"]`);
const put = (root, name, text, value) => {
  const at = field(root, name);
  if (at.textContent !== text) at.textContent = text;
  if (value !== undefined) at.dataset.value = value;
  return at;
};
const clone = (id) => $(id).content.firstElementChild.cloneNode(true);
const element = (tag, text) => {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  return made;
};
const path = (...parts) => "/" + parts.map(encodeURIComponent).join("/");

const rate = (bytes) =>
  bytes >= 1e6 ? `${(bytes / 1e6).toFixed(1)} MB/s` : `${(bytes / 1e3).toFixed(bytes < 1e4 ? 1 : 0)} kB/s`;
const duration = (seconds) => {
  if (seconds < 0.9995) return `${Math.max(0, Math.round(seconds * 1000))} ms`;
  if (seconds < 100) return `${seconds.toFixed(1)} s`;
  if (seconds < 6000) return `${Math.round(seconds / 60)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
};

// A canvas as sharp as the screen: its context, and its size in CSS pixels.
function paper(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.font = "11px system-ui, sans-serif";
  return { context, width, height };
}

// bins: [{ at, delivered, dropped, similarity }], `at` from 0 to 1 exclusive, each 1 / count wide.
// outages: [[from, to]] on the same scale. marks: [[at, text]] below. The dots are bin.similarity, in units, the scale
// at least so many.
function draw(canvas, { bins, count, outages = [], marks = [], unit = "matches", least = 100 }) {
  const { context, width, height } = paper(canvas);
  const colours = getComputedStyle(document.documentElement);
  const colour = (name) => colours.getPropertyValue(name);
  const bottom = height - (marks.length > 0 ? 15 : 1);
  const similar = bins.filter((bin) => bin.similarity >= 0);
  const above = similar.length > 0 ? 0.45 : 0.12; // of the height: for the similarity
  const top = above * bottom;
  context.fillStyle = colour("--outage");
  for (const [from, to] of outages) {
    const left = Math.max(0, from) * width;
    context.fillRect(left, 0, Math.max(2, Math.min(1, to) * width - left), bottom);
  }
  const most = Math.max(1, ...bins.map((bin) => bin.delivered + bin.dropped));
  const step = width / count, bar = Math.max(1, step - (step > 2.5 ? 1 : 0));
  const scale = (bottom - top) / most;
  for (const bin of bins) {
    const x = bin.at * width;
    context.fillStyle = colour("--delivered");
    context.fillRect(x, bottom - bin.delivered * scale, bar, bin.delivered * scale);
    context.fillStyle = colour("--dropped");
    context.fillRect(x, bottom - (bin.delivered + bin.dropped) * scale, bar, bin.dropped * scale);
  }
  const largest = Math.max(least, ...similar.map((bin) => bin.similarity));
  for (const bin of similar) {
    const x = bin.at * width + bar / 2, y = top - 4 - (bin.similarity / largest) * (top - 9);
    context.beginPath();
    context.arc(x, y, 3.4, 0, 7);
    context.fillStyle = colour("--card");
    context.fill();
    context.beginPath();
    context.arc(x, y, 2.4, 0, 7);
    context.fillStyle = colour("--similarity");
    context.fill();
  }
  context.fillStyle = colour("--line");
  context.fillRect(0, bottom, width, 1);
  context.fillStyle = colour("--muted");
  for (const [at, text] of marks) {
    context.textAlign = at < 0.02 ? "left" : at > 0.98 ? "right" : "center";
    context.fillText(text, at * width, height - 3);
  }
  if (similar.length > 0) {
    context.textAlign = "left";
    context.fillText(`${largest} ${unit}`, 2, 11);
  }
}

/* The live page */

// What came of each second: { delivered, dropped, similarity, delay } by the second, of the last two minutes.
function remember(seconds, news, end) {
  for (const [second, delivered, dropped, similarity, delay] of news) {
    seconds.set(second, { delivered, dropped, similarity, delay });
  }
  for (const second of seconds.keys()) {
    if (second < end - kTimelineSeconds - 1 || second > end + kTimelineSeconds) seconds.delete(second);
  }
}

const total = (bins, name) => bins.reduce((sum, bin) => sum + bin[name], 0);
const largestOf = (bins, name) => bins.reduce((most, bin) => Math.max(most, bin[name]), 0);

class Card {
  constructor(robot) {
    this.root = clone("robot");
    this.root.dataset.robot = robot;
    this.canvas = this.root.querySelector("canvas");
    this.image = this.root.querySelector("img");
    this.robot = robot;
    this.session = null;
    this.seconds = new Map();
    this.streams = new Map(); // of samples: { text, canvas, seconds } by name
    this.isVisible = false;
    this.isLoading = false;
    this.shown = -1;
    this.image.alt = `newest frame of ${robot}`;
    this.image.onload = () => this.loaded(true);
    this.image.onerror = () => this.loaded(false);
    put(this.root, "robot", robot);
  }

  show(now) {
    this.stats = now;
    if (now.session !== this.session) {
      this.session = now.session;
      this.seconds.clear();
      this.streams.clear();
      this.root.querySelector(".streams").replaceChildren();
      const link = put(this.root, "session", now.session);
      link.href = path("sessions", this.robot, now.session);
    }
    remember(this.seconds, now.seconds, now.now);
    this.showStats(now);
    for (const stream of now.streams ?? []) this.showStream(stream, now);
    this.redraw();
    this.refresh();
  }

  showStats(now) {
    const isOn = now.state === "connected";
    const age = now.age_s;
    const isLate = isOn && age > 1.5;
    const state = put(this.root, "state", isLate ? "connected, late" : now.state, now.state);
    state.className = `badge ${isLate ? "disconnected" : now.state}`;
    put(this.root, "frame_rate", now.frame_rate.toFixed(1), now.frame_rate);
    const isKnown = age !== undefined && now.state !== "ended";
    put(this.root, "age", isKnown ? duration(age) : "–").classList.toggle("bad", isLate || now.state === "disconnected");
    const report = now.report;
    put(this.root, "link_rate", report && isOn ? rate(report.link_rate) : "–");
    put(this.root, "round_trip", report && isOn && report.round_trip_us > 0 ? duration(report.round_trip_us / 1e6) : "–");
    for (const name of ["captured", "acknowledged", "dropped", "skipped", "failed", "in_flight"]) {
      put(this.root, name, report ? report[name].toLocaleString("en") : "–", report ? report[name] : "");
    }
    for (const name of ["late", "on_robot", "quality", "reduced"]) {
      put(this.root, name, now[name]?.toLocaleString("en") ?? "–", now[name] ?? "");
    }
    const bar = this.root.querySelector(".bar");
    const share = report && report.capacity > 0 ? Math.min(1, report.waiting / report.capacity) : 0;
    bar.firstElementChild.style.width = `${100 * share}%`;
    bar.classList.toggle("full", share >= 0.9);
    put(this.root, "buffer", report ? `${report.waiting} of ${report.capacity}` : "–", report ? report.waiting : "");
  }

  showStream(now, { now: end, state }) {
    let stream = this.streams.get(now.name);
    if (!stream) {
      stream = { text: element("p"), canvas: element("canvas"), seconds: new Map() };
      stream.canvas.role = "img";
      this.streams.set(now.name, stream);
      this.root.querySelector(".streams").append(stream.text, stream.canvas);
    }
    remember(stream.seconds, now.seconds, end);
    const gap = duration(largestOf([...stream.seconds.values()], "delay") / 1000);
    const isOver = state === "ended" || now.age_s === undefined;
    stream.text.textContent = `${now.name}: ${now.rate.toFixed(1)}/s, longest gap ${gap}, ` +
      `newest ${isOver ? "–" : duration(now.age_s)}, ${now.waiting} wait, ${now.lost} lost`;
    stream.text.classList.toggle("bad", !isOver && now.age_s > 1.5);
  }

  redraw() {
    if (!this.isVisible || !this.stats) return;
    const end = this.stats.now, begin = end - kTimelineSeconds;
    const binsOf = (seconds) =>
      [...seconds].map(([second, bin]) => ({ at: (second - begin) / kTimelineSeconds, ...bin }));
    const bins = binsOf(this.seconds);
    const outages = this.stats.outages
      .map(([from, to]) => [(from - begin) / kTimelineSeconds, ((to ?? end) - begin) / kTimelineSeconds])
      .filter(([, to]) => to > 0);
    this.canvas.ariaLabel = `last two minutes: ${total(bins, "delivered")} delivered, ` +
      `${total(bins, "dropped")} dropped, ${outages.length} outages`;
    draw(this.canvas, { bins, count: kTimelineSeconds, outages, marks: [[0, "–2 min"], [0.5, "–1 min"], [1, "now"]] });
    for (const [name, { canvas, seconds }] of this.streams) {
      const samples = binsOf(seconds);
      canvas.ariaLabel = `${name}, last two minutes: ${total(samples, "delivered")} samples, ` +
        `${total(samples, "dropped")} lost, turns of up to ${largestOf(samples, "similarity")} °/s`;
      draw(canvas, { bins: samples, count: kTimelineSeconds, unit: "°/s", least: 10 });
    }
  }

  // One request at a time; a few pictures a second where few are in sight.
  refresh() {
    const newest = this.stats.image;
    if (!newest || !this.isVisible || this.isLoading || document.hidden) return;
    if (newest.sequence === this.shown && this.stats.state !== "connected") return;
    this.isLoading = true;
    this.shown = newest.sequence;
    this.image.src = `${path("robots", this.robot, "image")}?n=${Date.now()}`;
  }

  loaded(isGood) {
    this.isLoading = false;
    this.image.hidden = !isGood;
    const inSight = [...cards.values()].filter((card) => card.isVisible).length;
    if (isGood && inSight <= 4 && this.stats.state === "connected") setTimeout(() => this.refresh(), 100 * inSight);
  }
}

const cards = new Map();
const inSight = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const card = cards.get(entry.target.dataset.robot);
    if (!card) continue;
    card.isVisible = entry.isIntersecting;
    if (card.isVisible && card.stats) {
      card.redraw();
      card.refresh();
    }
  }
});

function showRobots(robots) {
  const known = new Set(robots.map((robot) => robot.robot));
  for (const [robot, card] of cards) {
    if (known.has(robot)) continue;
    inSight.unobserve(card.root);
    card.root.remove();
    cards.delete(robot);
  }
  for (const robot of robots) {
    let card = cards.get(robot.robot);
    if (!card) {
      card = new Card(robot.robot);
      cards.set(robot.robot, card);
      const after = [...cards.keys()].sort().find((id) => id > robot.robot);
      main.insertBefore(card.root, after ? cards.get(after)?.root ?? null : null);
      inSight.observe(card.root);
    }
    card.show(robot);
  }
  const hint = main.querySelector(".hint");
  if (robots.length > 0) {
    hint?.remove();
  } else if (!hint) {
    main.append(clone("empty"));
  }
  const connected = robots.filter((robot) => robot.state === "connected").length;
  summary(robots.length === 0 ? "no robot" : `${connected} of ${robots.length} robot${robots.length === 1 ? "" : "s"} connected`);
}

function summary(text, isBad = false) {
  $("summary").textContent = text;
  $("summary").classList.toggle("bad", isBad);
}

let clock = 0;
let answered = Date.now();
let patienceMs = kPatienceMs;
async function poll() {
  if (!document.hidden) {
    try {
      const signal = AbortSignal.timeout(patienceMs);
      const answer = await (await fetch(`/api/robots?since=${clock}`, { signal })).json();
      patienceMs = kPatienceMs;
      if (answer.clock_ms < clock) return location.reload(); // another server
      clock = answer.clock_ms;
      answered = Date.now();
      $("version").textContent = `orbbuf-server ${answer.version}`;
      showRobots(answer.robots);
    } catch {
      patienceMs = Math.min(2 * patienceMs, kLongestPatienceMs); // a long answer over a slow link
      summary(`the server has not answered for ${duration((Date.now() - answered) / 1000)}`, true);
    }
  }
  setTimeout(poll, kPollMs);
}

function redrawAll() {
  for (const card of cards.values()) card.redraw();
  again?.();
}
let again = null; // draws the session's picture again
window.addEventListener("resize", redrawAll);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);

/* What is on the disk */

function showList(title, names, link) {
  const card = element("article");
  card.className = "card wide";
  const head = element("div");
  head.className = "title";
  head.append(element("h2", title));
  const list = element("ul");
  list.className = "list";
  for (const name of names) {
    const item = element("li"), to = element("a", name);
    to.href = link(name);
    item.append(to);
    list.append(item);
  }
  card.append(head, list);
  main.append(card);
  summary(`${names.length}${names.length >= 1000 ? " or more" : ""}`);
}

// times.txt: SEQUENCE SECONDS EXPOSURE. drops.csv, once the session is over: sequence,reason,seconds.
function readRecord(times, drops) {
  const frames = [], lost = [];
  for (const line of times.split("\n")) {
    const [sequence, at] = line.split(" ");
    if (at !== undefined) frames.push({ sequence: Number(sequence), at: Number(at) });
  }
  for (const line of drops.split("\n").slice(1)) {
    const [sequence, reason, at] = line.split(",");
    if (at !== undefined) lost.push({ sequence: Number(sequence), reason, at: Number(at) });
  }
  return { frames, lost };
}

function clockTime(seconds) {
  return seconds > 1e8 ? new Date(seconds * 1000).toISOString().replace("T", " ").slice(0, 19) + " UTC"
    : `${seconds.toFixed(1)} s`;
}

function showSession(robot, session, files, { frames, lost }) {
  const card = clone("session");
  main.append(card);
  const all = [...frames, ...lost].map((frame) => frame.at);
  const begin = all.reduce((a, b) => Math.min(a, b), Infinity);
  const end = all.reduce((a, b) => Math.max(a, b), -Infinity);
  const span = Math.max(1e-9, end - begin);
  put(card, "title", `${robot} ${session}`);
  put(card, "span", all.length > 0 ? `${clockTime(begin)}, ${duration(end - begin)}` : "empty");
  put(card, "delivered", frames.length.toLocaleString("en"), frames.length);
  const dropped = files.drops === null ? files.dropped : lost.length;
  put(card, "dropped", dropped.toLocaleString("en"), dropped);
  put(card, "frame_rate", frames.length > 1 ? (frames.length / span).toFixed(1) : "–");
  let gap = 0;
  for (let i = 1; i < frames.length; ++i) gap = Math.max(gap, frames[i].at - frames[i - 1].at);
  put(card, "gap", duration(gap));
  const reasons = new Map();
  for (const { reason } of lost) reasons.set(reason, (reasons.get(reason) ?? 0) + 1);
  put(card, "reasons", [...reasons].map(([reason, count]) => `${reason}: ${count}`).join(", "));
  again = () => drawSession(card.querySelector("canvas"), { frames, lost, begin, span });
  again();
  for (const [name, bytes] of Object.entries({ "times.txt": files.times, "drops.csv": files.drops,
    "camera.txt": files.calibration })) {
    if (bytes === null) continue;
    const link = element("a", name);
    link.href = path("sessions", robot, session, name);
    field(card, "files").append(link);
  }
  seek(card, robot, session, frames, begin);
}

function drawSession(canvas, { frames, lost, begin, span }) {
  const count = Math.max(1, Math.min(Math.floor(canvas.clientWidth / 5), Math.ceil((frames.length + lost.length) / 10)));
  const bins = Array.from({ length: count }, (_, i) => ({ at: i / count, delivered: 0, dropped: 0, similarity: -1 }));
  const bin = (at) => bins[Math.max(0, Math.min(count - 1, Math.floor(((at - begin) / span) * count)))];
  for (const { at } of frames) ++bin(at).delivered;
  for (const { at } of lost) ++bin(at).dropped;
  canvas.ariaLabel = `${frames.length} delivered, ${lost.length} dropped`;
  draw(canvas, { bins, count, outages: [], marks: [[0, "0"], [0.5, duration(span / 2)], [1, duration(span)]] });
}

function seek(card, robot, session, frames, begin) {
  const slider = card.querySelector("input"), image = card.querySelector("img");
  if (frames.length === 0) {
    card.querySelector(".seek").hidden = card.querySelector(".picture").hidden = true;
    return;
  }
  slider.max = frames.length - 1;
  let isLoading = false, wanted = -1;
  const show = () => {
    const frame = frames[Number(slider.value)];
    put(card, "frame", `frame ${frame.sequence}, at ${(frame.at - begin).toFixed(3)} s`);
    if (isLoading) return;
    isLoading = true;
    wanted = slider.value;
    image.alt = `frame ${frame.sequence}`;
    image.src = path("sessions", robot, session, "images", `${String(frame.sequence).padStart(6, "0")}.jpg`);
  };
  image.onload = image.onerror = (event) => {
    isLoading = false;
    image.hidden = event.type === "error";
    if (slider.value !== wanted) show();
  };
  slider.addEventListener("input", show);
  show();
}

const text = async (url) => {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url}: ${answer.status}`);
  return answer.text();
};

async function sessions(robot, session) {
  try {
    if (session !== undefined) {
      const files = JSON.parse(await text(path("api", "sessions", robot, session)));
      const read = (name, bytes) => (bytes ? text(path("sessions", robot, session, name)) : "");
      const [times, drops] = await Promise.all([read("times.txt", files.times), read("drops.csv", files.drops)]);
      summary("");
      return showSession(robot, session, files, readRecord(times, drops));
    }
    const parts = robot === undefined ? [] : [robot];
    const { names } = JSON.parse(await text(path("api", "sessions", ...parts)));
    showList(robot === undefined ? "Robots" : `Sessions of ${robot}`, names, (name) => path("sessions", ...parts, name));
  } catch (error) {
    summary(String(error.message ?? error), true);
  }
}

const [first, ...rest] = location.pathname.split("/").filter(Boolean).map(decodeURIComponent);
const isLive = first !== "sessions";
document.querySelector(`[data-nav="${isLive ? "live" : first}"]`).setAttribute("aria-current", "page");
$("legend").hidden = !isLive && rest.length < 2;
for (const only of document.querySelectorAll("[data-live]")) only.hidden = !isLive;
if (isLive) {
  poll();
} else {
  sessions(...rest);
}
