// SPDX-License-Identifier: GPL-3.0-or-later
"use strict";
// The fleet that prints this site's jobs: machines as tiles, and the queue in the order in which it is served.

const fleet = (() => {
  const stateOf = { free: "idle", busy: "printing", occupied: "occupied", trouble: "fault" };
  const mostJobs = 50, mostAnswered = 200;
  let shown = "";

  function tile(machine, jobs) {
    const item = element("li");
    item.dataset.state = machine.seen ? stateOf[machine.readiness] : "offline";
    const head = element("p");
    const word = machine.seen ? machine.readiness : "not heard of";
    const mark = element("span", machine.draining ? `${word}, out of service` : word);
    mark.className = "mark";
    head.append(element("b", machine.name), mark);
    item.append(head, element("small", `${machine.profile}, resin ${machine.resin}, ${machine.size_mm.join(" × ")} mm`));
    const job = jobs.find((each) => each.machine === machine.name && each.state !== "waiting");
    if (job) item.append(element("small", `${job.name}, job ${job.id}: ${job.state}`));
    return item;
  }

  function row(job) {
    const item = element("li");
    const urgent = job.priority ? `, priority ${job.priority}` : "";
    const due = job.deadline_unix_ms ? `, due ${new Date(job.deadline_unix_ms).toLocaleString()}` : "";
    item.append(element("b", job.name),
      ` for ${job.asks_for}${urgent}${due}; job ${job.id} of ${job.owner}, ${job.state}${job.message ? `: ${job.message}` : ""}`);
    return item;
  }

  async function refresh(link) {
    const box = byId("fleet-box");
    if (!link.fleet) {
      box.hidden = true;
      return;
    }
    let now;
    try {
      now = await get("/v1/fleet");
    } catch {
      return;  // the line says why
    }
    const text = JSON.stringify(now);
    if (text === shown) return;
    shown = text;
    box.hidden = false;
    const open = now.jobs.filter((job) => job.state === "waiting" || job.state === "asking");
    byId("fleet-machines").replaceChildren(...now.machines.map((machine) => tile(machine, now.jobs)));
    byId("fleet-waiting").textContent = open.length === 0 ? "Nothing waits." :
      `${now.waiting}${now.jobs.length === mostAnswered ? " or more" : ""} wait${now.waiting === 1 ? "s" : ""} for a machine${open.length > mostJobs ? `, of which the first ${mostJobs} are shown` : ""}.`;
    byId("fleet-jobs").replaceChildren(...open.slice(0, mostJobs).map(row));
  }
  return { refresh };
})();
