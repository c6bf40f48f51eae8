// SPDX-License-Identifier: GPL-3.0-or-later
// What every page of Telefab has: the list of jobs, live by server-sent events, and the operator's commands. A page's
// own script fills `site` and calls begin(). No library, no outside request.
"use strict";

const byId = (id) => document.getElementById(id);
const state = { jobs: [], chosen: null, visitor: { name: null, may: "nothing", must_sign_in: false, by: null }, waiting: null, told: "", stage: "" };

// Of the page itself: showJob(job) for every change, showStage(job) once a state, chosen(id) when another job is chosen;
// and where there is one: news(data) for every event, begun() once somebody may see the page, showJobs() instead of the
// plain list, lists(job): whether a job belongs in the list that is searched.
const site = {};

const hasEnded = (s) => ["done", "failed", "cancelled"].includes(s);
const allowed = {
  approve: (s) => s === "awaiting-approval",
  pause: (s) => s === "printing",
  resume: (s) => s === "paused",
  cleared: () => true,
  cancel: (s) => !hasEnded(s),
  forget: hasEnded,
  again: hasEnded,
};
const whyNot = {
  approve: "Only a job that is planned and waits for approval can be approved.",
  pause: "Only a print under way can be paused.",
  resume: "Only a paused print can go on.",
  cancel: "The job has ended.",
  forget: "Only a job that has ended can be forgotten.",
  again: "Only a job that has ended is printed again.",
};

// What somebody who opens the page wants to see: what is being made, else what waits for a word, else the newest.
function firstJob() {
  const in_ = (...states) => state.jobs.find((job) => states.includes(job.state));
  return in_("printing") || in_("paused") || in_("awaiting-approval") || state.jobs.find((job) => !hasEnded(job.state)) || state.jobs[0];
}

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

// JSON that never changes under its address, held: what is looked at, and what is next to it.
const held = (() => {
  const most = 400, restMs = 150, answers = new Map();
  let resting = 0;
  function of(path) {
    const there = answers.get(path);
    if (there) return there;
    if (answers.size >= most) answers.delete(answers.keys().next().value);
    const answer = get(path);
    answers.set(path, answer);
    answer.catch(() => answers.delete(path));  // whoever asked is told; the next one asks again
    return answer;
  }
  // Once the slider rests: what is fetched while it moves keeps the next layer waiting. What fails is asked for again by
  // whoever looks at it.
  function ahead(paths, pictures = []) {
    clearTimeout(resting);
    resting = setTimeout(() => {
      for (const path of paths) of(path).catch(() => {});
      for (const path of pictures) new Image().src = path;
    }, restMs);
  }
  return { get: of, ahead };
})();

// three.js comes when somebody asks for 3-D: no page waits for it. `why`: what is told where it is not installed.
let three = null;
function loadThree(why) {
  three ||= new Promise((done, fail) => {
    const script = document.createElement("script");
    script.src = "/three.js";
    script.onload = done;
    script.onerror = () => {
      three = null;
      script.remove();
      fail(new Error(why));
    };
    document.head.append(script);
  });
  return three;
}

function element(name, text) {
  const e = document.createElement(name);
  e.textContent = text;
  return e;
}

// ---- jobs of any age ----------------------------------------------------------------------------------------------

// The stream has what goes on and the newest. What is older is asked for, page by page, with the words of the search.
// next: where the site goes on; null: there is no more.
const past = { words: "", jobs: new Map(), next: null, failed: "" };
const createdAt = (job) => job.created_unix_s ?? job.created_unix_ms / 1000;
const jobOf = (id) => state.jobs.find((job) => job.id === id) || past.jobs.get(id);
const chosenJob = () => jobOf(state.chosen);
const searchWords = () => byId("search").value.trim().toLowerCase();

async function askPast(before) {
  const words = searchWords();
  const question = new URLSearchParams({ most: "100" });
  if (words) question.set("search", words);
  if (site.pastStates) question.set("state", site.pastStates);
  if (before) question.set("before", before);
  try {
    const page = await get(`/v1/jobs?${question}`);
    if (words !== searchWords()) return;  // other words are asked for by now
    if (!before) past.jobs.clear();
    for (const job of page.jobs) past.jobs.set(job.id, job);
    Object.assign(past, { words, next: page.next, failed: "" });
  } catch (error) {
    past.failed = error.message;
  }
  showJobs();
}

// The jobs of the searched list that fit the words, newest first: of the stream at once, of the past once they came.
function foundJobs() {
  const words = searchWords(), each = words.split(/\s+/).filter(Boolean);
  const fits = (job) => {
    const text = `${job.name} ${job.owner} ${job.id} ${job.machine} ${job.instance} ${job.state}`.toLowerCase();
    return each.every((word) => text.includes(word));
  };
  const lists = site.lists || (() => true);
  const live = state.jobs.filter((job) => lists(job) && fits(job)), known = new Set(state.jobs.map((job) => job.id));
  const old = past.words === words ? [...past.jobs.values()].filter((job) => !known.has(job.id)) : [];
  return [...live, ...old].sort((a, b) => createdAt(b) - createdAt(a));
}

function showPast(found) {
  byId("older").hidden = !past.next || past.words !== searchWords();
  byId("none-found").hidden = found > 0 || !searchWords();
  byId("past-answer").textContent = past.failed;
}

let searchSoon = 0;
byId("search").oninput = () => {
  showJobs();
  clearTimeout(searchSoon);
  searchSoon = setTimeout(askPast, 250);
};
byId("older").onclick = () => askPast(past.next);

function showJobs() {
  if (site.showJobs) return site.showJobs();
  const list = byId("jobs"), found = foundJobs();
  const focused = document.activeElement && document.activeElement.dataset.job;
  list.replaceChildren(...found.map((job) => {
    const button = element("button", job.name || job.id);
    button.dataset.job = job.id;
    button.setAttribute("aria-current", String(job.id === state.chosen));
    button.append(element("small", `${job.state}, ${job.instance || job.machine}`));
    button.onclick = () => {
      site.picked?.();
      choose(job.id);
    };
    const item = document.createElement("li");
    item.append(button);
    return item;
  }));
  if (focused) list.querySelector(`[data-job="${focused}"]`)?.focus();
  byId("no-jobs").hidden = state.jobs.length > 0;
  showPast(found.length);
}

// What may be said when the job is resumed; "": nothing beside it.
function answersTo(job) {
  if (job.exposure_unknown) return ["treat-as-exposed", "expose-again"];
  if (job.start_unknown) return ["treat-as-started", "start-again"];
  return [""];
}

function showJob() {
  const job = chosenJob();
  byId("job").hidden = !job;
  if (!job) return;
  byId("job-name").textContent = job.name || job.id;
  byId("job-message").hidden = !job.message;
  byId("job-message").textContent = job.message;
  // A link that is opened where the page is open already.
window.addEventListener("hashchange", async () => {
  const refused = await followLink();
  if (refused) return askToSignIn(refused);
  await findVisitor();
  byId("token-form").hidden = true;
});
for (const button of document.querySelectorAll("[data-action]")) {
    button.disabled = !allowed[button.dataset.action](job.state);
    // A question has two answers, which stand in the place of the plain button.
    button.title = button.disabled ? whyNot[button.dataset.action] || "" : "";
    // What cannot be done now is not offered.
    button.hidden = button.disabled;
    if (button.dataset.action === "cleared") button.hidden = button.disabled = !job.waits_for_platform;
    if (button.dataset.action === "resume" && !button.disabled) button.hidden = !answersTo(job).includes(button.dataset.as ?? "");
  }
  site.showJob(job);
}

async function showDetails() {
  const job = chosenJob();
  if (!job) return;
  // Events come with changes of state, not with layers.
  const told = `${job.id}/${job.state}/${job.message}`;
  if (state.told === told) return;
  state.told = told;
  const stage = `${job.id}/${job.state}`;
  if (state.stage !== stage) {
    state.stage = stage;
    site.showStage(job);
  }
  try {
    const { events } = await get(`/v1/jobs/${job.id}/events`);
    if (job.id !== state.chosen) return;
    byId("events").replaceChildren(...events.map((e) => element("li", `${new Date(e.unix_ms).toLocaleTimeString()} ${e.text}`)));
  } catch (error) {
    byId("events").replaceChildren(element("li", error.message));
  }
}

function choose(id) {
  state.chosen = id;
  site.chosen(id);
  showJobs();
  showJob();
  showDetails();
}

// Every item that holds the job is let through by name, or nothing is.
const askApproval = (held) => new Promise((answered) => {
  const dialog = byId("approval"), go = byId("approval-go"), why = byId("approval-why");
  byId("approval-items").replaceChildren(...held.map((item, i) => {
    const row = document.createElement("li"), box = document.createElement("input"), label = document.createElement("label");
    box.type = "checkbox";
    box.id = `approval-${i}`;
    box.value = item.name;
    label.htmlFor = box.id;
    label.append(element("b", item.name), ` ${item.text}`);
    row.append(box, label);
    return row;
  }));
  const boxes = [...dialog.querySelectorAll("input[type=checkbox]")];
  const look = () => {
    go.disabled = !boxes.every((box) => box.checked);
    why.textContent = go.disabled ? "It is approved once each of them is ticked." : "";
  };
  boxes.forEach((box) => (box.onchange = look));
  look();
  dialog.returnValue = "";
  dialog.onclose = () => answered(dialog.returnValue === "go" ? [...new Set(held.map((item) => item.name))] : null);
  dialog.showModal();
});

// What holds a job is named by whoever lets it through, so it is shown first. Null: the operator would rather not.
async function approval() {
  const { items } = await get(`/v1/jobs/${state.chosen}/preflight`).catch(() => ({ items: [] }));
  const held = items.filter((item) => item.verdict === "held");
  if (!held.length) return {};
  const names = await askApproval(held);
  return names && { although: names };
}

// `machine`: of an action about a machine; else that of the chosen job.
async function act(action, as, machine) {
  if (state.visitor.may !== "operator") {
    state.waiting = [action, as, machine];
    return askToSignIn(state.visitor.name ? `${state.visitor.name} may look and change nothing.` : "");
  }
  if (action === "cancel" && !confirm("Cancel this job? The print cannot be resumed.")) return;
  if (action === "forget" && !confirm("Forget this job? Its files leave this site; the record of a print stays.")) return;
  const said = action === "approve" ? await approval() : as ? { as } : {};
  if (!said) return;
  const cleared = machine || chosenJob()?.platform;
  const answer = await fetch(action === "cleared" ? `/v1/machines/${cleared}/cleared` : `/v1/jobs/${state.chosen}/${action}`, {
    method: "POST",
    body: Object.keys(said).length ? JSON.stringify(said) : undefined,
  });
  if (answer.status === 401) {
    await findVisitor();
    return act(action, as, machine);
  }
  const body = await answer.json();
  byId("answer").textContent = answer.ok ? `${action}${as ? ` as ${as}` : ""}: accepted` : body.error.what;
  if (answer.ok && action === "forget") past.jobs.delete(state.chosen);
  if (answer.ok && action === "again") {
    state.jobs = [body, ...state.jobs];
    choose(body.id);
  }
}

// Who has signed in is known by a cookie that no script can read, or by a certificate.
async function findVisitor() {
  state.visitor = await get("/v1/session");
  byId("visitor").hidden = !state.visitor.name;
  byId("visitor-name").textContent = state.visitor.name || "";
  byId("sign-out").hidden = state.visitor.by !== "session";
}

function askToSignIn(why) {
  byId("sign-in-answer").textContent = why;
  byId("token-form").hidden = false;
  byId("token").focus();
}

byId("token-form").onsubmit = async (event) => {
  event.preventDefault();
  const answer = await fetch("/v1/sign-in", { method: "POST", body: JSON.stringify({ token: byId("token").value }) });
  byId("token").value = "";
  if (!answer.ok) return askToSignIn((await answer.json()).error.what);
  byId("token-form").hidden = true;
  await findVisitor();
  if (!state.stream) follow();
  const waiting = state.waiting;
  state.waiting = null;
  if (typeof waiting === "function") waiting();
  else if (waiting) act(...waiting);
};
byId("sign-out").onclick = async () => {
  await fetch("/v1/sign-out", { method: "POST" });
  location.reload();  // nothing of what was seen stays in the page
};
for (const button of document.querySelectorAll("[data-action]")) button.onclick = () => act(button.dataset.action, button.dataset.as);

function follow() {
  state.stream = new EventSource("/v1/stream");
  state.stream.onopen = () => (byId("link").textContent = "live");
  state.stream.onerror = () => {
    byId("link").textContent = "connection lost, trying again";
    if (state.stream.readyState !== EventSource.CLOSED) return;
    // Refused, not lost: perhaps the session has ended.
    state.stream = null;
    setTimeout(begin, 2000);
  };
  state.stream.onmessage = (event) => {
    const news = JSON.parse(event.data), before = state.jobs, now = new Set(news.jobs.map((job) => job.id));
    state.jobs = news.jobs;
    // Forgotten, or too old by now for the stream: the site knows which.
    if (before.some((job) => !now.has(job.id))) askPast();
    if (site.news) site.news(news);
    // What was chosen may have been forgotten, here or by somebody else.
    if (!chosenJob()) state.chosen = null;
    if (!state.chosen && state.jobs.length) return choose(firstJob().id);
    showJobs();
    showJob();
    showDetails();
  };
  askPast();
  if (site.begun) site.begun();
}

// A link that signs in holds its key behind "#": used once, and out of the browser's history at once. What it was
// refused with; else nothing.
async function followLink() {
  const key = new URLSearchParams(location.hash.slice(1)).get("sign-in");
  if (!key) return "";
  const answer = await fetch("/v1/sign-in", { method: "POST", body: JSON.stringify({ link: key }) });
  history.replaceState(null, "", location.pathname + location.search);
  return answer.ok ? "" : (await answer.json()).error.what;
}

async function begin() {
  let refused = "";
  try {
    refused = await followLink();
    await findVisitor();
  } catch {
    return setTimeout(begin, 2000);
  }
  if (refused && state.visitor.may !== "operator") askToSignIn(refused);
  if (!state.visitor.must_sign_in || state.visitor.may !== "nothing") return follow();
  byId("link").textContent = "not signed in";
  askToSignIn(refused);
}
