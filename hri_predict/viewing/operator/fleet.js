// The page of many cells: a tile for each, always at the same place, so that a hand and an eye find
// it. What is bad stands out by its fill, by the counts at the top and by the list beside them.
"use strict";
const ORDER = Object.keys(LOOKS);
const LEAST_PX = 150, WIDE = 1.45, NAMED = 7;
const tiles = new Map();
let chosen = asked(), details = "", header = "";

function asked() { // by the address, to come back to the same cell
  try { return decodeURIComponent(location.hash.slice(1)); } catch { return ""; }
}

const seconds = (s) => s < 99.95 ? s.toFixed(1) + " s" : s < 5999 ? (s / 60).toFixed(0) + " min"
  : (s / 3600).toFixed(0) + " h";
const speed = (limit) => limit === null || limit === undefined ? "– m/s" : limit.toFixed(2) + " m/s";

const isNow = () => !isLate() && Boolean(page.told) && page.told.known;

// Each cell as it is shown now, by this page's own clock.
function cells() {
  const told = page.told, sinceS = Math.max(0, sinceHeardMs() / 1000);
  if (!told) return [];
  if (!isNow()) {
    const why = isLate() ? "this page lost hri-predict fleet" : told.why;
    return told.names.map((name) => ({ name, level: "GONE", reason: why, robots: [] }));
  }
  return told.cells.map((cell) => {
    const heard_s = cell.heard_s === null ? null : cell.heard_s + sinceS;
    if (cell.level === "GONE" || heard_s === null || heard_s <= told.silent_s + GONE_MS / 1000)
      return { ...cell, heard_s, level: isLevel(cell.level) ? cell.level : "UNKNOWN" };
    return { ...cell, heard_s, level: "GONE", reason: "no messages", limit_m_s: null, robots: [] };
  });
}

// Tells cells of one name apart: the second is not the first.
function keyed(all) {
  const times = new Map();
  return all.map((cell) => {
    const before = times.get(cell.name) || 0;
    times.set(cell.name, before + 1);
    return [before ? cell.name + "\n" + before : cell.name, cell];
  });
}

function write(element, text) {
  const shown = clean(text);
  if (element.textContent !== shown) element.textContent = shown;
}

class Tile {
  constructor(key) {
    this.box = part("div", "tile", "");
    this.box.tabIndex = 0;
    this.box.setAttribute("role", "button");
    const choose = () => { chosen = chosen === key ? "" : key; location.hash = encodeURIComponent(chosen); draw(); };
    this.box.addEventListener("click", choose);
    this.box.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); choose(); }
    });
    const inside = part("div", "inside", "");
    [this.name, this.what, this.reason, this.foot] =
      ["name", "what", "reason", "foot"].map((name) => part("div", name, ""));
    [this.limit, this.age] = ["limit", "age"].map((name) => part("span", name, ""));
    this.word = part("span", "word", "");
    this.foot.append(this.limit, this.age);
    inside.append(this.name, this.what, this.reason, this.foot);
    this.box.append(inside);
    this.level = "";
  }

  show(cell, isChosen) {
    if (cell.level !== this.level) {
      this.level = cell.level;
      this.what.replaceChildren(symbol(cell.level), this.word);
    }
    const look = "tile " + cell.level + (isChosen ? " chosen" : "") + (cell.note ? " degraded" : "");
    if (this.box.className !== look) this.box.className = look;
    write(this.name, cell.name || "(no name)");
    write(this.word, word(cell.level));
    write(this.reason, cell.note && cell.level === "CLEAR" ? cell.note : cell.reason);
    write(this.limit, speed(cell.limit_m_s));
    write(this.age, cell.heard_s === undefined ? "" : cell.heard_s === null ? "never heard"
      : seconds(cell.heard_s) + " ago");
    this.box.title = clean(cell.name) + ": " + clean(cell.reason);
  }
}

// As many columns as make the tiles largest.
function arrange(count) {
  const main = byId("tiles"), width = main.clientWidth, height = main.clientHeight;
  const most = Math.max(1, Math.floor(width / LEAST_PX));
  let best = 1, size = 0;
  for (let columns = 1; columns <= Math.min(most, count); columns++) {
    const fits = Math.min(width / columns, WIDE * height / Math.ceil(count / columns));
    if (fits >= size) [best, size] = [columns, fits];
  }
  main.style.setProperty("--columns", best);
}

function drawHeader(all) {
  const counts = ORDER.map((level) => [level, all.filter((cell) => cell.level === level).length]);
  const bad = isNow() ? ORDER.slice(0, -1).flatMap((level) => all.filter((cell) => cell.level === level)) : [];
  const named = bad.slice(0, NAMED).map((cell) => [cell.level, cell.name || "(no name)"]);
  const now = JSON.stringify([counts, named, bad.length, isNow()]);
  if (now === header) return;
  header = now;
  byId("counts").replaceChildren(...counts.map(([level, count]) => {
    const chip = part("div", "count " + (count ? level : "none"), "");
    chip.append(symbol(level), part("b", "", count), part("span", "", word(level)));
    return chip;
  }));
  const more = bad.length > NAMED ? "and " + (bad.length - NAMED) + " more" : "";
  const first = part("div", "", named.length ? "Look first at " : isNow() && all.length ? "All cells are clear." : "");
  for (const [level, name] of named) {
    const one = part("span", "", "");
    one.append(symbol(level), part("bdi", "", name));
    first.append(one);
  }
  first.append(more);
  byId("first").replaceChildren(first);
  document.title = counts.filter(([, count]) => count)
    .map(([level, count]) => count + " " + word(level)).join(", ") || "hri-predict fleet";
}

function line(level, head, text) {
  const made = part("div", "of " + level, "");
  const words = document.createElement("div");
  words.append(part("b", "", head), part("div", "", text));
  made.append(symbol(level), words);
  return made;
}

function drawDetails(cell) {
  byId("details").hidden = !cell;
  const now = JSON.stringify(cell || null);
  if (!cell || now === details) return;
  details = now;
  const head = part("h2", "", cell.name || "(no name)");
  const close = part("button", "", "Close");
  close.addEventListener("click", () => { chosen = ""; location.hash = ""; draw(); });
  head.append(close);
  const robots = cell.robots.map((r) => line(isLevel(r.level) ? r.level : "UNKNOWN",
    "robot " + r.robot + ": " + word(r.level),
    r.reason + "; " + speed(r.limit_m_s) + " allowed"
      + (r.separation_m === null ? "" : ", nearest " + r.separation_m.toFixed(2) + " m")));
  const list = document.createElement("dl");
  const facts = [["node", cell.note || cell.node], ["people", cell.people],
    ["age of the newest capture", cell.age_s === null || cell.age_s === undefined ? null
      : cell.level === "GONE" ? null : (cell.age_s * 1000).toFixed(0) + " ms"],
    ["last message", typeof cell.heard_s === "number" ? seconds(cell.heard_s) + " ago" : null],
    ["messages lost", cell.lost], ["messages refused", cell.refused]];
  for (const [name, value] of facts)
    if (value !== null && value !== undefined && value !== "") list.append(part("dt", "", name), part("dd", "", value));
  const said = line(cell.level, word(cell.level), cell.reason);
  const isSaid = cell.robots.some((r) => r.level === cell.level); // by the robot itself
  byId("details").replaceChildren(head, ...(isSaid ? [] : [said]), ...robots, list);
}

function drawTrouble() {
  const told = page.told;
  const says = isLate()
    ? told ? "NO CONTACT: this page lost hri-predict fleet " + seconds(sinceHeardMs() / 1000) + " ago. Nothing here is current."
      : "Waiting for hri-predict fleet."
    : !told.known ? "NO CONTACT: " + told.why + ". Nothing here is current."
      : told.trouble ? "Not connected: " + told.trouble
        : told.left_out ? told.left_out + " messages are ignored: unknown keys or too many cells."
          : told.cells.length ? "" : "No message from any cell yet.";
  byId("trouble").hidden = !says;
  write(byId("trouble"), says);
}

function draw() {
  const all = keyed(cells());
  for (const [key, cell] of all) {
    if (!tiles.has(key)) tiles.set(key, new Tile(key));
    tiles.get(key).show(cell, key === chosen);
  }
  const keys = all.map(([key]) => key), now = JSON.stringify(keys);
  if (byId("tiles").dataset.keys !== now) {
    byId("tiles").dataset.keys = now;
    byId("tiles").replaceChildren(...keys.map((key) => tiles.get(key).box));
    for (const key of [...tiles.keys()]) if (!keys.includes(key)) tiles.delete(key);
  }
  drawTrouble();
  drawHeader(all.map(([, cell]) => cell));
  drawDetails((all.find(([key]) => key === chosen) || [])[1]);
  arrange(all.length);
  write(byId("clock"), clock(new Date()));
}

document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") { chosen = ""; location.hash = ""; draw(); }
});
follow(draw, (alert) => (alert.cell || "(no name)") + (alert.robot === null ? "" : ", robot " + alert.robot));
