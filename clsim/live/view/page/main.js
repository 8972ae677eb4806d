// Joins the stream, the pictures and the controls.

import { Cloud } from "./cloud.js";
import { CAUSE_LEVELS, EventImage } from "./image.js";
import { Rate } from "./rate.js";
import { Store } from "./store.js";
import { percent, seconds, short, span } from "./text.js";

const HEADER_BYTES = 32;
const EVENTS = 1, SEEK = 4, CAUSED = 8;
const KINDS = { cause: "causes", filter: "filters" }; // maps of kinds of events, and what the server tells of them
const IMAGES = { 2: "noisy", 3: "denoised", 5: "depth", 6: "flow", 7: "ids" };
const RATE_OVER_US = 50_000;
const SKIPPED = "Events that this browser was too slow to draw; files and streams have them all";

const $ = (id) => document.getElementById(id);
const store = new Store();
const image = new EventImage($("image"));
const cloud = new Cloud($("cloud"), { now: $("axis-now"), past: $("axis-past"), x: $("axis-x"), y: $("axis-y") }, () => { dirty = true; });
const rate = new Rate($("rate").parentElement, $("rate"), $("rate-tip"), seek);
$("no-webgl").hidden = cloud.gl !== null;

const saved = JSON.parse(localStorage.getItem("clsim") || "{}");
const settings = { windowUs: 30_000, depthUs: 300_000, full: 3, decay: false, colours: "blue-orange", theme: null, ...saved };
let hello = null, status = {}, tables = {}, look = null, socket = null;
let dirty = true, paused = false, heldUs = null, received = 0, confirmed = 0, shown = 0, ended = false;

const now = () => heldUs ?? store.nowUs;
const send = (message) => { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

// ---- the stream ----------------------------------------------------------------------------------------------------

function connect() {
  socket = new WebSocket(`ws://${location.host}/stream`);
  socket.binaryType = "arraybuffer";
  received = confirmed = 0;
  socket.onopen = () => { ended = false; tellVisibility(); };
  socket.onclose = () => {
    setState(ended ? "ended" : "no connection", ended ? "" : "bad");
    setTimeout(connect, 1000);
  };
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") takeText(JSON.parse(data));
    else {
      takePacket(data);
      received++;
      // Confirmed only once a picture was made of it: a browser that is too slow is sent less, not more.
      if (!document.hidden) requestAnimationFrame(confirm); else confirm();
    }
  };
}

function confirm() {
  if (confirmed === received) return;
  confirmed = received;
  send({ seen: received });
}

function takeText(message) {
  if (message.type === "hello") {
    if (hello && JSON.stringify(hello) !== JSON.stringify(message)) { location.reload(); return; }
    if (!hello && message.colours) settings.colours = message.colours;
    hello = message;
    offerColours();
    image.resize(message.width, message.height);
    cloud.resize(message.width, message.height);
    store.clear(0);
    rate.clear();
    shown = 0;
    $("title").textContent = `${message.title} · ${message.width} × ${message.height}`;
    document.title = `${message.title} · clsim`;
    document.body.classList.toggle("live", message.live);
    $("noisy-caption").textContent = message.frames;
    setState(message.live ? "live" : "recording", "on");
    fit();
  } else if (message.type === "status") {
    status = message;
    if (message.error) setState(message.error, "bad");
    if (!hello?.live) {
      paused = !message.playing;
      $("loop").checked = message.loop;
      $("speed").value = String(message.speed);
    }
  } else if (message.type === "overview") {
    rate.overview(message);
  } else if (message.type === "end") {
    ended = true;
  }
  dirty = true;
}

function takePacket(buffer) {
  const header = new DataView(buffer, 0, HEADER_BYTES);
  const kind = header.getUint32(0, true), count = header.getUint32(4, true);
  const baseUs = Number(header.getBigInt64(8, true)), nowUs = Number(header.getBigInt64(16, true));
  if (kind === EVENTS || kind === CAUSED) {
    shown += count;
    if (hello.live && paused) return;
    const dt = new Uint32Array(buffer, HEADER_BYTES, count);
    const x = new Uint16Array(buffer, HEADER_BYTES + 4 * count, count);
    const y = new Uint16Array(buffer, HEADER_BYTES + 6 * count, count);
    store.add(baseUs, nowUs, dt, x, y, kind === CAUSED ? new Uint8Array(buffer, HEADER_BYTES + 8 * count, count) : null);
    if (hello.live) rate.count(baseUs, nowUs, dt, y);
  } else if (kind === SEEK) {
    store.clear(nowUs);
    shown = 0;
    heldUs = null;
  } else if (kind in IMAGES && !(hello.live && paused)) {
    takeImage(kind, new Uint8Array(buffer, HEADER_BYTES), header.getUint32(24, true), header.getUint32(28, true), count);
  }
  dirty = true;
}

function takeImage(kind, bytes, width, height, channels) {
  $("frames").hidden = false;
  $(`${IMAGES[kind]}-figure`).hidden = false;
  const canvas = $(IMAGES[kind]);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d", { alpha: false });
  const picture = context.createImageData(width, height);
  for (let i = 0, o = 0; i < bytes.length; i += channels, o += 4) {
    picture.data[o] = bytes[i];
    picture.data[o + 1] = bytes[channels === 3 ? i + 1 : i];
    picture.data[o + 2] = bytes[channels === 3 ? i + 2 : i];
    picture.data[o + 3] = 255;
  }
  context.putImageData(picture, 0, 0);
}

const tellVisibility = () => send({ frames: !document.hidden });
document.addEventListener("visibilitychange", () => { tellVisibility(); dirty = true; });

// ---- pictures ------------------------------------------------------------------------------------------------------

function loop() {
  requestAnimationFrame(loop);
  if (!dirty || !hello || !look) return;
  dirty = false;
  const nowUs = now();
  image.draw(store, nowUs, settings, look);
  cloud.draw(store, nowUs, settings.depthUs, look);
  rate.draw(nowUs, settings.windowUs, look);
  $("clock").textContent = rate.file ? `${seconds(nowUs)} / ${(rate.file.end_us / 1e6).toFixed(3)}` : seconds(nowUs);
  $("play").classList.toggle("paused", paused);
  $("play").setAttribute("aria-label", paused ? "Play" : "Pause");
  showNumbers(nowUs);
}

let numbersAtMs = 0;
function showNumbers(nowUs) {
  const ms = performance.now();
  if (ms - numbersAtMs < 120) return;
  numbersAtMs = ms;
  const inSpan = store.at(nowUs + 1) - store.at(nowUs - RATE_OVER_US);
  const numbers = [["events/s", short(inSpan / RATE_OVER_US * 1e6)]];
  const known = rate.file?.complete ? sum(rate.file.on) + sum(rate.file.off) : status.events ?? shown;
  numbers.push([rate.file?.complete ? "events in all" : "events so far", short(known)]);
  if (typeof status.real_time_share === "number") numbers.push(["of real time", percent(status.real_time_share)]);
  if (status.dropped_frames) numbers.push(["frames dropped", short(status.dropped_frames)]);
  if (status.missed_events) numbers.push(["skipped here", percent(status.missed_events / (status.missed_events + shown)), SKIPPED]);
  $("numbers").replaceChildren(...numbers.map(([name, value, title]) => {
    const pair = Object.assign(document.createElement("div"), { title: title ?? "" });
    pair.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
    return pair;
  }));
}

const sum = (counts) => counts.reduce((a, b) => a + b, 0);

function setState(text, kind) {
  $("state").textContent = text;
  $("state").className = `state ${kind}`;
}

// The largest size of the image that fits, in whole pixels of the screen where that does not cost much.
function fit() {
  if (!hello) return;
  const stage = $("image").parentElement;
  let scale = Math.min(stage.clientWidth / hello.width, stage.clientHeight / hello.height);
  const ratio = window.devicePixelRatio || 1, whole = Math.floor(scale * ratio) / ratio;
  if (whole > 0.93 * scale) scale = whole;
  $("image").style.width = `${hello.width * scale}px`;
  $("image").style.height = `${hello.height * scale}px`;
  dirty = true;
}
new ResizeObserver(fit).observe($("image").parentElement);
new ResizeObserver(() => { dirty = true; }).observe($("cloud"));
new ResizeObserver(() => { dirty = true; }).observe($("rate"));

// ---- looks ---------------------------------------------------------------------------------------------------------

const systemDark = matchMedia("(prefers-color-scheme: dark)");
systemDark.addEventListener("change", restyle);

function restyle() {
  const theme = settings.theme ?? (systemDark.matches ? "dark" : "light");
  document.documentElement.dataset.theme = theme;
  const rgb = tables[settings.colours][theme];
  const table = new Uint32Array(256);
  for (let i = 0; i < 256; i++) table[i] = (255 << 24 | rgb[3 * i + 2] << 16 | rgb[3 * i + 1] << 8 | rgb[3 * i]) >>> 0;
  const byCause = settings.colours in KINDS && hello !== null;
  // Points and bars take the ramps' middle; grey says nothing on a ground of its own, so they stay coloured there.
  const ramps = byCause || settings.colours === "grey" ? tables["blue-orange"][theme] : rgb;
  const of = (colours, index) => [...colours.slice(3 * index, 3 * index + 3)];
  const css = (colour) => `rgb(${colour.join(" ")})`;
  const [off, on] = [of(ramps, 43), of(ramps, 213)];
  const legend = byCause ? hello[KINDS[settings.colours]].map((name, k) => [name, of(rgb, CAUSE_LEVELS * k + 42)]) : [["OFF", of(rgb, 43)], ["ON", of(rgb, 213)]];
  const style = getComputedStyle(document.documentElement);
  const unit = (colour) => colour.map((c) => c / 255);
  look = {
    dark: theme === "dark", table, byCause, onText: css(on), offText: css(off),
    points: byCause ? legend.map(([, colour]) => unit(colour)) : [unit(off), unit(on)],
    line: theme === "dark" ? [0.38, 0.44, 0.52] : [0.55, 0.6, 0.66],
    lineText: style.getPropertyValue("--line"), text: style.getPropertyValue("--text"), soft: style.getPropertyValue("--soft"),
    window: theme === "dark" ? "rgb(255 255 255 / .12)" : "rgb(20 40 70 / .10)",
  };
  $("legend").replaceChildren(...legend.flatMap(([name, colour]) => {
    const swatch = document.createElement("i");
    swatch.style.background = css(colour);
    return [swatch, name];
  }));
  dirty = true;
}

// ---- controls ------------------------------------------------------------------------------------------------------

// Sliders run from 0 to 1 over the logarithm of what they set.
const sliders = {
  window: { key: "windowUs", low: 1e3, high: 1e6, text: $("window-text") },
  depth: { key: "depthUs", low: 1e4, high: 1e7, text: $("depth-text") },
  contrast: { key: "full", low: 20, high: 0.5, text: null },
};

// Only what is labelled can be coloured by cause, and only what is seen through filters by these.
const offered = () => Object.keys(tables).filter((name) => !(name in KINDS) || hello[KINDS[name]]);

function offerColours() {
  if (!offered().includes(settings.colours)) settings.colours = offered()[0];
  $("colours").replaceChildren(...offered().map((name) => new Option(name)));
  showSettings();
}

function showSettings() {
  for (const [id, { key, low, high, text }] of Object.entries(sliders)) {
    $(id).value = String(Math.log(settings[key] / low) / Math.log(high / low));
    if (text) text.textContent = span(settings[key]);
  }
  $("axis-past").textContent = `− ${span(settings.depthUs)}`;
  $("decay").checked = settings.decay;
  $("colours").value = settings.colours;
  localStorage.setItem("clsim", JSON.stringify(settings));
  restyle();
}

function change(changes) {
  Object.assign(settings, changes);
  for (const { key, low, high } of Object.values(sliders)) {
    settings[key] = Math.min(Math.max(low, high), Math.max(Math.min(low, high), settings[key]));
  }
  showSettings();
}

for (const [id, { key, low, high }] of Object.entries(sliders)) {
  $(id).addEventListener("input", () => change({ [key]: low * (high / low) ** Number($(id).value) }));
}
$("decay").addEventListener("change", () => change({ decay: $("decay").checked }));
$("colours").addEventListener("change", () => change({ colours: $("colours").value }));
$("speed").addEventListener("change", () => send({ command: "speed", value: Number($("speed").value) }));
$("loop").addEventListener("change", () => send({ command: "loop", value: $("loop").checked }));
$("play").addEventListener("click", togglePlay);
$("image").addEventListener("click", togglePlay);
$("theme").addEventListener("click", toggleTheme);
$("help-open").addEventListener("click", () => $("help").showModal());

function togglePlay() {
  paused = !paused;
  heldUs = null;
  if (!hello?.live) send({ command: "play", value: !paused });
  dirty = true;
}

function toggleTheme() {
  change({ theme: document.documentElement.dataset.theme === "dark" ? "light" : "dark" });
}

// The server reads from a file: it is not asked at every move of the mouse, but always for the last place.
let seekUs = null, seekTimer = null;
function seek(timeUs) {
  seekUs = Math.round(timeUs);
  if (seekTimer !== null) return;
  const ask = () => {
    seekTimer = null;
    if (seekUs === null) return;
    send({ command: "seek", value: seekUs });
    seekUs = null;
    seekTimer = setTimeout(ask, 80);
  };
  ask();
}

// A stream is stepped through what the browser still holds of it, a recording through the file.
function step(direction) {
  const target = now() + direction * settings.windowUs;
  if (!hello?.live) { seek(target); return; }
  if (!paused) togglePlay();
  heldUs = Math.min(store.nowUs, Math.max(store.t[store.first & store.mask], target));
  dirty = true;
}

const keys = {
  " ": togglePlay, ArrowLeft: () => step(-1), ArrowRight: () => step(1),
  "[": () => change({ windowUs: settings.windowUs / 1.25 }), "]": () => change({ windowUs: settings.windowUs * 1.25 }),
  "-": () => change({ full: settings.full * 1.2 }), "+": () => change({ full: settings.full / 1.2 }), "=": () => change({ full: settings.full / 1.2 }),
  d: () => change({ decay: !settings.decay }), t: toggleTheme, r: () => { if (cloud.gl) cloud.home(); dirty = true; },
  c: () => { const names = offered(); change({ colours: names[(names.indexOf(settings.colours) + 1) % names.length] }); },
  f: () => document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen(),
  "?": () => $("help").showModal(),
};
// A button that was clicked would take the keys from then on; one that was reached by keys keeps them.
document.addEventListener("click", (event) => { if (event.detail > 0) event.target.closest("button")?.blur(); });
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || $("help").open) return;
  const inControl = event.target.closest("input, select, button");
  if (inControl && (event.key === " " || event.key.startsWith("Arrow"))) return;
  const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action) return;
  event.preventDefault();
  action();
});

tables = await (await fetch("/colormaps.json")).json();
if (!tables[settings.colours]) settings.colours = Object.keys(tables)[0];
showSettings();
connect();
loop();
