// SPDX-License-Identifier: GPL-3.0-or-later
// The scan site's page: the stages of a job, what cleaning and slicing found, and the line to the fab.
"use strict";

const stages = [
  ["cut", "slice", (j) => [j.layers_sliced, j.layers]],
  ["kept by the fab", "send", (j) => [j.layers_sent, j.layers]],
  ["planned", "plan", (j) => [j.layers_planned, j.print_layers]],
  ["printed", "print", (j) => [j.layers_printed, j.print_layers]],
];

const bytes = (n) => (n < 1e4 ? `${n} bytes` : n < 1e7 ? `${(n / 1e3).toFixed(1)} kB` : `${(n / 1e6).toFixed(1)} MB`);
const millimetres = (v) => `${Number(v).toPrecision(4)} mm`;

// How far each stage is, one bar a row; rows are kept, so that nothing flickers.
function showStages(job) {
  const list = byId("stages");
  if (!list.children.length)
    list.replaceChildren(...stages.map(([name]) => {
      const item = document.createElement("li"), bar = document.createElement("progress");
      bar.setAttribute("aria-label", name);
      item.append(element("span", name), bar, element("span", ""));
      return item;
    }));
  stages.forEach(([, stage, count], i) => {
    const [done, all] = count(job), row = list.children[i];
    row.children[1].max = Math.max(all, 1);
    row.children[1].value = done;
    const seconds = job.seconds[stage];
    row.children[2].textContent = (all ? `${done} of ${all} layers` : "not yet") + (seconds === undefined ? "" : `, ${seconds.toFixed(1)} s`);
  });
}

function showLink() {
  const link = state.link;
  byId("fab").replaceChildren(element("dt", link.fleet ? "queue of the fleet" : "address"), element("dd", link.fab), element("dt", "state"),
    element("dd", link.up ? "reached" : `not reached: ${link.why_down}`));
}

site.showJob = (job) => {
  byId("job-line").textContent = `${job.state}, for ${job.machine}, job ${job.id}, from ${job.owner}; ` +
    `${bytes(job.wire_bytes)} sent for a scan of ${bytes(job.scan_bytes)}`;
  if (place.id) byId("job").hidden = true;  // a scan is being placed; a click on the job shows it
  showStages(job);
  showAsked(job);
  cutLayers.update(job);
};

// What was asked for, in the order and the words of the site's own table.
let parameters = [];
get("/v1/parameters").then((table) => {
  parameters = table;
}, () => {});  // without it a job's parameters are not shown; the rest of the page is

function showAsked(job) {
  const asked = job.parameters || {};
  const rows = parameters.filter((p) => asked[p.key] !== undefined).flatMap((p) => {
    const name = element("dt", p.key.replaceAll("_", " ").replace(/ mm$/, ""));
    name.title = p.help;
    return [name, element("dd", `${asked[p.key]}${p.unit ? ` ${p.unit}` : ""}`)];
  });
  byId("asked").replaceChildren(...rows);
  byId("asked-box").hidden = rows.length === 0;
}

site.chosen = () => {
  cutLayers.clear();
  byId("figures-box").hidden = byId("flags-box").hidden = true;
};

site.news = (news) => {
  if (state.link && state.link.up !== news.link.up) place.learnAgain();
  state.link = news.link;
  showLink();
  fleet.refresh(news.link);
};

// Names and values of what the report has; what it has not is left out.
function figures(report) {
  const rows = [];
  const add = (name, value) => value !== undefined && value !== null && rows.push([name, value]);
  add("points", report.points);
  if (report.size_mm) add("size", report.size_mm.map((v) => v.toFixed(2)).join(" × ") + " mm");
  add("surface", report.surface);
  add("method", report.method);
  const kernel = report.kernel || {};
  if (kernel.spacing_mm) add("spacing of points", millimetres(kernel.spacing_mm));
  if (kernel.noise_mm) add("noise", millimetres(kernel.noise_mm));
  if (kernel.width_mm) add("kernel", millimetres(kernel.width_mm));
  add("points left out as outliers", kernel.dropped_samples);
  const registration = report.registration;
  if (registration && registration.error_mm !== undefined) add("registration error", millimetres(registration.error_mm));
  for (const [name, value] of Object.entries(report.normals || {}))
    if (typeof value !== "object") add(`normals: ${name.replaceAll("_", " ")}`, value);
  add("layers", `${report.layers} of ${report.layer_mm} mm`);
  add("certified", `${report.certified} of ${report.layers_cut}`);
  add("contours", report.contours);
  add("vertices", report.vertices);
  for (const [stage, seconds] of Object.entries(report.seconds || {})) add(`${stage}`, `${seconds.toFixed(2)} s`);
  return rows;
}

site.showStage = async (job) => {
  let report;
  try {
    report = await get(`/v1/jobs/${job.id}/report`);
  } catch (error) {
    byId("report").textContent = error.message;
    return;
  }
  if (job.id !== state.chosen) return;
  byId("report").textContent = JSON.stringify(report, null, 1);
  byId("figures-box").hidden = false;
  byId("figures").replaceChildren(...figures(report).flatMap(([k, v]) => [element("dt", k), element("dd", String(v))]));
  const flags = (report.flagged_layers || []).map((f) => `layer ${f.layer}, z ${f.z_mm.toFixed(3)} mm: ${f.text}`);
  const all = flags.concat((report.inconsistencies || []).map(String));
  byId("flags-box").hidden = all.length === 0;
  byId("flags").replaceChildren(...all.map((text) => element("li", text)));
};

// A job that is picked takes the place of the scan that is being placed.
site.picked = () => place.close();
site.begun = refreshUploads;
begin();
