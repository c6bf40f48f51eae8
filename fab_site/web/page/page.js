// SPDX-License-Identifier: GPL-3.0-or-later
// The fab's page: layers, masks, preflight and doses of a job, beside what jobs.js shows of every job.
"use strict";

site.showJob = (job) => {
  const where = job.instance ? `on ${job.instance}` : `for ${job.machine}`;
  byId("job-line").textContent = `${job.state} ${where}, job ${job.id}, ${job.bytes_received} bytes received`;
  byId("job-progress").value = job.progress;
  const count = job.layers ? `layer ${job.layers_printed} of ${job.layers}` : `${job.layers_received} layers received`;
  byId("job-count").textContent = [count, duration(job.seconds_left)].filter(Boolean).join(", ");
  const slider = byId("layer");
  slider.max = Math.max(0, job.layers - 1);
  slider.disabled = job.layers === 0;
  if (byId("follow").checked && job.layers) slider.value = Math.max(0, Math.min(job.layers_printed, job.layers - 1));
  if (job.layers) showLayer();
  site.showPlanning?.(job);
};

site.chosen = (id) => {
  state.layer = "";
  site.view = null;
  byId("accuracy-box").hidden = true;
  document.dispatchEvent(new CustomEvent("job-chosen"));
};

// What the plan says does not change with every layer, but it may have been planned again.
site.showStage = async (job) => {
  ++state.plan;
  state.layer = "";
  await site.showPlanned?.(job);
  if (job.id !== state.chosen) return;
  if (job.layers) showLayer();
  byId("preview").src = `/v1/jobs/${job.id}/preview.png?plan=${state.plan}`;
  showPreflight(job.id);
  showDose(job.id);
  showAccuracy(job.id);
  try {
    byId("report").textContent = JSON.stringify(await get(`/v1/jobs/${job.id}/report`), null, 1);
  } catch (error) {
    byId("report").textContent = error.message;
  }
};

state.plan = 0;

function draw(layer) {
  const canvas = byId("contours"), pen = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const rings = layer.part.concat(layer.supports);
  const box = layer.bounds;
  const scale = Math.min(canvas.width / (box[2] - box[0]), canvas.height / (box[3] - box[1])) * 0.95;
  const x = (p) => canvas.width / 2 + (p[0] - (box[0] + box[2]) / 2) * scale;
  const y = (p) => canvas.height / 2 - (p[1] - (box[1] + box[3]) / 2) * scale;
  const middle = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const toMm = (px, py) => [middle[0] + (px - canvas.width / 2) / scale, middle[1] - (py - canvas.height / 2) / scale];
  site.view = { layer, x, y, scale, middle, toMm };
  if (!rings.length) return site.drawOver?.(pen);
  for (const [set, colour] of [[layer.supports, "--support"], [layer.part, "--part"]]) {
    pen.beginPath();
    for (const ring of set) {
      ring.forEach((p, i) => (i ? pen.lineTo(x(p), y(p)) : pen.moveTo(x(p), y(p))));
      pen.closePath();
    }
    pen.fillStyle = style.getPropertyValue(colour);
    pen.fill("nonzero");
  }
  site.drawOver?.(pen);
}

site.redraw = () => site.view && draw(site.view.layer);

async function showLayer() {
  const layer = Number(byId("layer").value);
  byId("layer-number").textContent = `${layer}`;
  const key = `${state.chosen}/${layer}`;
  if (state.layer === key) return;
  state.layer = key;
  const base = `/v1/jobs/${state.chosen}/layers/${layer}`;
  byId("mask").src = `${base}/mask.png?plan=${state.plan}`;
  try {
    const shape = await get(base);
    if (state.layer !== key) return;  // the slider has moved on
    draw(shape);
    state.drawn = key;
    state.drawnAt = performance.now();
    byId("certificate").textContent = shape.certificate ? `· ${shape.certificate}` : "";
  } catch (error) {
    byId("certificate").textContent = `· ${error.message}`;
  }
}

async function showPreflight(id) {
  let list = [];
  try {
    list = (await get(`/v1/jobs/${id}/preflight`)).items;
  } catch {
    // Not planned yet: there is nothing to show.
  }
  if (id !== state.chosen) return;
  byId("preflight-box").hidden = list.length === 0;
  byId("preflight").replaceChildren(...list.map((each) => {
    const item = document.createElement("li");
    item.className = each.verdict;
    item.append(element("b", each.verdict.replace("-", " ")), element("span", each.name), element("span", each.text));
    return item;
  }));
}

// Computed in the background once the job is planned: asked for again until it is there.
async function showAccuracy(id) {
  const box = byId("accuracy-box"), url = `/v1/jobs/${id}/accuracy.png?plan=${state.plan}`;
  const isThere = await fetch(url, { method: "HEAD" }).then((answer) => answer.ok, () => false);
  if (id !== state.chosen) return;
  clearTimeout(state.accuracyTimer);
  box.hidden = !isThere;
  if (isThere) byId("accuracy").src = url;
  else state.accuracyTimer = setTimeout(() => id === state.chosen && showAccuracy(id), 10000);
}

// One step curve: value of layer i from i to i + 1. Nulls leave a gap.
function drawSteps(pen, values, count, top, colour) {
  const { width, height } = pen.canvas;
  pen.beginPath();
  let down = false;
  values.forEach((value, i) => {
    if (value === null) return (down = false);
    const y = height - 4 - (height - 8) * (value / top);
    if (down) pen.lineTo((i / count) * width, y);
    else pen.moveTo((i / count) * width, y);
    pen.lineTo(((i + 1) / count) * width, y);
    down = true;
  });
  pen.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue(colour);
  pen.lineWidth = 2;
  pen.stroke();
}

async function showDose(id) {
  let light = { planned_s: [] };
  try {
    light = await get(`/v1/jobs/${id}/exposures`);
  } catch {
    // Not planned yet: there is nothing to show.
  }
  if (id !== state.chosen) return;
  const planned = light.planned_s;
  byId("dose-box").hidden = planned.length === 0;
  if (!planned.length) return;
  const pen = byId("dose").getContext("2d");
  pen.clearRect(0, 0, pen.canvas.width, pen.canvas.height);
  const most = Math.max(...planned, ...light.measured_s.map((s) => s ?? 0), 1e-9);
  drawSteps(pen, planned, planned.length, most, "--quiet");
  drawSteps(pen, light.measured_s, planned.length, most, "--part");
  const heat = light.resin_celsius.filter((t) => t !== null);
  if (heat.length) drawSteps(pen, light.resin_celsius, planned.length, 60, "--danger");
  const dose = (layer) => `${(planned[layer] * light.light_share[layer] * light.irradiance_mw_per_cm2).toFixed(1)} mJ/cm²`;
  byId("dose-text").textContent = `at full grey: first layer ${dose(0)}, last ${dose(planned.length - 1)}; ${light.measured_s.filter((s) => s !== null).length} of ${planned.length} layers measured` +
    (heat.length ? `; resin ${Math.min(...heat).toFixed(1)} to ${Math.max(...heat).toFixed(1)} °C` : "");
}

async function showDevices() {
  try {
    const devices = await get("/v1/devices");
    byId("devices").replaceChildren(...Object.entries(devices).flatMap(([k, v]) => [element("dt", k.replaceAll("_", " ")), element("dd", String(v))]));
  } catch (error) {
    byId("devices").replaceChildren(element("dt", "state"), element("dd", error.message));
  }
}

// What stands in the fab: those that it lists, and of those that are only known as profiles what is in use.
function shownMachines(machines) {
  return machines.filter((m) => m.stated || m.state !== "idle" || m.waiting > 0 || machines.length <= 6);
}

function machineTile(machine) {
  const tile = document.createElement("li");
  tile.dataset.state = machine.state;
  const name = element("b", machine.name);
  const mark = element("span", machine.state);
  mark.className = "mark";
  const head = document.createElement("p");
  head.append(name, mark);
  tile.append(head);
  if (machine.job) {
    const job = element("button", machine.job_name || machine.job);
    job.className = "job";
    job.dataset.machine = machine.name;
    job.disabled = !state.jobs.some((each) => each.id === machine.job);
    job.onclick = () => choose(machine.job);
    tile.append(job);
  }
  if (machine.layers && machine.state !== "occupied") {
    const bar = document.createElement("progress");
    bar.max = machine.layers;
    bar.value = machine.layer;
    bar.setAttribute("aria-label", `Progress on ${machine.name}`);
    tile.append(bar, element("small", [`layer ${machine.layer} of ${machine.layers}`, duration(machine.seconds_left)].filter(Boolean).join(", ")));
  }
  const of = machine.profile === machine.name ? "" : `${machine.profile}, `;
  const waiting = machine.waiting ? `, ${machine.waiting} waiting` : "";
  tile.append(element("small", `${of}${machine.resin}${waiting}`));
  if (machine.message) tile.append(element("small", machine.message));
  if (["occupied", "fault", "offline"].includes(machine.state) && (machine.state === "occupied" || !machine.job)) {
    const cleared = element("button", machine.state === "occupied" ? "The platform is empty" : "It is ready again");
    cleared.onclick = () => act("cleared", undefined, machine.name);
    tile.append(cleared);
  }
  return tile;
}

site.news = ({ machines = [] }) => {
  const shown = shownMachines(machines);
  const text = JSON.stringify(shown) + state.jobs.map((job) => job.id);
  if (state.machines === text) return;  // a tile that is being clicked is not replaced for nothing
  state.machines = text;
  const focused = document.activeElement?.dataset.machine;
  byId("machines-box").hidden = shown.length === 0;
  byId("machines").replaceChildren(...shown.map(machineTile));
  if (focused) byId("machines").querySelector(`[data-machine="${focused}"]`)?.focus();
};

byId("layer").oninput = () => {
  byId("follow").checked = false;
  showLayer();
};

// The job waits for approval as any that was sent without a word of starting it.
byId("file-form").onsubmit = async (event) => {
  event.preventDefault();
  const [file] = byId("file").files, say = (text) => (byId("file-answer").textContent = text);
  if (state.visitor.may !== "operator") return askToSignIn(state.visitor.name ? `${state.visitor.name} may look and change nothing.` : "");
  say(`sending ${file.name}`);
  try {
    const answer = await fetch(`/v1/files/${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    const body = await answer.json();
    if (!answer.ok) return say(body.error.what);
    say(`${file.name} is job ${body.id}`);
    byId("file-form").reset();
  } catch (error) {
    say(error.message);
  }
};

site.begun = showDevices;
begin();
