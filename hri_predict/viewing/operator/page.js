// The page of one cell: a field for each robot.
"use strict";
let shown = "", contactMs = null; // the newest picture is from then, by this browser's clock

function robot(name, level, reason, near, clears) {
  if (!isLevel(level)) level = "UNKNOWN";
  const box = part("div", "robot " + level, "");
  const text = document.createElement("div");
  text.append(part("div", "name", name), part("div", "word", word(level)),
    part("div", "reason", reason));
  if (near) text.append(part("div", "near", near));
  if (clears) text.append(part("div", "clears", "Clears when " + clears + "."));
  box.append(symbol(level), text);
  return box;
}

// When the newest picture was made; null before the first.
function newestMs() {
  const silent = page.told ? page.told.silent_s : null;
  return silent === null ? null : Date.now() - silent * 1000 - sinceHeardMs();
}

function draw() {
  const told = page.told, late = isLate();
  const gone = late || !told || !told.known;
  const why = late ? (told ? "this page lost the node" : "waiting for the node") : told && told.why;
  if (!gone || contactMs === null) contactMs = newestMs(); // a computer may have slept since
  const names = told && told.robots.length ? told.robots : ["hri-predict"];
  const since = contactMs === null ? "" : "since " + times(contactMs).join("");
  const boxes = gone ? names.map((name) => [name, "GONE", why, since, ""])
    : told.levels.map((r) => [r.name, r.level, r.reason, r.near, r.clears]);
  const now = JSON.stringify(boxes);
  if (now !== shown) {
    shown = now;
    byId("robots").replaceChildren(...boxes.map((box) => robot(...box)));
  }
  document.title = boxes.map((box) => word(box[1]) + " " + box[0]).join(", ");
  const facts = [fact("cell", told ? told.cell : "")];
  if (!gone) {
    facts.push(fact("people", String(told.people) + (told.lost ? ", lost: " + told.lost : "")));
    facts.push(fact("age of the newest capture",
      told.age_s === null ? "none" : (told.age_s * 1000).toFixed(0) + " ms"));
    facts.push(fact("node", [told.state, told.reasons.join("; ")].filter(Boolean).join(": ")));
    for (const r of told.levels) {
      const limit = r.limit_m_s === null ? 0 : r.limit_m_s;
      const nearest = r.separation_m === null ? "" : ", nearest " + r.separation_m.toFixed(2) + " m";
      facts.push(fact(r.name, limit.toFixed(2) + " m/s allowed" + nearest));
      if (r.latch) facts.push(fact("to acknowledge", "look around, then press once at the cell"));
    }
  }
  byId("facts").replaceChildren(...facts);
}

follow(draw, (alert) => page.told.robots[alert.robot] || "robot " + alert.robot);
