// The page: takes what the server tells, and shows it as a person wants it.

import { Store } from "./store.js";
import { Strips } from "./strips.js";
import { View } from "./view.js";

const { grouped, minus, seconds, three, utc, written } = Digits;
const by = (id) => document.getElementById(id);
const STALE = 1.0; // s without a sample after which numbers are said to be old
const TRAIL = 2.0; // s of the spots' way that is drawn

// What is known of the run, and since when.
const run = { line: null, hello: null, store: null, sample: null, status: null, rate: null, end: null, connected: false, connections: 0,
  heard: 0, sampled: 0, seq: null, events: 0 };
// What is looked at. at: a time, null for the newest.
const look = { paused: false, from: 0, to: 20, at: null, hover: null, playing: false };
let strips = null, scene = null, fresh = true;

// Connection ------------------------------------------------------------------------------------

let wait = 500;

function connect() {
  const address = new URL("stream", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  const line = new WebSocket(address);
  line.binaryType = "arraybuffer";
  run.line = line;
  line.onopen = () => { run.connected = true; run.connections++; run.heard = performance.now(); wait = 500; fresh = true; };
  line.onmessage = ({ data }) => {
    run.heard = performance.now();
    if (typeof data === "string") take(JSON.parse(data));
    else run.store?.take(data);
    fresh = true;
  };
  line.onclose = () => {
    run.connected = false;
    fresh = true;
    if (run.end) return;
    setTimeout(connect, wait);
    wait = Math.min(5000, 1.6 * wait);
  };
}

function take(message) {
  if (message.type === "hello") begin(message);
  else if (message.type === "news") hear(message);
  else if (message.type === "end") run.end = message;
}

function begin(hello) {
  const known = run.hello !== null;
  run.hello = hello;
  run.store = new Store(hello);
  run.events = 0;
  by("events").replaceChildren();
  by("title").textContent = `facets ${hello.kind === "replay" ? "replay" : "acquire"} · ${hello.config}`;
  document.title = by("title").textContent;
  if (known) return;
  if (hello.kind === "replay") by("span").value = "all";
  strips = new Strips(by("strips"), hello, { zoom, wheel, follow, hover });
  by("of").parentElement.hidden = strips.kinds.length < 2;
  by("of").replaceChildren(...["all", ...strips.kinds].map((kind) => new Option(kind, kind)));
  scene = new View(by("scene"), by("faces"), by("card"), hello);
  scene.theme(document.documentElement.dataset.theme);
  // for tests and for those who look behind the page
  window.facets = { run, look, strips, scene };
}

function hear(news) {
  if (news.sample && news.sample.seq !== run.seq) {
    run.seq = news.sample.seq;
    run.sampled = performance.now();
  }
  run.sample = news.sample;
  run.rate = news.rate;
  if (news.status) run.status = news.status;
  for (const event of news.events) tell(event);
  describe();
}

// What is looked at -----------------------------------------------------------------------------

function span() {
  const range = run.store?.range();
  const value = by("span").value;
  if (value === "all") return range ? Math.max(range[1] - range[0], 0.1) : 20;
  return Number(value);
}

function newest() {
  return run.sample?.t ?? run.store?.range()?.[1] ?? 0;
}

function pause() {
  if (look.paused) return;
  if (!run.store?.range()) return;
  look.paused = true;
  look.to = newest();
  look.from = look.to - span();
  look.at = look.to;
  fresh = true;
}

function follow() {
  look.paused = look.playing = false;
  look.at = null;
  fresh = true;
}

function zoom(from, to) {
  pause();
  if (!look.paused) return;
  [look.from, look.to] = from < to ? [from, to] : [to, from];
  if (look.to - look.from < 0.01) look.to = look.from + 0.01;
  look.at = Math.min(Math.max(look.at, look.from), look.to);
  fresh = true;
}

function wheel(factor, at) {
  pause();
  if (!look.paused) return;
  const range = run.store.range(), wide = Math.max(range[1] - range[0], 0.1);
  const limited = Math.min(factor, (1.2 * wide) / (look.to - look.from));
  zoom(at - (at - look.from) * limited, at + (look.to - at) * limited);
}

function hover(time) {
  look.hover = look.paused && !look.playing ? time : null;
  if (look.hover !== null) look.at = time;
  fresh = true;
}

function shift(share) {
  pause();
  const by_ = share * (look.to - look.from);
  zoom(look.from + by_, look.to + by_);
}

function play() {
  pause();
  look.playing = look.paused && !look.playing;
  const range = run.store?.range();
  if (look.playing && range && look.at >= Math.min(look.to, range[1]) - 1e-3) look.at = Math.max(look.from, range[0]);
  fresh = true;
}

by("pause").onclick = () => (look.paused ? follow() : pause());
by("play").onclick = play;
by("resume").onclick = () => run.line?.send("resume");
by("of").onchange = () => {
  strips.close();
  strips = window.facets.strips = new Strips(by("strips"), run.hello, { zoom, wheel, follow, hover }, by("of").value);
  fresh = true;
};
by("span").onchange = () => {
  if (look.paused) zoom(Math.max(0, look.to - span()), Math.max(look.to, 0.01));
  fresh = true;
};
by("at").oninput = () => {
  pause();
  look.playing = false;
  look.at = Number(by("at").value);
  keep();
  fresh = true;
};
addEventListener("keydown", (event) => {
  if (["SELECT", "INPUT", "BUTTON"].includes(event.target.tagName) || event.ctrlKey || event.altKey || event.metaKey) return;
  const what = { " ": () => (look.paused ? follow() : pause()), ArrowLeft: () => shift(-0.2), ArrowRight: () => shift(0.2) }[event.key];
  if (what) { event.preventDefault(); what(); }
});

// Keeps the time that is looked at within what is shown.
function keep() {
  const wide = look.to - look.from;
  if (look.at > look.to) { look.to = look.at; look.from = look.to - wide; }
  if (look.at < look.from) { look.from = look.at; look.to = look.from + wide; }
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  by("theme").textContent = name === "dark" ? "Light" : "Dark";
  scene?.theme(name);
  fresh = true;
}
const asked = new URLSearchParams(location.search).get("theme");
const liked = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
theme(["light", "dark"].includes(asked) ? asked : liked);
by("theme").onclick = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");

// Showing ---------------------------------------------------------------------------------------

// How the run stands, and in words.
function state() {
  const silent = (performance.now() - run.sampled) / 1e3;
  if (run.end) return run.end.good ? ["ended", "run ended"] : ["broken", "run broke off"];
  if (!run.connected) return ["cut", run.hello ? "no connection, trying again" : "connecting"];
  if (run.status?.finished) return ["ended", "all is solved"];
  if (!run.sample) return ["waiting", "no sample yet"];
  if (silent > STALE) return ["stale", `no sample for ${silent.toFixed(0)} s`];
  return ["live", run.hello.kind === "replay" ? "solving" : "live"];
}

function doubts(name) {
  const found = [];
  if (run.end) found.push(`${run.end.reason} What came until then is kept on this page until it is closed.`);
  else if (name === "cut" && run.hello) found.push("The connection is lost: all that is shown is old.");
  else if (name === "stale") found.push("No sample comes: the numbers are those of the last one.");
  for (const text of run.status?.messages ?? []) found.push(text);
  return found;
}

// A text that is as it was is left alone: to set it again would have the browser draw again.
function put(name, text) {
  if (by(name).textContent !== text) by(name).textContent = text;
}

function header() {
  const [name, words] = state();
  document.body.dataset.state = name;
  document.body.classList.toggle("stale", ["stale", "cut", "broken"].includes(name) && !look.paused);
  const pill = look.playing ? `${words} · playing` : look.paused ? `${words} · paused` : words;
  put("pill", pill);
  put("pause", look.paused ? "Follow" : "Pause");
  put("play", look.playing ? "Stop" : "Play");
  const found = doubts(name);
  const lines = found.length ? found : [run.sample ? "Nothing to report." : "No sample has come yet."];
  const text = lines.join("\n");
  if (by("doubts").dataset.text !== text) {
    by("doubts").dataset.text = text;
    by("doubts").replaceChildren(...lines.map((line) => {
      const p = document.createElement("p");
      p.textContent = line[0].toUpperCase() + line.slice(1);
      return p;
    }));
  }
  by("doubts").classList.toggle("bad", found.length > 0 && !(run.end?.good && found.length === 1));
}

function shown() {
  if (look.at === null || !run.store) return run.sample;
  return run.store.at(look.at);
}

function draw() {
  const range = run.store.range();
  if (!look.paused) { look.to = Math.max(newest(), span()); look.from = look.to - span(); }
  const view = run.store.view(look.from, look.to, strips.pixels);
  strips.show(view, look.from, look.to, look.at);
  const sample = shown();
  const why = sample ? sample.status : look.at === null ? "no sample yet" : "no sample then";
  strips.write(sample, why);
  scene.show(sample, why, range ? run.store.trail(look.at ?? newest(), TRAIL) : []);
  const at = look.at ?? sample?.t ?? null;
  const origin = run.hello.origin_utc ?? null;
  by("when").textContent = sample || look.at !== null
    ? `t = ${seconds(at)} · ${utc(origin === null || at === null ? null : origin + at)}` : "";
  by("pose-status").textContent = sample ? (sample.bin ? `${sample.status} in ${three(1e3 * sample.width)} ms` : `sample ${grouped(sample.seq)}: ${sample.status}`) : "";
  by("pose-status").classList.toggle("bad", Boolean(sample) && !sample.pose);
  if (range) {
    by("at").min = Math.min(0, range[0]);
    by("at").max = range[1];
    if (document.activeElement !== by("at") || look.playing || !look.paused) by("at").value = at ?? range[1];
    by("at-text").textContent = `${seconds(at)} of ${seconds(range[1])}`;
  }
  by("play").disabled = by("at").disabled = !range;
}

let before = 0;

function frame(now) {
  const passed = Math.min(0.2, (now - before) / 1e3);
  before = now;
  if (look.playing && run.store?.range()) {
    look.at += passed * Number(by("speed").value);
    if (look.at >= run.store.range()[1]) { look.at = run.store.range()[1]; look.playing = false; }
    keep();
    fresh = true;
  }
  if (strips && fresh) { fresh = false; draw(); }
  header();
  scene?.frame(now);
  requestAnimationFrame(frame);
}

// The tables ------------------------------------------------------------------------------------

function list(root, items) {
  root.replaceChildren(...items.flatMap(({ name, value, unit = "", why = "", bad = false }) => {
    const dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = name;
    const known = value !== null && value !== undefined;
    dd.textContent = known ? `${typeof value === "number" ? written(value) : value}${unit ? ` ${unit}` : ""}` : `unknown: ${why}`;
    dd.className = [bad ? "bad" : "", known ? "" : "why"].join(" ").trim();
    dd.dataset.name = name;
    return [dt, dd];
  }));
}

function describe() {
  const status = run.status;
  if (!status) return;
  const rate = { name: run.hello.kind === "replay" ? "solved now" : "rate now", value: run.rate, unit: "1/s", why: "no sample yet" };
  if (!run.sample) rate.value = null;
  list(by("counts"), [rate, ...status.counts, ...status.clock, ...point(run.hello)]);
  list(by("stage"), stage(status.stage));
  by("resume").hidden = !status.stage.stopped || Boolean(run.end);
  list(by("goes"), [{ name: "record", value: status.recording }, ...status.published.map((one) => ({
    name: one.address, value: `${grouped(one.sent)} samples, ${grouped(one.dropped)} dropped${one.trouble ? `: ${one.trouble}` : ""}`,
    bad: one.dropped > 0 || Boolean(one.trouble) }))]);
}

// Which point the object's poses mean.
function point({ object, zero }) {
  const found = [];
  if (object) found.push({ name: "object at", value: `${object.point_mm.join(", ")} mm; turned by ${object.orientation_deg.map((v) => +v.toFixed(4)).join(", ")}°` });
  if (zero) found.push({ name: "displacement from", value: zero });
  return found;
}

function stage(now) {
  if (!now.there) return [{ name: "place", value: null, why: now.why }];
  const pair = (xy, digits) => (xy && xy.every((v) => v !== null) ? xy.map((v) => minus(v.toFixed(digits))).join(", ") : null);
  const error = now.error ? now.error.map((v) => 1e3 * v) : null;
  return [
    { name: "state", value: now.state, bad: now.state !== "following" },
    { name: "place x, y", value: pair(now.place, 4), unit: "mm" },
    { name: "target", value: pair(now.target, 4), unit: now.target ? "mm" : "", why: now.why },
    { name: "place − target", value: pair(error, 1), unit: error ? "µm" : "", why: now.why },
    { name: "χ of Eq. (14)", value: pair(now.chi, 4), why: "not every detector has light" },
    { name: "moves", value: now.moves },
  ];
}

function tell(event) {
  if (event.number <= run.events) return;
  run.events = event.number;
  const item = document.createElement("li"), time = document.createElement("time"), text = document.createElement("span");
  time.textContent = event.t === null ? "" : seconds(event.t);
  text.textContent = event.what ? `${event.what}: ${event.text}` : event.text;
  item.append(time, text);
  by("events").prepend(item);
  while (by("events").children.length > 200) by("events").lastChild.remove();
}

connect();
requestAnimationFrame(frame);
