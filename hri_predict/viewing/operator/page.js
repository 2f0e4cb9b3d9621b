// The page of one cell: a field for each robot.
"use strict";
let shown = "";

function robot(name, level, reason, clears) {
  if (!isLevel(level)) level = "UNKNOWN";
  const box = part("div", "robot " + level, "");
  const text = document.createElement("div");
  text.append(part("div", "name", name), part("div", "word", WORDS[level] || level),
    part("div", "reason", reason));
  if (clears) text.append(part("div", "clears", "Clears when " + clears + "."));
  box.append(symbol(level), text);
  return box;
}

function draw() {
  const told = page.told, late = isLate();
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

follow(draw, (alert) => page.told.robots[alert.robot] || "robot " + alert.robot);
