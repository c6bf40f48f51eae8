// SPDX-License-Identifier: GPL-3.0-or-later
// The job that is looked at: its layers, masks, preflight, places and doses; lab.js shows what is around it.
"use strict";

site.showJob = (job) => {
  const where = job.instance ? `on ${job.instance}` : `for ${job.machine}`;
  byId("job-line").textContent = [`${job.state.replaceAll("-", " ")} ${where}`, job.owner && `by ${job.owner}`, `job ${job.id}`,
    job.print_seconds && `${clock(job.print_seconds)} of print`, job.resin_ml && `${job.resin_ml.toFixed(1)} ml`, job.cost && `${job.cost.amount.toFixed(2)} ${job.cost.currency} of resin`].filter(Boolean).join(" · ");
  byId("job-progress").value = job.progress;
  const count = job.layers ? `layer ${job.layers_printed} of ${job.layers}` : `${job.layers_received} layers received`;
  byId("job-count").textContent = [count, duration(job.seconds_left)].filter(Boolean).join(", ");
  const slider = byId("layer");
  slider.max = Math.max(0, job.layers - 1);
  slider.disabled = job.layers === 0;
  if (byId("follow").checked && job.layers) slider.value = Math.max(0, Math.min(job.layers_printed, job.layers - 1));
  if (job.layers) showLayer();
  site.showPlanning?.(job);
  showDoseLater(job);
  document.dispatchEvent(new CustomEvent("job-shown"));
};

site.chosen = (id) => {
  state.layer = "";
  site.view = null;
  state.issues = [];
  byId("accuracy-box").hidden = true;
  document.dispatchEvent(new CustomEvent("job-chosen"));
};

// What the plan says does not change with every layer, but it may have been planned again.
site.showStage = async (job) => {
  state.layer = "";
  await site.showPlanned?.(job);
  if (job.id !== state.chosen) return;
  if (job.layers) showLayer();
  byId("preview").src = `/v1/jobs/${job.id}/preview.png?plan=${planOf(job.id)}`;
  showPreflight(job.id);
  showDose(job.id);
  showAccuracy(job.id);
  let report = {}, text = "";
  try {
    report = await get(`/v1/jobs/${job.id}/report`);
    text = JSON.stringify(report, null, 1);
  } catch (error) {
    text = error.message;
  }
  if (job.id !== state.chosen) return;
  byId("report").textContent = text;
  state.issues = issuesOf(report);
  showIssues();
};

state.issues = [];

// Pictures and layers of a plan never change under an address that names it.
const planOf = (id) => jobOf(id)?.planned_unix_ms ?? 0;

// ---- one layer ----------------------------------------------------------------------------------------------------

// The longest of 1, 2, 5, 10, ... mm that is at most a quarter of the picture.
function scaleBar(mm) {
  const most = mm / 4, ten = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((n) => n * ten).find((length) => length <= most);
}

// The plate's edge and a bar of a round length.
function drawPlate(pen, layer, { x, y, scale }, style) {
  pen.strokeStyle = pen.fillStyle = style.getPropertyValue("--quiet");
  pen.lineWidth = 1.5;
  if (layer.platform_mm) {
    const [w, d] = layer.platform_mm;
    pen.strokeRect(x([0, 0]), y([0, d]), w * scale, d * scale);
  }
  const bar = scaleBar(pen.canvas.width / scale), right = pen.canvas.width - 16, low = pen.canvas.height - 16;
  pen.beginPath();
  pen.moveTo(right - bar * scale, low - 5), pen.lineTo(right - bar * scale, low), pen.lineTo(right, low), pen.lineTo(right, low - 5);
  pen.stroke();
  pen.font = "22px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.fillText(`${Number(bar.toPrecision(1))} mm`, right, low - 8);
}

function drawIssues(pen, layer, { x, y }, style) {
  pen.strokeStyle = style.getPropertyValue("--danger");
  state.issues.forEach((issue, i) => {
    if (layer.layer < issue.layer || layer.layer > issue.last) return;
    pen.lineWidth = i === state.issue ? 5 : 2.5;
    pen.beginPath();
    pen.arc(x(issue.place), y(issue.place), 11, 0, 2 * Math.PI);
    pen.stroke();
  });
}

function draw(layer) {
  const canvas = byId("contours"), pen = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const box = layer.bounds;
  const scale = Math.min(canvas.width / (box[2] - box[0]), canvas.height / (box[3] - box[1])) * 0.95;
  const x = (p) => canvas.width / 2 + (p[0] - (box[0] + box[2]) / 2) * scale;
  const y = (p) => canvas.height / 2 - (p[1] - (box[1] + box[3]) / 2) * scale;
  const middle = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const toMm = (px, py) => [middle[0] + (px - canvas.width / 2) / scale, middle[1] - (py - canvas.height / 2) / scale];
  site.view = { layer, x, y, scale, middle, toMm };
  drawPlate(pen, layer, site.view, style);
  for (const [set, colour] of [[layer.supports, "--support"], [layer.part, "--part"]]) {
    pen.beginPath();
    for (const ring of set) {
      ring.forEach((p, i) => (i ? pen.lineTo(x(p), y(p)) : pen.moveTo(x(p), y(p))));
      pen.closePath();
    }
    pen.fillStyle = style.getPropertyValue(colour);
    pen.fill("nonzero");
  }
  drawIssues(pen, layer, site.view, style);
  site.drawOver?.(pen);
}

site.redraw = () => site.view && draw(site.view.layer);

async function showLayer() {
  const layer = Number(byId("layer").value);
  const key = `${state.chosen}/${layer}`;
  if (state.layer === key) return;
  byId("layer-number").textContent = `${layer}`;
  byId("layer").setAttribute("aria-valuetext", `layer ${layer}`);
  state.layer = key;
  const id = state.chosen, plan = planOf(id);
  const shapeAt = (n) => `/v1/jobs/${id}/layers/${n}?plan=${plan}`, maskAt = (n) => `/v1/jobs/${id}/layers/${n}/mask.png?plan=${plan}`;
  byId("mask").src = maskAt(layer);
  try {
    const shape = await (plan ? held.get : get)(shapeAt(layer));
    if (state.layer !== key) return;  // the slider has moved on
    draw(shape);
    document.dispatchEvent(new CustomEvent("layer-drawn", { detail: shape }));
    state.drawn = key;
    state.drawnAt = performance.now();
    const near = [layer + 1, layer - 1, layer + 2, layer - 2].filter((n) => n >= 0 && n <= Number(byId("layer").max));
    if (plan) held.ahead(near.map(shapeAt), near.map(maskAt));
    byId("layer-number").textContent = `${layer}, z ${shape.z_mm.toFixed(2)} mm`;
    byId("certificate").textContent = shape.certificate ? `· ${shape.certificate}` : "";
  } catch (error) {
    byId("certificate").textContent = `· ${error.message}`;
  }
}

// ---- what was found -----------------------------------------------------------------------------------------------

const mm2 = (area) => `${area.toFixed(2)} mm²`;

// The places of a plan's report that somebody may want to see, what holds the job first.
function issuesOf({ plan }) {
  const issues = [];
  for (const f of plan?.check?.findings || [])
    issues.push({ holds: f.holds_the_job, text: `${f.kind.replaceAll("-", " ")}, ${mm2(f.size_mm2)}`, layer: f.layer, last: f.last_layer, place: [f.x_mm, f.y_mm] });
  for (const [weak, holds] of [[plan?.carry?.weak, true], [plan?.carry?.weak_small, false]])
    for (const w of weak?.places || [])
      issues.push({ holds, text: `may tear: ${mm2(w.section_mm2)} bear ${w.demand.toFixed(0)} times the pull`, layer: w.layer, last: w.layer, place: w.place });
  for (const t of plan?.thin?.weak || [])
    issues.push({ holds: false, text: `${t.kind} of ${t.width_mm.toFixed(2)} mm, easily lost`, layer: t.layer, last: t.layer, place: t.place });
  return issues.sort((a, b) => b.holds - a.holds || a.layer - b.layer);
}

function goTo(layer) {
  byId("follow").checked = false;
  byId("layer").value = layer;
  showLayer();
}

function showIssue(i) {
  state.issue = i;
  goTo(state.issues[i].layer);
  site.redraw();
  document.dispatchEvent(new CustomEvent("issue-chosen", { detail: state.issues[i] }));
  for (const [k, button] of byId("issues").querySelectorAll("button").entries()) button.setAttribute("aria-current", String(k === i));
}

function showIssues() {
  const most = 500, list = state.issues;
  state.issue = -1;
  byId("issues-box").hidden = list.length === 0;
  byId("issues-count").textContent = `${list.length} ${list.length === 1 ? "place" : "places"} to look at` +
    (list.some((issue) => issue.holds) ? `, ${list.filter((issue) => issue.holds).length} of them hold the job` : "");
  byId("issues").replaceChildren(...list.slice(0, most).map((issue, i) => {
    const item = document.createElement("li"), button = element("button", `layer ${issue.layer}: ${issue.text} at (${issue.place.map((v) => v.toFixed(1)).join(", ")}) mm`);
    button.onclick = () => showIssue(i);
    item.append(button);
    return item;
  }));
  site.redraw();
  document.dispatchEvent(new CustomEvent("issues-found"));
}

// A click on a mark chooses its place.
byId("contours").addEventListener("click", (event) => {
  if (!site.view || byId("supports-box").open) return;
  const canvas = byId("contours"), box = canvas.getBoundingClientRect();
  const px = (event.clientX - box.left) * (canvas.width / box.width), py = (event.clientY - box.top) * (canvas.height / box.height);
  const hit = state.issues.findIndex((issue) => site.view.layer.layer >= issue.layer && site.view.layer.layer <= issue.last &&
    Math.hypot(site.view.x(issue.place) - px, site.view.y(issue.place) - py) < 14);
  if (hit >= 0) showIssue(hit), (byId("issues-box").open = true);
});

async function showPreflight(id) {
  let list = [];
  try {
    list = (await get(`/v1/jobs/${id}/preflight`)).items;
  } catch {
    // Not planned yet: there is nothing to show.
  }
  if (id !== state.chosen) return;
  byId("preflight-box").hidden = list.length === 0;
  const matters = (item) => ["held", "warning"].includes(item.verdict);
  const rest = list.filter((item) => !matters(item)), unknown = rest.filter((item) => item.verdict === "not-known").length;
  byId("preflight").replaceChildren(...list.filter(matters).sort((a, b) => (b.verdict === "held") - (a.verdict === "held")).map(preflightItem));
  byId("preflight-passed").replaceChildren(...rest.map(preflightItem));
  byId("preflight-rest").hidden = rest.length === 0;
  byId("preflight-count").textContent = [`${rest.length - unknown} passed`, unknown && `${unknown} not known`].filter(Boolean).join(", ");
}

function preflightItem(each) {
  const item = document.createElement("li");
  item.className = each.verdict;
  item.append(element("b", each.verdict.replace("-", " ")), element("span", each.name), element("span", each.text));
  if (typeof each.layer === "number") {
    const show = element("button", "Show");
    show.setAttribute("aria-label", `Show layer ${each.layer}: ${each.name}`);
    const near = (issue) => each.place && issue.layer === each.layer && Math.hypot(issue.place[0] - each.place[0], issue.place[1] - each.place[1]) < 0.01;
    show.onclick = () => {
      const found = state.issues.findIndex(near);
      if (found >= 0) return showIssue(found);
      goTo(each.layer);
    };
    item.append(show);
  }
  return item;
}

// Computed in the background once the job is planned: asked for again until it is there.
async function showAccuracy(id) {
  const box = byId("accuracy-box"), url = `/v1/jobs/${id}/accuracy.png?plan=${planOf(id)}`;
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

// While a print goes on its doses come one by one; they are asked for every other second at most.
function showDoseLater(job) {
  if (!["printing", "paused"].includes(job.state) || state.doseOf === `${job.id}/${job.layers_printed}` || state.doseTimer) return;
  state.doseTimer = setTimeout(() => {
    state.doseTimer = null;
    state.doseOf = `${job.id}/${job.layers_printed}`;
    if (job.id === state.chosen) showDose(job.id);
  }, 2000);
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
