// SPDX-License-Identifier: GPL-3.0-or-later
// A scan before it is a job: how large, how it stands, what of it, on which machine; what that takes; and off it goes.
// Everything set here is a parameter of the job, as `telefab submit` has it.
"use strict";

const place = (() => {
  const angles = ["x", "y", "z"].map((axis) => byId(`turn-${axis}`));
  const self = { id: null, view: null, profiles: null, table: [], picture: 0, lookKey: "", estimateKey: "", timer: null, polling: false, ticked: [1], pieceKey: "" };

  // ---- what is asked -------------------------------------------------------------------------------------------

  const rotation = () => angles.map((a) => Number(a.value) || 0);
  // Parameters with a place of their own on the page; the others stand under "Everything else".
  const own = ["resin", "print", "height_mm", "scale", "fit", "units", "up", "rotate", "mirror", "crop", "pieces"];
  const cropInputs = () => [...byId("crop-box").querySelectorAll("input")];

  function parameters() {
    const p = {};
    if (byId("resin").value) p.resin = byId("resin").value;
    if (byId("print").value) p.print = byId("print").value;
    const by = byId("size-by").value, value = Number(byId("size-value").value);
    if (by === "height" && value > 0) p.height_mm = value;
    if (by === "scale" && value > 0) p.scale = value;
    if (by === "fit") p.fit = true;
    if (by !== "scale" && byId("units").value) p.units = byId("units").value;
    if (rotation().some((a) => a !== 0)) p.rotate = rotation().join(",");
    if (byId("mirror").value) p.mirror = byId("mirror").value;
    if (byId("crop-on").checked) p.crop = self.cropText().join(",");
    if (byId("pieces").value) p.pieces = byId("pieces").value === "only" ? `only:${self.ticked.join(",")}` : byId("pieces").value;
    for (const input of byId("other-parameters").querySelectorAll("[data-key]")) {
      if (input.type === "checkbox" ? input.checked : input.value !== "")
        p[input.dataset.key] = input.type === "checkbox" ? true : input.type === "number" ? Number(input.value) : input.value;
    }
    return p;
  }

  const question = () => ({ machine: byId("machine").value, parameters: parameters() });
  const placingKeys = ["resin", "print", "height_mm", "scale", "fit", "units", "rotate", "mirror", "position", "scale_axes", "base", "layer_mm", "chord_mm", "speck_px2", "method", "coding"];
  function lookKey() {
    const p = parameters();
    // What is said in millimetres of the print means another surface at another size.
    const isOfSize = ["complete", "thickness_mm", "kernel_mm"].some((key) => key in p);
    for (const key of placingKeys) if (!isOfSize || !["height_mm", "scale", "fit", "units", "rotate"].includes(key)) delete p[key];
    return JSON.stringify(p);
  }

  // ---- the table of parameters and the profiles ---------------------------------------------------------------

  function otherInput(p) {
    let input;
    if (p.choices?.length) {
      input = document.createElement("select");
      input.append(new Option(p.default ? `${p.default} (default)` : "default", ""), ...p.choices.filter((c) => c !== p.default).map((c) => new Option(c, c)));
    } else {
      input = document.createElement("input");
      input.type = p.type === "number" ? "number" : p.type === "boolean" ? "checkbox" : "text";
      if (p.type === "number") input.step = "any";
      if (p.type === "string") input.placeholder = p.default || "";
    }
    input.dataset.key = p.key;
    input.title = p.help;
    const label = element("label", p.key.replaceAll("_", " ").replace(/ mm$/, ", mm"));
    label.title = p.help;
    label.append(input);
    return label;
  }

  async function learn() {
    const [table, profiles, link] = await Promise.all([get("/v1/parameters"), get("/v1/profiles"), get("/v1/link")]);
    if (!self.table.length) {
      self.table = table;
      byId("other-parameters").replaceChildren(...table
        .filter((p) => !own.includes(p.key) && (p.subject !== "fleet" || link.fleet)).map(otherInput));
    }
    self.profiles = profiles;
    const keep = (select, options) => {
      const before = select.value;
      select.replaceChildren(...options);
      if (options.some((o) => o.value === before)) select.value = before;
    };
    const machines = profiles.machines.map((m) => new Option(m.description ? `${m.name}: ${m.description}` : m.name, m.name));
    keep(byId("machine"), machines);
    const stored = localStorage.getItem("telefab-machine");
    if (!self.wasLearnt && machines.some((o) => o.value === stored)) byId("machine").value = stored;
    self.wasLearnt = true;
    keep(byId("print"), [new Option("as the machine states", ""), ...profiles.prints.map((p) => new Option(p.description ? `${p.name}: ${p.description}` : p.name, p.name))]);
    showResins();
  }

  // The fab is reached, or no more: its profiles take the place of the site's, and the other way round.
  self.learnAgain = async () => {
    if (!self.id) return;  // opening a scan asks for them
    try {
      await learn();
      self.lookKey = self.estimateKey = "";
      changed();
    } catch (error) {
      showProblem(error.message);
    }
  };

  const machine = () => self.profiles?.machines.find((m) => m.name === byId("machine").value);

  function showResins() {
    const m = machine(), select = byId("resin"), before = select.value;
    if (!m) return;
    // A machine with resin in its vat takes no other: preflight would refuse it, so it is not offered.
    const loaded = m.loaded_resin;
    const others = loaded ? self.profiles.resins.filter((r) => r.name === loaded) : self.profiles.resins;
    select.replaceChildren(new Option(loaded ? `as loaded: ${loaded}` : `as the machine states: ${m.resin}`, ""), ...others.filter((r) => r.name !== loaded).map((r) => new Option(r.description ? `${r.name}: ${r.description}` : r.name, r.name)));
    if ([...select.options].some((o) => o.value === before)) select.value = before;
  }

  // What programs say names options of a command line; here they are fields of this page.
  const pageWords = (text) => text.replace(/--([a-z][a-z-]*)/g, (_, option) => `“${option.replaceAll("-", " ")}”`);

  // ---- what is shown ------------------------------------------------------------------------------------------

  const unitMm = () => ({ mm: 1, cm: 10, m: 1000, in: 25.4 })[byId("units").value] || self.view?.reading.result?.unit_mm || 1;

  function scaleFor(size) {
    const by = byId("size-by").value, value = Number(byId("size-value").value), m = machine();
    if (by === "height" && value > 0 && size[2] > 0) return value / size[2];
    if (by === "scale" && value > 0) return value;
    if (by === "fit" && m) return 0.98 * Math.min(m.width_mm / size[0], m.depth_mm / size[1], m.height_mm / size[2]);
    return unitMm();
  }

  function placed() {
    const by = byId("size-by").value;
    byId("size-value-box").hidden = by !== "height" && by !== "scale";
    byId("size-value").required = !byId("size-value-box").hidden;
    byId("size-value-name").textContent = by === "height" ? "Height, mm" : "mm a unit";
    cloudView.setPlacing({ rotate: rotation(), mirror: byId("mirror").value, scale: scaleFor, machine: machine() });
    cloudView.setCrop(byId("crop-on").checked ? self.cropText() : null);
    byId("crop-box").hidden = !byId("crop-on").checked;
    showUnitQuestion();
    showPrice();
  }

  // Nobody guesses whether 0.12 is metres: it is asked, and nothing is sent before.
  function unitIsOpen() {
    const facts = self.view?.reading.result;
    return Boolean(facts?.unit_is_open && !byId("units").value && byId("size-by").value === "own");
  }
  function showUnitQuestion() {
    const isOpen = unitIsOpen(), box = byId("unit-question");
    let text = "";
    if (isOpen) {
      const { min, max } = self.view.reading.result.box, longest = Math.max(...max.map((v, k) => v - min[k]));
      text = `The file states no unit. In millimetres it would be ${Number(longest.toPrecision(3))} mm long, which is hardly meant: choose the unit, or a size.`;
    }
    if (box.textContent !== text) box.textContent = text;
    box.hidden = !isOpen;
  }

  document.addEventListener("cloud-placed", ({ detail: { size } }) => {
    const m = machine(), text = size.map((v) => (v >= 100 ? v.toFixed(0) : v.toPrecision(3))).join(" × ");
    const isLarge = m && (size[0] > m.width_mm || size[1] > m.depth_mm || size[2] > m.height_mm);
    byId("place-line").textContent = `${text} mm${m ? `${isLarge ? ": larger than" : " on"} ${m.name}, ${m.width_mm} × ${m.depth_mm} × ${m.height_mm} mm` : ""}`;
    byId("place-line").className = isLarge ? "danger" : "";
  });

  // About an axis of the platform, on top of the turn there is.
  self.turnBy = (...pairs) => {
    const R = rotation().map((d) => (d * Math.PI) / 180);
    const about = { x: (a) => [[1, 0, 0], [0, Math.cos(a), -Math.sin(a)], [0, Math.sin(a), Math.cos(a)]], y: (a) => [[Math.cos(a), 0, Math.sin(a)], [0, 1, 0], [-Math.sin(a), 0, Math.cos(a)]], z: (a) => [[Math.cos(a), -Math.sin(a), 0], [Math.sin(a), Math.cos(a), 0], [0, 0, 1]] };
    const times = (a, b) => a.map((row) => b[0].map((_, j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
    let m = times(about.z(R[2]), times(about.y(R[1]), about.x(R[0])));
    for (let i = 0; i + 1 < pairs.length; i += 2) m = times(about[pairs[i]]((pairs[i + 1] * Math.PI) / 180), m);
    // m = Rz Ry Rx; at y = +-90 degrees x and z turn about the same axis, and x takes all of it.
    const y = Math.asin(Math.max(-1, Math.min(1, -m[2][0])));
    const isPole = Math.abs(m[2][0]) > 1 - 1e-12;
    const x = isPole ? Math.atan2(-m[1][2], m[1][1]) : Math.atan2(m[2][1], m[2][2]), z = isPole ? 0 : Math.atan2(m[1][0], m[0][0]);
    setAngles([x, y, z].map((a) => (a * 180) / Math.PI));
    changed();
  };
  function setAngles(degrees) {
    degrees.forEach((d, k) => (angles[k].value = String(Math.round(d * 1e4) / 1e4 + 0)));
  }

  function showPieces() {
    const pick = self.view.look.result?.pick, list = byId("piece-list"), select = byId("pieces");
    if (!pick) return;
    const pieces = pick.pieces || [];
    const key = JSON.stringify([pieces, self.ticked, select.value]);
    if (self.pieceKey === key) return;  // a box that is being ticked is not replaced for nothing
    self.pieceKey = key;
    list.hidden = pieces.length < 2;
    const isTicking = select.value === "only", focused = document.activeElement?.dataset?.piece;
    list.replaceChildren(...pieces.slice(0, 50).map((piece, k) => {
      const size = piece.box ? piece.box[1].map((v, k) => (v - piece.box[0][k]).toPrecision(3)).join(" × ") : "";
      const item = element("li", `${piece.points.toLocaleString()} points${size ? `, ${size}` : ""}: ${piece.kept ? "kept" : "left out"}`);
      if (piece.kept) item.className = "kept";
      // A piece that is pointed at, or has the focus, is shown by its box.
      item.onpointerenter = () => piece.box && cloudView.setMark(piece.box.flat());
      item.onpointerleave = () => cloudView.setMark(null);
      item.addEventListener("focusin", item.onpointerenter);
      item.addEventListener("focusout", item.onpointerleave);
      if (pieces.length > 1) item.tabIndex = isTicking ? -1 : 0;
      if (!isTicking) return item;
      const label = document.createElement("label"), tick = document.createElement("input");
      label.className = "check";
      tick.type = "checkbox";
      tick.checked = self.ticked.includes(k + 1);
      tick.dataset.piece = String(k + 1);
      tick.onchange = () => {
        self.ticked = self.ticked.filter((n) => n !== k + 1).concat(tick.checked ? [k + 1] : []).sort((a, b) => a - b);
        if (!self.ticked.length) self.ticked = [k + 1];
        changed();
      };
      label.append(tick, element("span", item.textContent));
      item.replaceChildren(label);
      return item;
    }));
    if (focused) list.querySelector(`[data-piece="${focused}"]`)?.focus();
    const options = [new Option("all", ""), new Option("the largest alone", "largest"), new Option("those ticked below", "only")];
    for (let n = 2; n < Math.min(pieces.length, 20); n++) options.push(new Option(`the ${n} largest`, String(n)));
    const before = select.value;
    select.replaceChildren(...options);
    if (options.some((o) => o.value === before)) select.value = before;
  }

  function showFacts() {
    const { reading, look } = self.view, raw = reading.result, facts = look.result;
    const rows = [];
    if (raw) rows.push(["file", `${raw.format}, ${raw.points.toLocaleString()} points${raw.views > 1 ? `, ${raw.views} views` : ""}`]);
    if (facts) {
      rows.push(["object", `${facts.kept.toLocaleString()} points`]);
      const all = facts.measured + facts.completed + facts.doubtful;
      const share = (n) => `${((100 * n) / Math.max(1, all)).toPrecision(2)} %`;
      rows.push(["completed", facts.completed ? `${share(facts.completed)} of the samples` : "nothing: no gap was found"]);
      rows.push(["doubtful", facts.doubtful ? `${facts.doubtful} of ${facts.asked} places looked at` : `none of ${facts.asked} places looked at`]);
    }
    byId("scan-facts").replaceChildren(...rows.flatMap(([k, v]) => [element("dt", k), element("dd", v)]));
    const texts = facts ? facts.warnings : raw ? raw.notes : [];
    byId("scan-warnings").replaceChildren(...texts.map((t) => element("li", pageWords(t))));
  }

  function cropDefaults() {
    const box = self.view.reading.result?.box;
    if (!box || byId("crop-box").childElementCount) return;
    const rows = ["x", "y", "z"].flatMap((axis, k) => {
      const input = (what, value) => {
        const i = document.createElement("input");
        i.type = "number";
        i.step = "any";
        i.value = String(Number(value.toPrecision(6)));
        i.dataset.default = i.value;
        i.setAttribute("aria-label", `${axis} ${what}`);
        i.dataset.corner = what === "from" ? String(k) : String(k + 3);
        return i;
      };
      return [element("span", axis), input("from", box.min[k]), input("to", box.max[k])];
    });
    byId("crop-box").replaceChildren(...rows);
  }

  // The inputs stand by axis, the parameter by corner.
  const byCorner = (a, b) => Number(a.dataset.corner) - Number(b.dataset.corner);
  self.cropText = () => cropInputs().sort(byCorner).map((i) => Number(i.value));

  const clockText = (s) => (s >= 3600 ? `${Math.floor(s / 3600)} h ${Math.round((s % 3600) / 60)} min` : s >= 60 ? `${Math.round(s / 60)} min` : `${Math.round(s)} s`);

  function showPrice() {
    const ml = self.view?.estimate.result?.resin_ml, price = Number(byId("price").value);
    const cell = byId("estimate").querySelector("[data-price]");
    if (!cell) return;
    const cost = self.view?.estimate.result?.cost;
    // A price that somebody types goes before that of the profile, and has no currency.
    if (ml !== undefined && price > 0) cell.textContent = `${((ml / 1000) * price).toFixed(2)} for the resin`;
    else if (cost) cell.textContent = `${cost.amount.toFixed(2)} ${cost.currency} for the resin, at ${cost.per_litre} ${cost.currency} a litre`;
    else cell.textContent = "not known: no price of the resin is stated";
  }

  function showEstimate() {
    const e = self.view.estimate, line = byId("estimate-line"), isCurrent = e.asked && self.estimateNumber === e.number;
    let text = "not estimated yet";
    if (e.state === "working") text = `estimating${e.stage ? `: ${e.stage}` : ""}`;
    else if (e.state === "failed" && isCurrent && e.code !== "cancelled") text = pageWords(e.why);
    else if (e.state === "done") text = isCurrent ? "from a grid of the part; the fab's plan has the true figures" : "of the last choice";
    if (line.textContent !== text) line.textContent = text;
    line.className = e.state === "failed" ? "danger" : "";
    if (e.state === "failed") byId("estimate").replaceChildren(), byId("foreseen").replaceChildren();
    if (e.state !== "done") return;
    const r = e.result, f = r.figures;
    const rows = [["layers", `${f.layers} of ${r.layer_mm} mm${f.lifted ? ", those below the part included" : ""}`], ["time", clockText(r.seconds)], ["resin", `${r.resin_ml.toFixed(1)} ml, part and supports`],
      ["supports", `${(f.support_mm3 / 1000).toFixed(2)} ml, ${f.anchors} anchors`], ["price", ""]];
    byId("estimate").replaceChildren(...rows.flatMap(([k, v]) => {
      const value = element("dd", v);
      if (k === "price") value.dataset.price = "";
      return [element("dt", k), value];
    }));
    byId("foreseen").replaceChildren(...r.items.map((item) => {
      const li = document.createElement("li");
      li.className = item.verdict;
      li.append(element("b", `${item.verdict.replace("-", " ")}: ${item.name}`), element("span", pageWords(item.text)));
      return li;
    }));
    showPrice();
  }

  function showWays() {
    const o = self.view.orientation, line = byId("way-line");
    const text = o.state === "working" ? `judging directions, ${Math.round(100 * (o.share || 0))} %` : o.state === "failed" && o.code !== "cancelled" ? pageWords(o.why) : "";
    if (line.textContent !== text) line.textContent = text;
    byId("find-way").disabled = o.state === "working";
    if (o.state !== "done" || self.waysNumber === o.number) return;
    self.waysNumber = o.number;
    byId("ways").replaceChildren(...o.result.ways.map((way, k) => {
      const item = document.createElement("li"), label = document.createElement("label"), radio = document.createElement("input");
      radio.type = "radio";
      radio.name = "way";
      radio.onchange = () => {
        setAngles(way.rotate.split(",").map(Number));
        changed();
      };
      const f = way.figures;
      label.append(radio, element("span", `${way.source === "spread" ? "another direction" : way.source}: ${(f.support_mm3 / 1000).toFixed(2)} ml of supports, ${f.size_mm[2].toFixed(1)} mm high, ${f.layers} layers`));
      item.append(label);
      if (self.takesBest && k === 0) {
        radio.checked = true;
        radio.onchange();
      }
      return item;
    }));
    self.takesBest = false;
  }

  function showProblem(text) {
    const box = byId("place-problem");
    box.hidden = !text;
    if (box.textContent !== text) box.textContent = text;
  }

  // A browser gives a field that holds no number, as "0x10" or a lone minus, without a value: that must not pass for one
  // that nobody has filled in.
  function wrongField() {
    const field = [...byId("place-form").elements].find((e) => e.willValidate && !e.validity.valid && !e.closest("[hidden]"));
    if (!field) return "";
    const name = field.getAttribute("aria-label") || field.labels?.[0]?.firstElementChild?.textContent || field.labels?.[0]?.firstChild?.textContent || field.id;
    return `${name.trim()}: ${field.validity.badInput ? "this is not a number; write it in decimal digits" : field.validationMessage}`;
  }

  // Whether what is missing of the surface is meant depends on how the part stands: the estimate of the last choice knows.
  const surfaceHeld = (estimate) => (estimate.state === "done" && estimate.number === self.estimateNumber && estimate.result.items.find((i) => i.name === "surface" && i.verdict === "held")?.text) || "";

  function showSend() {
    const { reading, look, estimate } = self.view;
    const why = [
      [self.view.state !== "whole", "The file is not here yet."],
      [reading.state === "failed" && reading.code !== "too-large", "The file cannot be read: see above."],
      [wrongField(), wrongField()],
      [unitIsOpen(), "The unit of the file is not known: choose it above."],
      [!byId("machine").value, "There is no machine to print on."],
    ].find(([isSo]) => isSo)?.[1] || "";
    const send = byId("send");
    send.disabled = Boolean(why) || self.isSending;
    const note = byId("send-note");
    if (why && note.textContent !== why) note.textContent = why;
    else if (!why && note.dataset.why) note.textContent = "";
    note.dataset.why = why;
    const problem = reading.state === "failed" && reading.code !== "cancelled" ? reading.why : look.state === "failed" && look.code !== "cancelled" ? look.why : surfaceHeld(estimate);
    showProblem(problem ? pageWords(problem) : "");
  }

  async function showPicture() {
    const { picture } = self.view;
    if (!picture.levels || picture.revision === self.picture) return;
    self.picture = picture.revision;
    const id = self.id, revision = picture.revision;
    try {
      await cloudView.load(`/v1/uploads/${id}`, picture, () => self.id === id && self.picture === revision);
    } catch (error) {
      cloudView.note.textContent = error.message;
    }
  }

  function show() {
    const { reading, look } = self.view;
    byId("place-name").textContent = self.view.name;
    if (self.view.state === "checking" || reading.state === "working") cloudView.note.textContent = "reading the file";
    else if (look.state === "working") cloudView.note.textContent = `${look.stage || "preparing"}: the colours come in a moment`;
    cropDefaults();
    showFacts();
    showPieces();
    showEstimate();
    showWays();
    showUnitQuestion();
    showSend();
    showPicture();
  }

  // ---- asking -------------------------------------------------------------------------------------------------

  async function ask(what, more = {}) {
    const id = self.id;
    try {
      const view = await post(`/v1/uploads/${id}/${what}`, { ...question(), ...more });
      if (self.id !== id) return null;
      self.view = view;
      return view;
    } catch (error) {
      const line = byId(what === "orient" ? "way-line" : "estimate-line");
      line.textContent = error.message;
      return null;
    }
  }

  async function refresh() {
    if (!self.id || self.view?.state !== "whole" || !self.profiles || wrongField()) return;
    if (self.lookKey !== lookKey()) {
      self.lookKey = lookKey();
      if (await ask("look")) showProblem("");
    }
    const key = JSON.stringify(question());
    if (self.estimateKey !== key && self.view.reading.state !== "failed" && !unitIsOpen()) {
      self.estimateKey = key;
      const view = await ask("estimate");
      if (view) self.estimateNumber = view.estimate.number;
    }
    if (self.view) show();
    poll();
  }

  function changed() {
    placed();
    if (self.view) showSend();
    clearTimeout(self.timer);
    self.timer = setTimeout(refresh, 350);
  }

  async function poll() {
    if (self.polling) return;
    self.polling = true;
    try {
      while (self.id) {
        const id = self.id, view = await get(`/v1/uploads/${id}`);
        if (self.id !== id) continue;
        const wasWhole = self.view?.state === "whole";
        self.view = view;
        show();
        if (view.state === "whole" && !wasWhole) {
          self.lookKey = self.estimateKey = "";
          placed();
          setTimeout(refresh, 0);
        }
        if (![view.reading, view.look, view.estimate, view.orientation].some((q) => q.state === "working") && view.state !== "checking") break;
        await pause(200);
      }
    } catch (error) {
      showProblem(error.message);
    } finally {
      self.polling = false;
    }
  }

  function clear() {
    Object.assign(self, { view: null, picture: 0, lookKey: "", estimateKey: "", waysNumber: 0, estimateNumber: 0, takesBest: false, ticked: [1], pieceKey: "" });
    setAngles([0, 0, 0]);
    byId("place-form").reset();
    if (self.profiles) {
      const stored = localStorage.getItem("telefab-machine");
      if (self.profiles.machines.some((m) => m.name === stored)) byId("machine").value = stored;
      showResins();
    }
    byId("price").value = localStorage.getItem("telefab-price") || "";
    for (const id of ["ways", "piece-list", "crop-box", "estimate", "foreseen", "scan-facts", "scan-warnings"]) byId(id).replaceChildren();
    byId("send-note").textContent = byId("way-line").textContent = byId("place-line").textContent = "";
    showProblem("");
    cloudView.clear();
  }

  self.open = async (id) => {
    if (self.id !== id) {
      self.id = null;
      clear();
      self.id = id;
    }
    byId("place").hidden = false;
    document.body.classList.add("is-placing");
    byId("job").hidden = true;
    showUploads();
    try {
      await learn();
      placed();
      // Clouds that nobody looked at for long are read again.
      const view = await get(`/v1/uploads/${id}`);
      if (self.id !== id) return;
      self.view = view;
      show();
      byId("place-name").focus();
      if (view.state === "whole") await refresh();
      poll();
    } catch (error) {
      showProblem(error.message);
    }
  };
  self.close = () => {
    self.id = null;
    byId("place").hidden = true;
    document.body.classList.remove("is-placing");
    showUploads();
  };
  self.discard = async (id, name) => {
    if (!confirm(`Discard ${name}? Its bytes leave this site; jobs that were made of it stay.`)) return;
    try {
      await post(`/v1/uploads/${id}/discard`, {});
      if (self.id === id) self.close();
    } catch (error) {
      byId("upload-answer").textContent = error.message;
    }
    refreshUploads();
  };

  byId("place-form").oninput = (e) => {
    if (e.target.id === "price") {
      localStorage.setItem("telefab-price", e.target.value);
      return showPrice();
    }
    if (e.target.name === "way" || e.target.id === "goal") return;
    if (e.target.id === "machine") {
      localStorage.setItem("telefab-machine", e.target.value);
      showResins();
    }
    changed();
  };
  for (const button of document.querySelectorAll("[data-turn]"))
    button.onclick = () => {
      if (button.dataset.turn === "reset") {
        setAngles([0, 0, 0]);
        return changed();
      }
      self.turnBy(button.dataset.turn[0], 90);
    };
  byId("find-way").onclick = async () => {
    self.takesBest = true;
    const p = parameters();
    delete p.rotate;
    const view = await ask("orient", { parameters: p, for: byId("goal").value });
    if (view) show();
    poll();
  };
  byId("discard").onclick = () => self.view && self.discard(self.id, self.view.name);
  byId("place-form").onsubmit = async (event) => {
    event.preventDefault();
    const note = byId("send-note");
    self.isSending = true;
    showSend();
    note.textContent = "sending";
    try {
      const job = await post(`/v1/uploads/${self.id}/submit`, question());
      note.textContent = `sent: job ${job.id}`;
      self.close();
      if (!state.jobs.some((j) => j.id === job.id)) state.jobs.unshift(job);
      choose(job.id);
      byId("job-name").setAttribute("tabindex", "-1");
      byId("job-name").focus();
    } catch (error) {
      note.textContent = error.message;
    } finally {
      self.isSending = false;
      if (self.view) showSend();
    }
  };
  return self;
})();
