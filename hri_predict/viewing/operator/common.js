// What the pages of one cell and of many share: symbols of levels, the connection, alerts, sound.
// All text goes in as text, never as HTML. A page that hears nothing turns grey: an old green must
// never stand.
"use strict";
const GONE_MS = 1500, AGAIN_MS = 2000, STILL_MS = 3000, ROWS = 100;
const UNSEEN = /[\u0000-\u001f\u007f-\u009f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]/g;
const LONGEST = 300;
const SVG = "http://www.w3.org/2000/svg";
const byId = (id) => document.getElementById(id);
const page = { told: null, history: [], missed: 0, forgotten: 0 };
let heardMs = -Infinity, lagMs = Infinity, aheadMs = null, sound = null, alarmed = 0, rows = "";

// Text that cannot turn its surroundings around, and has an end.
function clean(text) {
  const shown = String(text).replace(UNSEEN, "\ufffd");
  return shown.length > LONGEST ? shown.slice(0, LONGEST) + "…" : shown;
}

function part(kind, name, text) {
  const made = document.createElement(kind);
  made.className = name;
  made.dir = "auto";
  made.textContent = clean(text);
  return made;
}

function isLevel(level) {
  return Object.hasOwn(LOOKS, level);
}

function word(level) {
  return isLevel(level) ? LOOKS[level].word : level;
}

function symbol(level) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 100 100");
  svg.setAttribute("aria-hidden", "true");
  const look = LOOKS[level], isCircle = look.shape === "circle";
  const shape = document.createElementNS(SVG, isCircle ? "circle" : "polygon");
  if (isCircle) for (const [key, value] of [["cx", 50], ["cy", 50], ["r", 48]])
    shape.setAttribute(key, value);
  else shape.setAttribute("points", look.shape);
  shape.setAttribute("fill", "#fff");
  const sign = document.createElementNS(SVG, "text");
  for (const [key, value] of [["x", 50], ["y", level === "WARN" ? 82 : 72], ["font-size", 62],
    ["text-anchor", "middle"], ["font-weight", 900], ["fill", "#111"]]) sign.setAttribute(key, value);
  sign.textContent = look.sign;
  svg.append(shape, sign);
  return svg;
}

function fact(name, text) {
  const made = part("span", "", name + " ");
  made.append(part("b", "", text));
  return made;
}

const sinceHeardMs = () => performance.now() - heardMs;
const isLate = () => sinceHeardMs() > GONE_MS;

// The time of day here, as "explain --at" reads it: browsers may write 12 hours with AM and PM.
function clock(at) {
  return [at.getHours(), at.getMinutes(), at.getSeconds()].map((n) => String(n).padStart(2, "0")).join(":");
}

// The time of day here and, where that is another, in UTC: "explain" and recordings count in UTC.
function times(ms) {
  const at = new Date(ms);
  if (isNaN(at)) return ["–"];
  const here = clock(at);
  return at.getTimezoneOffset() ? [here, ", " + at.toISOString().slice(11, 19) + " UTC"] : [here];
}

function explained(ms) { // the command that says why, as it stands in a terminal
  const at = new Date(ms);
  return isNaN(at) ? "" : "hri-predict explain RECORDING --at " + at.toISOString().slice(0, 19);
}

function row(alert, nameOf) {
  const line = part("li", (isLevel(alert.level) ? alert.level : "UNKNOWN") + (alert.read ? " read" : ""), "");
  if (isLevel(alert.level) && LOOKS[alert.level].slows) line.title = explained(alert.utc_s * 1000);
  const [here, utc] = times(alert.utc_s * 1000), when = part("span", "when", here);
  if (utc) when.append(part("small", "", utc));
  line.append(when,
    part("span", "level", word(alert.level)),
    part("span", "from", nameOf(alert)), part("span", "text", alert.reason));
  if (!alert.read) {
    const button = part("button", "", "Mark as read");
    button.type = "button";
    button.addEventListener("click", () => acknowledge({ number: alert.number }));
    line.append(button);
  }
  return line;
}

function drawHistory(nameOf) {
  const now = JSON.stringify([page.history, page.missed, page.forgotten, page.history.map(nameOf)]);
  if (now === rows) return;
  rows = now;
  const lines = page.history.slice(0, ROWS).map((alert) => row(alert, nameOf));
  if (page.missed) lines.unshift(part("li", "", page.missed + " changes were missed"));
  if (page.forgotten) lines.push(part("li", "", page.forgotten + " older alerts went out unread"));
  byId("history").replaceChildren(...lines);
  const unread = page.history.filter((alert) => !alert.read).length;
  byId("unread").textContent = unread ? unread + " unread" : "";
}

// A refusal must show: the alert would seem to be seen by colleagues.
function acknowledge(which) {
  const say = (why) => { byId("refused").textContent = why && "Not marked as read: " + why; };
  return fetch("acknowledge", { method: "POST", body: JSON.stringify(which) }).then(
    (answer) => say(answer.ok ? "" : answer.status === 403
      ? "open this page by its address, or start it with --operator-url"
      : "the answer was " + answer.status),
    () => say("no connection"));
}

function beep() {
  if (!sound) return;
  const tone = sound.createOscillator(), loud = sound.createGain();
  tone.frequency.value = 880;
  loud.gain.value = 0.2;
  tone.connect(loud).connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.25);
}

// A browser whose page hangs goes on to play animations: this one covers the page unless each
// drawing puts it back to its start.
const stands = byId("still").animate([{ opacity: 0 }, { opacity: 0, offset: 0.9 }, { opacity: 1 }],
  { duration: STILL_MS, fill: "forwards" });
function alive() {
  stands.currentTime = 0;
  stands.play();
}

// In a computer that sleeps, performance.now() may stand still: what waited would seem to be new.
function slept() {
  const before = aheadMs;
  aheadMs = Date.now() - performance.now();
  return before !== null && Math.abs(aheadMs - before) > GONE_MS;
}

function take(event) {
  const said = JSON.parse(event.data);
  const lag = performance.now() - said.sent_ms; // clocks differ, but what is late comes later
  lagMs = Math.min(lagMs, lag);
  if (lag - lagMs < GONE_MS) heardMs = performance.now() - (lag - lagMs);
  page.told = said;
  if (said.history) Object.assign(page,
    { history: said.history, missed: said.missed, forgotten: said.forgotten });
  const newest = page.history.length ? page.history[0] : null;
  if (newest && newest.number > alarmed) {
    if (alarmed && page.history.some((each) => each.number > alarmed && !each.read)) beep();
    alarmed = newest.number;
  }
}

// Shows with ``draw`` what is told, at each event and four times a second; ``nameOf`` an alert says
// whose it is.
function follow(draw, nameOf) {
  let events = null;
  const show = () => { if (slept()) listen(); draw(); alive(); };
  const listen = () => { // a browser asks again by itself, but not after a refusal: too many, say
    if (events) events.close(); // with all that waits in it
    heardMs = Math.min(heardMs, performance.now() - GONE_MS - 1);
    const mine = events = new EventSource("events");
    mine.addEventListener("message", (event) => {
      if (slept()) { listen(); return; }
      take(event); show(); drawHistory(nameOf);
    });
    mine.addEventListener("open", () => { lagMs = Infinity; alarmed = 0; });
    mine.addEventListener("error", () => {
      if (mine.readyState === EventSource.CLOSED && mine === events) setTimeout(listen, AGAIN_MS);
    });
  };
  listen();
  setInterval(show, 250);
  document.addEventListener("visibilitychange", show);
  show();
}

byId("all").addEventListener("click", () => {
  if (page.history.length) acknowledge({ up_to: page.history[0].number });
});

byId("sound").addEventListener("click", () => {
  if (sound) { sound.close(); sound = null; } else sound = new AudioContext();
  byId("sound").textContent = sound ? "Sound: on" : "Sound: off";
  byId("sound").setAttribute("aria-pressed", String(Boolean(sound)));
});
