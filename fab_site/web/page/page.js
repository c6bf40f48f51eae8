// The fab's page: shows what /v1 says, live by server-sent events. No library, no outside request.
"use strict";

const byId = (id) => document.getElementById(id);
const state = { jobs: [], chosen: null, layer: -1, token: sessionStorage.getItem("token") || "", waiting: null, stage: "" };

const allowed = {
  approve: (s) => s === "ready",
  pause: (s) => s === "printing",
  resume: (s) => s === "paused",
  cancel: (s) => !["done", "failed", "cancelled"].includes(s),
};

function duration(seconds) {
  if (seconds === null || seconds < 0) return "";
  const h = Math.floor(seconds / 3600), m = Math.floor(seconds / 60) % 60, s = Math.round(seconds % 60);
  return h ? `${h} h ${m} min left` : m ? `${m} min ${s} s left` : `${s} s left`;
}

async function get(path) {
  const answer = await fetch(path);
  const body = await answer.json();
  if (!answer.ok) throw new Error(body.error ? body.error.what : answer.statusText);
  return body;
}

function element(name, text) {
  const e = document.createElement(name);
  e.textContent = text;
  return e;
}

function showJobs() {
  const list = byId("jobs");
  const focused = document.activeElement && document.activeElement.dataset.job;
  list.replaceChildren(...state.jobs.map((job) => {
    const button = element("button", job.name || job.id);
    button.dataset.job = job.id;
    button.setAttribute("aria-current", String(job.id === state.chosen));
    button.append(element("small", `${job.state}, ${job.machine}`));
    button.onclick = () => choose(job.id);
    const item = document.createElement("li");
    item.append(button);
    return item;
  }));
  if (focused) list.querySelector(`[data-job="${focused}"]`)?.focus();
  byId("no-jobs").hidden = state.jobs.length > 0;
}

function showJob() {
  const job = state.jobs.find((j) => j.id === state.chosen);
  byId("job").hidden = !job;
  if (!job) return;
  byId("job-name").textContent = job.name || job.id;
  byId("job-line").textContent = `${job.state} on ${job.machine}, job ${job.id}, ${job.bytes_received} bytes received`;
  byId("job-message").hidden = !job.message;
  byId("job-message").textContent = job.message;
  byId("job-progress").value = job.progress;
  const count = job.layers ? `layer ${job.layers_printed} of ${job.layers}` : `${job.layers_received} layers received`;
  byId("job-count").textContent = [count, duration(job.seconds_left)].filter(Boolean).join(", ");
  for (const button of document.querySelectorAll("[data-action]")) button.disabled = !allowed[button.dataset.action](job.state);
  const slider = byId("layer");
  slider.max = Math.max(0, job.layers - 1);
  slider.disabled = job.layers === 0;
  if (byId("follow").checked && job.layers) slider.value = Math.max(0, Math.min(job.layers_printed, job.layers - 1));
  if (job.layers) showLayer();
}

function draw(layer) {
  const canvas = byId("contours"), pen = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const rings = layer.part.concat(layer.supports);
  if (!rings.length) return;
  const box = layer.bounds;
  const scale = Math.min(canvas.width / (box[2] - box[0]), canvas.height / (box[3] - box[1])) * 0.95;
  const x = (p) => canvas.width / 2 + (p[0] - (box[0] + box[2]) / 2) * scale;
  const y = (p) => canvas.height / 2 - (p[1] - (box[1] + box[3]) / 2) * scale;
  for (const [set, colour] of [[layer.supports, "--support"], [layer.part, "--part"]]) {
    pen.beginPath();
    for (const ring of set) {
      ring.forEach((p, i) => (i ? pen.lineTo(x(p), y(p)) : pen.moveTo(x(p), y(p))));
      pen.closePath();
    }
    pen.fillStyle = style.getPropertyValue(colour);
    pen.fill("nonzero");
  }
}

async function showLayer() {
  const layer = Number(byId("layer").value);
  byId("layer-number").textContent = `${layer}`;
  const key = `${state.chosen}/${layer}`;
  if (state.layer === key) return;
  state.layer = key;
  const base = `/v1/jobs/${state.chosen}/layers/${layer}`;
  byId("mask").src = `${base}/mask.png`;
  try {
    const shape = await get(base);
    if (state.layer !== key) return;  // the slider has moved on
    draw(shape);
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
  const dose = (s) => `${(s * light.irradiance_mw_per_cm2).toFixed(1)} mJ/cm²`;
  const last = planned[planned.length - 1];
  byId("dose-text").textContent = `at full grey: first layer ${dose(planned[0])}, last ${dose(last)}; ${light.measured_s.filter((s) => s !== null).length} of ${planned.length} layers measured` +
    (heat.length ? `; resin ${Math.min(...heat).toFixed(1)} to ${Math.max(...heat).toFixed(1)} °C` : "");
}

async function showDetails() {
  const id = state.chosen;
  if (!id) return;
  try {
    const { events } = await get(`/v1/jobs/${id}/events`);
    if (id !== state.chosen) return;
    byId("events").replaceChildren(...events.map((e) => element("li", `${new Date(e.unix_ms).toLocaleTimeString()} ${e.text}`)));
  } catch (error) {
    byId("events").replaceChildren(element("li", error.message));
  }
  // What the plan says does not change with every layer.
  const job = state.jobs.find((j) => j.id === id);
  const stage = `${id}/${job && job.state}`;
  if (state.stage === stage) return;
  state.stage = stage;
  showPreflight(id);
  showDose(id);
  try {
    byId("report").textContent = JSON.stringify(await get(`/v1/jobs/${id}/report`), null, 1);
  } catch (error) {
    byId("report").textContent = error.message;
  }
}

async function showDevices() {
  try {
    const devices = await get("/v1/devices");
    byId("devices").replaceChildren(...Object.entries(devices).flatMap(([k, v]) => [element("dt", k.replaceAll("_", " ")), element("dd", String(v))]));
  } catch (error) {
    byId("devices").replaceChildren(element("dt", "state"), element("dd", error.message));
  }
}

function choose(id) {
  state.chosen = id;
  document.dispatchEvent(new CustomEvent("job-chosen"));
  state.layer = -1;
  byId("preview").src = `/v1/jobs/${id}/preview.png`;
  showJobs();
  showJob();
  showDetails();
}

async function act(action) {
  if (!state.token) {
    state.waiting = action;
    byId("token-form").hidden = false;
    byId("token").focus();
    return;
  }
  if (action === "cancel" && !confirm("Cancel this job? The print cannot be taken up again.")) return;
  const answer = await fetch(`/v1/jobs/${state.chosen}/${action}`, { method: "POST", headers: { Authorization: `Bearer ${state.token}` } });
  if (answer.status === 401) {
    state.token = "";
    sessionStorage.removeItem("token");
    byId("answer").textContent = "This token is not the operator's.";
    return;
  }
  byId("answer").textContent = answer.ok ? `${action}: accepted` : (await answer.json()).error.what;
}

byId("token-form").onsubmit = (event) => {
  event.preventDefault();
  state.token = byId("token").value;
  sessionStorage.setItem("token", state.token);
  byId("token").value = "";
  byId("token-form").hidden = true;
  if (state.waiting) act(state.waiting);
  state.waiting = null;
};
for (const button of document.querySelectorAll("[data-action]")) button.onclick = () => act(button.dataset.action);
byId("layer").oninput = () => {
  byId("follow").checked = false;
  showLayer();
};

const stream = new EventSource("/v1/stream");
stream.onopen = () => (byId("link").textContent = "live");
stream.onerror = () => (byId("link").textContent = "connection lost, trying again");
stream.onmessage = (event) => {
  state.jobs = JSON.parse(event.data).jobs;
  if (!state.chosen && state.jobs.length) return choose(state.jobs[0].id);
  showJobs();
  showJob();
  showDetails();
  showDevices();
};
showDevices();
