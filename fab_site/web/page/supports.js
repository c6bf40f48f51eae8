// SPDX-License-Identifier: GPL-3.0-or-later
// Supports by hand: pins and places kept free, drawn over the contours of the layer, and the job planned again with them.
"use strict";

// of: the supports as the server has them; changes: what is not planned yet, in order; held: the pin chosen; cursor: of
// the keyboard; drag: what the pointer does; before: what preflight found of the plan that is being replaced.
const pins = { job: null, of: null, changes: [], chosen: null, cursor: null, drag: null, before: null, layer: 0 };
const kReach_px = 14;
const tips = { light: ["--tip-light", 5], medium: ["--tip-medium", 7], heavy: ["--tip-heavy", 9] };

const isEditing = () => byId("supports-box").open && pins.of !== null && pins.job === state.chosen && Boolean(site.view);
const shownLayer = () => Number(byId("layer").value);
const partLayer = () => shownLayer() - pins.of.elevation_layers;
// What is changed while a plan is made would be lost with it.
const mayChange = () => isEditing() && chosenJob()?.state !== "planning";
const mayPlan = () => chosenJob()?.state === "awaiting-approval";
const near = (a, b) => Math.hypot(a.x_mm - b.x_mm, a.y_mm - b.y_mm);
const at = (p) => `(${p.x_mm.toFixed(2)}, ${p.y_mm.toFixed(2)}) mm`;
// What holds the first material at or above it: a quarter of a layer below the middle of the layer meant.
const heightOf = (layer) => (layer + 0.25) * pins.of.thickness_mm;

// The pins as they would be: those of the plan, with the changes.
function pinsNow() {
  let list = pins.of.anchors;
  for (const change of pins.changes) {
    if (change.pin) list = list.filter((pin) => pin !== change.pin);
    if (change.to) list = list.concat(change.to);
  }
  return list;
}

function keptFreeNow() {
  let list = pins.of.hand.forbidden;
  for (const change of pins.changes) {
    if (change.free) list = list.filter((disc) => disc !== change.free);
    if (change.keep) list = list.concat(change.keep);
  }
  return list;
}

// The whole list for the server. A pin by hand that goes is no longer asked for; one of the planner's is removed.
function handList() {
  const extra = [...pins.of.hand.extra], removed = [...pins.of.hand.removed];
  const asked = (pin) => extra.reduce((best, e, i) => {
    const fits = near(e, pin) < 1e-5 && e.z_mm <= pin.z_mm + 1e-6;
    return fits && (best < 0 || e.z_mm > extra[best].z_mm) ? i : best;
  }, -1);
  const ask = ({ x_mm, y_mm, part_layer }) => ({ x_mm, y_mm, z_mm: heightOf(part_layer) });
  for (const { pin, to } of pins.changes) {
    if (pin?.by_hand && asked(pin) >= 0) extra.splice(asked(pin), 1);
    else if (pin && !pin.by_hand) removed.push({ x_mm: pin.x_mm, y_mm: pin.y_mm, part_layer: pin.part_layer });
    if (to) extra.push(ask(to));
  }
  return { extra, forbidden: keptFreeNow(), removed };
}

// Keys in one order, for comparing.
const textOf = (list) => JSON.stringify(list, ["extra", "forbidden", "removed", "x_mm", "y_mm", "z_mm", "radius_mm", "from_z_mm", "to_z_mm", "part_layer"]);

const tell = (text) => (byId("supports-answer").textContent = text);

function nameOf(change) {
  if (change.keep) return `keep ${change.keep.radius_mm} mm around ${at(change.keep)} free`;
  if (change.free) return `no longer keep ${at(change.free)} free`;
  const layer = (pin) => pin.part_layer + pins.of.elevation_layers;
  if (!change.to) return `remove the pin at ${at(change.pin)}, layer ${layer(change.pin)}`;
  if (!change.pin) return `add a pin at ${at(change.to)}, layer ${layer(change.to)}`;
  return `move the pin at ${at(change.pin)} to ${at(change.to)}, layer ${layer(change.to)}`;
}

function showButtons() {
  byId("undo").disabled = pins.changes.length === 0 || !mayChange();
  byId("remove-pin").disabled = !pins.chosen || !mayChange();
  byId("plan-again").disabled = pins.changes.length === 0 || !mayPlan();
  byId("plan-again").title = mayPlan() ? "" : "Only a job that waits for approval is planned again.";
}

function showChanges() {
  byId("changes").replaceChildren(...pins.changes.map((change) => element("li", nameOf(change))));
  showButtons();
  if (pins.of) {
    const here = pinsNow().filter((pin) => pin.part_layer === partLayer()).length;
    byId("pin-count").textContent = `${pinsNow().length} ${pinsNow().length === 1 ? "pin" : "pins"}, ${here} of them in this layer`;
  }
  site.redraw();
}

function change(what) {
  pins.changes.push(what);
  pins.chosen = null;
  tell(nameOf(what));
  showChanges();
}

// ---- drawing -------------------------------------------------------------------------------------------------------

site.drawOver = (pen) => {
  if (!isEditing()) return;
  const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(name);
  const { x, y, scale } = site.view, height = (partLayer() + 0.5) * pins.of.thickness_mm;
  const dot = (p, radius) => {
    pen.beginPath();
    pen.arc(x([p.x_mm, p.y_mm]), y([p.x_mm, p.y_mm]), radius, 0, 2 * Math.PI);
  };
  pen.lineWidth = 2;
  for (const disc of keptFreeNow().concat(pins.drag?.keep ?? [])) {
    if (height < disc.from_z_mm || height > disc.to_z_mm) continue;
    dot(disc, disc.radius_mm * scale);
    pen.globalAlpha = 0.25;
    pen.fillStyle = pen.strokeStyle = colour("--danger");
    pen.fill();
    pen.globalAlpha = 1;
    pen.stroke();
  }
  for (const pin of pinsNow()) {
    const isHere = pin.part_layer === partLayer(), [name, radius] = tips[pin.tip] ?? tips.light;
    dot(pins.drag?.pin === pin && pins.drag.to ? pins.drag.to : pin, isHere ? radius + 2 : radius / 2);
    pen.globalAlpha = isHere ? 1 : 0.45;
    pen.fillStyle = colour(name);
    pen.fill();
    pen.globalAlpha = 1;
    if (!isHere && pin !== pins.chosen) continue;
    pen.strokeStyle = colour(pin === pins.chosen ? "--ink" : "--paper");
    pen.lineWidth = pin === pins.chosen ? 4 : 2;
    pen.stroke();
  }
  if (!pins.cursor || document.activeElement !== byId("contours")) return;
  const cx = x([pins.cursor.x_mm, pins.cursor.y_mm]), cy = y([pins.cursor.x_mm, pins.cursor.y_mm]);
  pen.strokeStyle = colour("--ink");
  pen.lineWidth = 1.5;
  pen.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    pen.moveTo(cx + 4 * dx, cy + 4 * dy);
    pen.lineTo(cx + 12 * dx, cy + 12 * dy);
  }
  pen.stroke();
};

// ---- what is where -------------------------------------------------------------------------------------------------

function isInside(rings, p) {
  let turns = 0;
  for (const ring of rings)
    ring.forEach((a, i) => {
      const b = ring[(i + 1) % ring.length];
      const side = (b[0] - a[0]) * (p.y_mm - a[1]) - (p.x_mm - a[0]) * (b[1] - a[1]);
      if (a[1] <= p.y_mm && b[1] > p.y_mm && side > 0) ++turns;
      if (a[1] > p.y_mm && b[1] <= p.y_mm && side < 0) --turns;
    });
  return turns !== 0;
}

// Of the layer shown first: those of others are small, and in the way.
function pinAt(p, reach_mm) {
  let best = null;
  for (const pin of pinsNow()) {
    const reach = pin.part_layer === partLayer() ? reach_mm : reach_mm / 3;
    if (near(pin, p) > reach) continue;
    const rank = (q) => near(q, p) + (q.part_layer === partLayer() ? 0 : reach_mm);
    if (!best || rank(pin) < rank(best)) best = pin;
  }
  return best;
}

// Why no pin can end there; empty where one can.
async function whyNoPin(p) {
  const layer = shownLayer();
  if (partLayer() < 0) return "There is no part in this layer: it is below the part.";
  if (!isInside(site.view.layer.part, p)) return "There is no part here to hold: a pin ends in the part, green.";
  if (layer === 0) return "The part stands on the platform here.";
  if (partLayer() === 0) return "";
  const below = await get(`/v1/jobs/${state.chosen}/layers/${layer - 1}`);
  return isInside(below.part, p) ? "The part goes on below this place: show the layer of its underside." : "";
}

async function addPin(p, from) {
  const layer = partLayer();
  try {
    const why = await whyNoPin(p);
    if (why) return tell(why), showChanges();
  } catch (error) {
    return tell(error.message);
  }
  const to = { x_mm: p.x_mm, y_mm: p.y_mm, part_layer: layer, z_mm: heightOf(layer), tip: from?.tip ?? "light", on_part: false, by_hand: true };
  const index = pins.changes.findIndex((each) => each.to === from && from);
  if (index < 0) return change(from ? { pin: from, to } : { to });
  // A pin that was not planned yet is moved as often as one likes: the change stays one.
  pins.changes[index] = { ...pins.changes[index], to };
  pins.chosen = to;
  tell(nameOf(pins.changes[index]));
  showChanges();
}

function removePin(pin) {
  const index = pins.changes.findIndex((each) => each.to === pin);
  if (index < 0) return change({ pin });
  const { pin: planned } = pins.changes.splice(index, 1)[0];
  if (planned) return change({ pin: planned });
  pins.chosen = null;
  tell("That pin is no longer added.");
  showChanges();
}

function removeAt(p) {
  const pin = pins.chosen ?? pinAt(p, kReach_px / site.view.scale);
  if (pin) return removePin(pin);
  const disc = keptFreeNow().find((each) => near(each, p) <= each.radius_mm);
  if (disc) return change({ free: disc });
  tell("There is no pin and no place kept free here.");
}

function keptFree(p) {
  const radius_mm = Number(byId("keep-radius").value);
  if (!(radius_mm > 0)) return null;
  const t = pins.of.thickness_mm, isAll = byId("keep-height").value === "all";
  return { x_mm: p.x_mm, y_mm: p.y_mm, radius_mm,
           from_z_mm: isAll ? 0 : partLayer() * t, to_z_mm: (isAll ? chosenJob().layers : partLayer() + 1) * t };
}

// ---- pointer and keys ----------------------------------------------------------------------------------------------

function placeOf(event) {
  const canvas = byId("contours"), box = canvas.getBoundingClientRect();
  const [x_mm, y_mm] = site.view.toMm((event.clientX - box.left) * canvas.width / box.width, (event.clientY - box.top) * canvas.height / box.height);
  return { x_mm, y_mm };
}

// A finger is wider than the picture is shrunk.
const reachOf = () => (kReach_px * Math.max(1, byId("contours").width / byId("contours").clientWidth)) / site.view.scale;

byId("contours").onpointerdown = (event) => {
  if (!mayChange() || event.button !== 0) return;
  event.preventDefault();
  const p = placeOf(event);
  byId("contours").focus({ preventScroll: true });
  byId("contours").setPointerCapture(event.pointerId);
  pins.cursor = p;
  if (event.shiftKey || byId("tool").value === "keep") pins.drag = { keep: [keptFree(p)].filter(Boolean) };
  else pins.drag = { from: p, pin: pinAt(p, reachOf()) };
  pins.chosen = pins.drag.pin ?? null;
  showChanges();
};

byId("contours").onpointermove = (event) => {
  if (!pins.drag || !mayChange()) return;
  const p = placeOf(event);
  if (pins.drag.keep) {
    // A stroke: the next disc where the last one is left behind.
    const last = pins.drag.keep.at(-1);
    if (last && near(last, p) >= last.radius_mm) pins.drag.keep.push(keptFree(p));
  } else if (pins.drag.pin && (pins.drag.to || near(p, pins.drag.from) > reachOf() / 3)) {
    pins.drag.to = p;
  }
  site.redraw();
};

byId("contours").onpointercancel = () => {
  pins.drag = null;
  site.redraw();
};

byId("contours").onpointerup = (event) => {
  const drag = pins.drag;
  pins.drag = null;
  if (!drag || !mayChange()) return;
  if (drag.keep) return drag.keep.length ? drag.keep.forEach((keep) => change({ keep })) : tell("The radius must be above 0.");
  if (drag.to) return addPin(drag.to, drag.pin);
  if (!drag.pin) return addPin(placeOf(event));
  tell(`Pin at ${at(drag.pin)}, ${drag.pin.tip} tip${drag.pin.on_part ? ", on the part" : ""}${drag.pin.by_hand ? ", by hand" : ""}.`);
  if (drag.pin.part_layer !== partLayer()) showLayerOf(drag.pin);
};

function showLayerOf(pin) {
  byId("layer").value = pin.part_layer + pins.of.elevation_layers;
  byId("layer").oninput();
}

function choosePin(step) {
  const list = pinsNow();
  if (!list.length) return tell("There is no pin.");
  const next = (list.indexOf(pins.chosen) + step + list.length) % list.length;
  pins.chosen = list[pins.chosen ? next : step > 0 ? 0 : list.length - 1];
  pins.cursor = { x_mm: pins.chosen.x_mm, y_mm: pins.chosen.y_mm };
  tell(`Pin at ${at(pins.chosen)}, ${pins.chosen.tip} tip, layer ${pins.chosen.part_layer + pins.of.elevation_layers}.`);
  showLayerOf(pins.chosen);
}

byId("contours").onkeydown = (event) => {
  if (!mayChange()) return;
  const step = (event.shiftKey ? 20 : 4) / site.view.scale;
  pins.cursor ??= { x_mm: site.view.middle[0], y_mm: site.view.middle[1] };
  const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  if (ways[event.key]) {
    pins.cursor = { x_mm: pins.cursor.x_mm + ways[event.key][0] * step, y_mm: pins.cursor.y_mm + ways[event.key][1] * step };
    if (!event.ctrlKey) pins.chosen = null;
    tell(`At ${at(pins.cursor)}.`);
    showChanges();
  } else if (event.key === "Enter" && (event.shiftKey || byId("tool").value === "keep")) {
    const keep = keptFree(pins.cursor);
    if (keep) change({ keep });
    else tell("The radius must be above 0.");
  } else if (event.key === "Enter") {
    addPin(pins.cursor, pins.chosen && near(pins.chosen, pins.cursor) > 1e-6 ? pins.chosen : undefined);
  } else if (event.key === "Delete" || event.key === "Backspace") {
    removeAt(pins.cursor);
  } else if (event.key === "n" || event.key === "p") {
    choosePin(event.key === "n" ? 1 : -1);
  } else if (event.key === "z" && event.ctrlKey) {
    undo();
  } else {
    return;
  }
  event.preventDefault();
};
byId("contours").onfocus = byId("contours").onblur = () => site.redraw();

function undo() {
  const last = pins.changes.pop();
  pins.chosen = null;
  tell(last ? `Taken back: ${nameOf(last)}` : "There is nothing to take back.");
  showChanges();
}
byId("undo").onclick = undo;
byId("remove-pin").onclick = () => pins.chosen && removePin(pins.chosen);

// ---- the plan ------------------------------------------------------------------------------------------------------

async function load() {
  const id = state.chosen;
  pins.of = null;
  pins.changes = [];
  pins.chosen = pins.drag = null;
  pins.job = id;
  try {
    const of = await get(`/v1/jobs/${id}/supports`);
    if (id !== state.chosen) return;
    pins.of = of;
  } catch (error) {
    if (id === state.chosen) tell(error.message);
  }
  byId("contours").tabIndex = isEditing() ? 0 : -1;
  byId("contours").classList.toggle("edited", isEditing());
  showChanges();
}

byId("supports-box").ontoggle = () => {
  if (byId("supports-box").open) return load();
  byId("contours").tabIndex = -1;
  byId("contours").classList.remove("edited");
  site.redraw();
};

const itemsOf = async (id) => (await get(`/v1/jobs/${id}/preflight`)).items;

byId("plan-again").onclick = async () => {
  const id = state.chosen;
  if (state.visitor.may !== "operator")
    return askToSignIn(state.visitor.name ? `${state.visitor.name} may look and change nothing.` : "Sign in, then plan again.");
  try {
    const asked = textOf(handList());
    const before = { id, asked, items: await itemsOf(id), pins: pins.of.anchors.length };
    const answer = await fetch(`/v1/jobs/${id}/supports`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: asked });
    if (answer.status === 401) {
      await findVisitor();
      return askToSignIn("Sign in, then plan again.");
    }
    if (!answer.ok) throw new Error((await answer.json()).error.what);
    pins.before = before;
    pins.layer = shownLayer();
    byId("differences").replaceChildren();
    tell("The job is planned again.");
  } catch (error) {
    tell(error.message);
  }
};

// While it is planned: how far. Called for every change of the job.
site.showPlanning = (job) => {
  const isPlanning = job.state === "planning";
  byId("planning").hidden = !isPlanning;
  byId("planning-progress").value = job.progress;
  showButtons();
};

// The job has come to another state: where it is planned now, what that changed.
site.showPlanned = async (job) => {
  if (pins.before && pins.before.id !== job.id) pins.before = null;
  if (job.state === "planning") return;
  const before = pins.before;
  pins.before = null;
  if (before && job.layers) {
    byId("follow").checked = false;
    byId("layer").value = Math.min(pins.layer, job.layers - 1);
  }
  if (!byId("supports-box").open) return;
  await load();
  if (!before || !pins.of) return;
  // With another list than the one asked for there is the plan of before, and the job says why.
  if (textOf(pins.of.hand) !== before.asked) return tell(`No plan was made with these supports. ${job.message}`);
  const after = await itemsOf(job.id).catch(() => []);
  const lines = [];
  for (const item of after) {
    const was = before.items.find((each) => each.name === item.name);
    if (was && was.verdict === item.verdict && was.text === item.text) continue;
    const line = element("li", "");
    line.className = item.verdict;
    line.append(element("b", item.name), element("span", `${was ? `${was.verdict}: ${was.text}` : "not asked"} → `), element("span", `${item.verdict}: ${item.text}`));
    lines.push(line);
  }
  byId("differences").replaceChildren(...lines);
  tell(`Planned: ${before.pins} pins before, ${pins.of.anchors.length} now; ${lines.length ? "what preflight finds has changed:" : "preflight finds what it found before."}`);
};
