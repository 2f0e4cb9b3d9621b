// Shows what the server says. All text goes in as text, never as HTML. A page that hears nothing
// turns grey: an old green must never stand.
"use strict";
const GONE_MS = 1500, AGAIN_MS = 2000;
const SHAPES = { // points of a 100 x 100 field; the shape alone says the level
  CLEAR: "circle", WARN: "50,6 96,90 4,90", SLOW: "50,2 98,50 50,98 2,50",
  STOP: "30,2 70,2 98,30 98,70 70,98 30,98 2,70 2,30",
  UNKNOWN: "8,8 92,8 92,92 8,92", FAULT: "8,8 92,8 92,92 8,92", GONE: "8,8 92,8 92,92 8,92",
};
const SIGNS = { CLEAR: "✓", WARN: "!", SLOW: "▼", STOP: "■", UNKNOWN: "?", FAULT: "×", GONE: "–" };
const WORDS = { GONE: "NO CONTACT" };
const SVG = "http://www.w3.org/2000/svg";
const byId = (id) => document.getElementById(id);
let heardMs = -Infinity, lagMs = Infinity, told = null, sound = null, alarmed = 0, shown = "";

function part(kind, name, text) {
  const made = document.createElement(kind);
  made.className = name;
  made.textContent = text;
  return made;
}

function symbol(level) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 100 100");
  const isCircle = SHAPES[level] === "circle";
  const shape = document.createElementNS(SVG, isCircle ? "circle" : "polygon");
  if (isCircle) for (const [key, value] of [["cx", 50], ["cy", 50], ["r", 48]])
    shape.setAttribute(key, value);
  else shape.setAttribute("points", SHAPES[level]);
  shape.setAttribute("fill", "#fff");
  const sign = document.createElementNS(SVG, "text");
  for (const [key, value] of [["x", 50], ["y", level === "WARN" ? 82 : 72], ["font-size", 62],
    ["text-anchor", "middle"], ["font-weight", 900], ["fill", "#111"]]) sign.setAttribute(key, value);
  sign.textContent = SIGNS[level];
  svg.append(shape, sign);
  return svg;
}

function robot(name, level, reason, clears) {
  if (!(level in SHAPES)) level = "UNKNOWN";
  const box = part("div", "robot " + level, "");
  const text = document.createElement("div");
  text.append(part("div", "name", name), part("div", "word", WORDS[level] || level),
    part("div", "reason", reason));
  if (clears) text.append(part("div", "clears", "Clears when " + clears + "."));
  box.append(symbol(level), text);
  return box;
}

function fact(name, text) {
  const made = part("span", "", name + " ");
  made.append(part("b", "", text));
  return made;
}

function draw() {
  const late = performance.now() - heardMs > GONE_MS;
  const gone = late || !told || !told.known;
  const why = late ? (told ? "this page lost the node" : "waiting for the node") : told && told.why;
  const names = told && told.robots.length ? told.robots : ["hri-predict"];
  const boxes = gone ? names.map((name) => [name, "GONE", why, ""])
    : told.levels.map((r) => [r.name, r.level, r.reason, r.level === "CLEAR" ? "" : r.clears]);
  const now = JSON.stringify(boxes);
  if (now !== shown) {
    shown = now;
    byId("robots").replaceChildren(...boxes.map((box) => robot(...box)));
  }
  document.title = boxes.map((box) => (WORDS[box[1]] || box[1]) + " " + box[0]).join(", ");
  const facts = [fact("cell", told ? told.cell : "")];
  if (!gone) {
    facts.push(fact("people", String(told.people) + (told.lost ? ", lost: " + told.lost : "")));
    facts.push(fact("age of the newest capture",
      told.age_s === null ? "none" : (told.age_s * 1000).toFixed(0) + " ms"));
    facts.push(fact("node", told.state));
    for (const r of told.levels) {
      const limit = r.limit_m_s === null ? 0 : r.limit_m_s;
      const nearest = r.separation_m === null ? "" : ", nearest " + r.separation_m.toFixed(2) + " m";
      facts.push(fact(r.name, limit.toFixed(2) + " m/s allowed" + nearest));
      if (r.latch) facts.push(fact("latched stop", "acknowledge it at the cell"));
    }
  }
  byId("facts").replaceChildren(...facts);
}

function row(alert) {
  const line = part("li", alert.level + (alert.read ? " read" : ""), "");
  const when = new Date(alert.utc_s * 1000).toLocaleTimeString();
  const name = told.robots[alert.robot] || "robot " + alert.robot;
  line.append(part("span", "when", when), part("span", "level", alert.level),
    part("span", "text", name + ": " + alert.reason));
  if (!alert.read) {
    const button = part("button", "", "Mark as read");
    button.addEventListener("click", () => acknowledge(alert.number));
    line.append(button);
  }
  return line;
}

let rows = "";
function drawHistory() {
  const now = JSON.stringify([told.history, told.missed]);
  if (now === rows) return;
  rows = now;
  const lines = told.history.slice(0, 60).map(row);
  if (told.missed) lines.unshift(part("li", "", told.missed + " changes were missed"));
  byId("history").replaceChildren(...lines);
}

function acknowledge(number) {
  return fetch("/acknowledge", { method: "POST", body: JSON.stringify({ number }) });
}

byId("all").addEventListener("click", async () => {
  if (told) for (const alert of told.history) if (!alert.read) await acknowledge(alert.number);
});

byId("sound").addEventListener("click", () => {
  if (sound) { sound.close(); sound = null; } else sound = new AudioContext();
  byId("sound").textContent = sound ? "Sound: on" : "Sound: off";
  byId("sound").setAttribute("aria-pressed", String(Boolean(sound)));
});

function beep() {
  if (!sound) return;
  const tone = sound.createOscillator(), loud = sound.createGain();
  tone.frequency.value = 880;
  loud.gain.value = 0.2;
  tone.connect(loud).connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.25);
}

function take(event) {
  told = JSON.parse(event.data);
  const lag = performance.now() - told.sent_ms; // clocks differ, but what is late comes later
  lagMs = Math.min(lagMs, lag);
  if (lag - lagMs < GONE_MS) heardMs = performance.now();
  const newest = told.history.length ? told.history[0] : null;
  if (newest && newest.number > alarmed) {
    if (alarmed && !newest.read) beep();
    alarmed = newest.number;
  }
  draw();
  drawHistory();
}

function listen() { // a browser asks again by itself, but not after a refusal: too many, say
  const events = new EventSource("/events");
  events.addEventListener("message", take);
  events.addEventListener("open", () => { lagMs = Infinity; alarmed = 0; });
  events.addEventListener("error", () => {
    if (events.readyState === EventSource.CLOSED) setTimeout(listen, AGAIN_MS);
  });
}
listen();
setInterval(draw, 250);
draw();
