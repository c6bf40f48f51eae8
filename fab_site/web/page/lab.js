// SPDX-License-Identifier: GPL-3.0-or-later
// The lab around the job that is looked at: what each machine does now, what waits, what was made.
"use strict";

// Children of `list`, one for each item by its key; those that are there already stay, so that focus and pictures do.
function keepList(list, items, keyOf, fill) {
  const there = new Map([...list.children].map((child) => [child.dataset.key, child]));
  const wanted = items.map((item) => {
    const child = there.get(keyOf(item)) || document.createElement("li");
    child.dataset.key = keyOf(item);
    const text = JSON.stringify(item);
    if (child.shows !== text) fill(child, item);
    child.shows = text;
    return child;
  });
  if (wanted.length !== list.children.length || wanted.some((child, i) => child !== list.children[i])) {
    const focused = document.activeElement;
    list.replaceChildren(...wanted);
    if (list.contains(focused)) focused.focus();
  }
}

// The child of a class, made where there is none.
function part(of, name, kind) {
  let child = of.querySelector(`:scope > .${kind}, :scope > * > .${kind}`);
  if (!child) {
    child = document.createElement(name);
    child.className = kind;
    of.append(child);
  }
  return child;
}

// A picture that is only there where the server has one.
function showPicture(image, source) {
  if (source && image.getAttribute("src") === source) return;  // hidden where it did not come
  image.hidden = !source;
  if (!source) return;
  image.onerror = () => (image.hidden = true);
  image.src = source;
}

const viewOf = (job) => (job?.layers ? `/v1/jobs/${job.id}/view.png?plan=${job.planned_unix_ms}` : "");

function clock(seconds) {
  return seconds === null || seconds < 0 ? "" : duration(seconds).replace(" left", "");
}

const clockTime = (unix_s) => new Date(unix_s * 1000).toLocaleString([], { dateStyle: "short", timeStyle: "short" });

// ---- machines -----------------------------------------------------------------------------------------------------

// What stands in the fab: those that it lists, and of those that are only known as profiles what is in use.
function shownMachines(machines) {
  return machines.filter((m) => m.stated || m.state !== "idle" || m.waiting > 0 || machines.length <= 6);
}

// "exposing, light on": one word of the print machine, and whether light is on, which nobody should have to guess.
function momentOf(machine) {
  if (!machine.now || machine.state === "occupied") return "";
  const { phase, light, z_mm, resin_celsius } = machine.now;
  return [phase.replaceAll("-", " "), light ? "light on" : "dark", z_mm === null ? "" : `z ${z_mm.toFixed(2)} mm`, resin_celsius === null ? "" : `resin ${resin_celsius.toFixed(1)} °C`]
    .filter(Boolean).join(" · ");
}

function resinOf(machine, job) {
  const waiting = machine.waiting ? `, ${machine.waiting} waiting` : "";
  const of = machine.profile === machine.name ? "" : `${machine.profile}, `;
  const left = job && job.resin_ml && machine.layers && machine.state !== "occupied"
    ? `, about ${(job.resin_ml * (1 - machine.layer / machine.layers)).toFixed(1)} of ${job.resin_ml.toFixed(1)} ml still to cure` : "";
  return `${of}resin ${machine.resin}${left}${waiting}`;
}

function fillMachine(tile, { machine, job }) {
  tile.dataset.state = machine.state;
  const focused = tile.contains(document.activeElement) ? document.activeElement.className : null;
  const head = document.createElement("p"), mark = element("span", machine.state);
  mark.className = "mark";
  head.append(element("b", machine.name), mark);
  // Pictures stay, all else is made again.
  const pictures = part(tile, "div", "pictures"), view = part(pictures, "img", "view"), mask = part(pictures, "img", "mask");
  view.alt = "The print", mask.alt = "The mask of its layer";
  showPicture(view, viewOf(job));
  const isPrinting = job && machine.layers && machine.layer < machine.layers && ["printing", "paused"].includes(machine.state);
  showPicture(mask, isPrinting ? `/v1/jobs/${job.id}/layers/${machine.layer}/mask.png?plan=${job.planned_unix_ms}` : "");
  pictures.hidden = view.hidden && mask.hidden;
  const rows = [head, pictures];
  if (machine.job) {
    const shown = element("button", machine.job_name || machine.job);
    shown.className = "job";
    shown.dataset.machine = machine.name;
    shown.disabled = !job;
    shown.title = job ? "" : "The job was forgotten.";
    shown.onclick = () => choose(machine.job);
    rows.push(shown);
  }
  if (machine.layers && machine.state !== "occupied") {
    const bar = document.createElement("progress");
    bar.max = machine.layers;
    bar.value = machine.layer;
    bar.setAttribute("aria-label", `Progress on ${machine.name}`);
    rows.push(bar, element("small", [`layer ${machine.layer} of ${machine.layers}`, duration(machine.seconds_left)].filter(Boolean).join(", ")));
  }
  const moment = element("small", momentOf(machine));
  moment.className = "moment";
  if (machine.now?.light) moment.classList.add("light");
  if (moment.textContent) rows.push(moment);
  rows.push(element("small", resinOf(machine, job)));
  if (machine.message) rows.push(element("small", machine.message));
  if (["occupied", "fault", "offline"].includes(machine.state) && (machine.state === "occupied" || !machine.job)) {
    const cleared = element("button", machine.state === "occupied" ? "The platform is empty" : "It is ready again");
    cleared.className = "cleared";
    cleared.onclick = () => act("cleared", undefined, machine.name);
    rows.push(cleared);
  }
  tile.replaceChildren(...rows);
  if (focused) tile.querySelector(`.${focused}`)?.focus();
}

site.news = ({ machines = [] }) => {
  const shown = shownMachines(machines);
  byId("machines-box").hidden = shown.length === 0;
  keepList(byId("machines"), shown.map((machine) => ({ machine, job: jobOf(machine.job) })),
    ({ machine }) => machine.name, fillMachine);
};

// ---- jobs ---------------------------------------------------------------------------------------------------------

// What is made first stands first: what is on a machine, then what may go there, then what is still planned or sent.
const stages = ["printing", "paused", "ready", "awaiting-approval", "planning", "sending"];
function queued() {
  return state.jobs.filter((job) => !hasEnded(job.state))
    .sort((a, b) => stages.indexOf(a.state) - stages.indexOf(b.state) || a.created_unix_s - b.created_unix_s);
}

site.pastStates = "done,failed,cancelled";
site.lists = (job) => hasEnded(job.state);

function timesOf(job) {
  if (["printing", "paused"].includes(job.state)) return duration(job.seconds_left);
  return job.print_seconds ? `${clock(job.print_seconds)} of print` : "";
}

function fillJob(item, { job, isChosen }) {
  let button = item.querySelector("button");
  if (!button) {
    button = document.createElement("button");
    button.dataset.job = job.id;
    button.onclick = () => choose(job.id);
    const image = document.createElement("img");
    image.className = "view";
    image.alt = "";
    button.append(image, document.createElement("span"));
    item.append(button);
  }
  button.setAttribute("aria-current", String(isChosen));
  showPicture(button.querySelector("img"), viewOf(job));
  button.querySelector("span").replaceChildren(
    element("b", job.name || job.id),
    element("small", [job.state.replaceAll("-", " "), job.instance || job.machine, timesOf(job)].filter(Boolean).join(", ")),
    element("small", [job.owner, clockTime(job.created_unix_s)].filter(Boolean).join(", ")));
}

site.showJobs = () => {
  const rows = (jobs) => jobs.map((job) => ({ job, isChosen: job.id === state.chosen }));
  const waiting = queued(), old = foundJobs();
  keepList(byId("queue"), rows(waiting), ({ job }) => job.id, fillJob);
  keepList(byId("history"), rows(old), ({ job }) => job.id, fillJob);
  byId("no-jobs").hidden = state.jobs.length > 0;
  byId("no-queue").hidden = waiting.length > 0 || state.jobs.length === 0;
  byId("history-box").hidden = !old.length && !searchWords();
  showPast(old.length);
};
