// SPDX-License-Identifier: GPL-3.0-or-later
// Files on their way in: digest, parts, going on after an interruption. A file is known by its bytes, so that an upload
// goes on after a reload, after a restart of the site, and from another browser.
"use strict";

// SHA-256 (FIPS 180-4) of blocks as they come, for files that are too large to be held at once, and where the browser
// offers none.
class Sha256 {
  static k = (() => {
    const k = new Int32Array(64);
    let n = 0;
    for (let p = 2; n < 64; p++) {
      let isPrime = true;
      for (let d = 2; d * d <= p; d++) if (p % d === 0) isPrime = false;
      if (isPrime) k[n++] = (Math.cbrt(p) % 1) * 4294967296;
    }
    return k;
  })();
  constructor() {
    this.h = Int32Array.of(0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19);
    this.w = new Int32Array(64);
    this.rest = new Uint8Array(64);
    this.held = 0;
    this.length = 0;
  }
  feed(bytes) {
    this.length += bytes.length;
    let at = 0;
    if (this.held) {
      const take = Math.min(64 - this.held, bytes.length);
      this.rest.set(bytes.subarray(0, take), this.held);
      this.held += take;
      at = take;
      if (this.held < 64) return;
      this.block(this.rest, 0);
      this.held = 0;
    }
    for (; at + 64 <= bytes.length; at += 64) this.block(bytes, at);
    this.rest.set(bytes.subarray(at));
    this.held = bytes.length - at;
  }
  block(b, at) {
    const w = this.w, h = this.h, k = Sha256.k;
    for (let i = 0; i < 16; i++, at += 4) w[i] = (b[at] << 24) | (b[at + 1] << 16) | (b[at + 2] << 8) | b[at + 3];
    for (let i = 16; i < 64; i++) {
      const x = w[i - 15], y = w[i - 2];
      w[i] = (w[i - 16] + w[i - 7] + (((x >>> 7) | (x << 25)) ^ ((x >>> 18) | (x << 14)) ^ (x >>> 3)) + (((y >>> 17) | (y << 15)) ^ ((y >>> 19) | (y << 13)) ^ (y >>> 10))) | 0;
    }
    let [a0, b0, c0, d0, e0, f0, g0, h0] = h;
    for (let i = 0; i < 64; i++) {
      const t = (h0 + (((e0 >>> 6) | (e0 << 26)) ^ ((e0 >>> 11) | (e0 << 21)) ^ ((e0 >>> 25) | (e0 << 7))) + ((e0 & f0) ^ (~e0 & g0)) + k[i] + w[i]) | 0;
      const u = ((((a0 >>> 2) | (a0 << 30)) ^ ((a0 >>> 13) | (a0 << 19)) ^ ((a0 >>> 22) | (a0 << 10))) + ((a0 & b0) ^ (a0 & c0) ^ (b0 & c0))) | 0;
      h0 = g0; g0 = f0; f0 = e0; e0 = (d0 + t) | 0; d0 = c0; c0 = b0; b0 = a0; a0 = (t + u) | 0;
    }
    h[0] += a0; h[1] += b0; h[2] += c0; h[3] += d0; h[4] += e0; h[5] += f0; h[6] += g0; h[7] += h0;
  }
  hex() {
    const bits = this.length * 8, end = new Uint8Array(this.held < 56 ? 64 : 128);
    end.set(this.rest.subarray(0, this.held));
    end[this.held] = 0x80;
    const tail = new DataView(end.buffer);
    tail.setUint32(end.length - 8, Math.floor(bits / 4294967296));
    tail.setUint32(end.length - 4, bits >>> 0);
    for (let at = 0; at < end.length; at += 64) this.block(end, at);
    return [...this.h].map((v) => (v >>> 0).toString(16).padStart(8, "0")).join("");
  }
}

const uploads = { here: [], limits: null, sending: new Map(), views: new Set() };  // sending: by name of the file

const mostHeldBytes = 256 << 20, hashBlock = 4 << 20;

async function digestOf(file, tell) {
  if (window.crypto?.subtle && file.size <= mostHeldBytes) {
    const digest = await crypto.subtle.digest("SHA-256", await file.arrayBuffer());
    return [...new Uint8Array(digest)].map((b) => b.toString(16).padStart(2, "0")).join("");
  }
  const hash = new Sha256();
  for (let at = 0; at < file.size; at += hashBlock) {
    hash.feed(new Uint8Array(await file.slice(at, at + hashBlock).arrayBuffer()));
    tell(at / file.size);
  }
  return hash.hex();
}

// A POST of an operator. Who has not signed in is asked to, and the work goes on then.
async function post(path, body) {
  while (true) {
    if (state.visitor.may !== "operator") await signedIn(state.visitor.name ? `${state.visitor.name} may look and change nothing.` : "");
    const answer = await fetch(path, { method: "POST", body: body instanceof Blob ? body : JSON.stringify(body) });
    if (answer.status === 401) {
      await findVisitor();
      if (state.visitor.may === "operator") throw new Error("the site does not take this session");
      continue;
    }
    const value = await answer.json();
    if (answer.ok) return value;
    throw Object.assign(new Error(value.error.what), { code: value.error.code, status: answer.status });
  }
}

let signingIn = null;
function signedIn(why) {
  askToSignIn(why);
  signingIn ||= new Promise((done) => {
    const before = state.waiting;
    state.waiting = () => {
      signingIn = null;
      done();
      if (typeof before === "function") before();
    };
  });
  return signingIn;
}

const sizeText = (n) => (n < 1e4 ? `${n} bytes` : n < 1e6 ? `${(n / 1e3).toFixed(0)} kB` : n < 1e9 ? `${(n / 1e6).toFixed(1)} MB` : `${(n / 1e9).toFixed(2)} GB`);
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function upload(file) {
  const sending = { name: file.name, size: file.size, done: 0, text: "computing its digest", isStopped: false };
  uploads.sending.set(file.name, sending);
  const tell = (text, done) => {
    sending.text = text;
    if (done !== undefined) sending.done = done;
    showUploads();
  };
  tell(sending.text, 0);
  try {
    const sha256 = await digestOf(file, (share) => tell(`computing its digest, ${Math.round(100 * share)} %`, 0));
    let view = await post("/v1/uploads", { name: file.name, size_bytes: file.size, sha256 });
    sending.id = view.id;
    if (view.received_bytes && view.state === "receiving") tell("goes on where it stopped", view.received_bytes);
    for (let failures = 0; view.state === "receiving" && !sending.isStopped;) {
      const from = view.received_bytes, part = file.slice(from, from + uploads.limits.part_bytes);
      try {
        view = await post(`/v1/uploads/${view.id}/part?from=${from}`, part);
        failures = 0;
      } catch (error) {
        // Refused for good, but for a place that is not the one it goes on at: a part arrived whose answer did not.
        if (error.status && error.status !== 409 && error.status !== 503) throw error;
        if (++failures > 120) throw error;
        tell("the site does not answer, trying again");
        await pause(Math.min(5000, 250 * failures));
        view = await get(`/v1/uploads/${view.id}`).catch(() => view);
      }
      tell(`sending, ${Math.round((100 * view.received_bytes) / file.size)} %`, view.received_bytes);
    }
    uploads.sending.delete(file.name);
    await refreshUploads();
    if (!sending.isStopped) place.open(view.id);
    // Its digest is compared now; only what is whole is a view that can be joined.
    while (view.state === "checking") {
      await pause(100);
      view = await get(`/v1/uploads/${view.id}`);
    }
    if (view.state === "refused") throw new Error("it did not arrive as it was announced; choose the file again");
    await refreshUploads();
  } catch (error) {
    uploads.sending.delete(file.name);
    byId("upload-answer").textContent = `${file.name}: ${error.message}`;
    await refreshUploads();
  }
}

async function uploadAll(files) {
  byId("upload-answer").textContent = "";
  if (!uploads.limits && state.visitor.must_sign_in && state.visitor.may !== "operator") await signedIn("");
  if (!uploads.limits) await refreshUploads();
  if (!uploads.limits) return;  // it says why
  for (const file of files) {
    if (!file.size) byId("upload-answer").textContent = `${file.name} is empty`;
    else if (file.size > uploads.limits.limit_bytes) byId("upload-answer").textContent = `${file.name} has ${sizeText(file.size)}; the limit is ${sizeText(uploads.limits.limit_bytes)}`;
    else await upload(file);
  }
}

async function refreshUploads() {
  try {
    uploads.limits = await get("/v1/uploads");
    uploads.here = uploads.limits.uploads;
  } catch (error) {
    byId("upload-answer").textContent = error.message;
    return;
  }
  const most = Math.min(uploads.limits.limit_bytes, uploads.limits.room_bytes);
  byId("upload-limits").textContent = `PLY, PCD, PTX, E57, LAS, OFF, STL, OBJ or text, up to ${sizeText(most)}${most < uploads.limits.limit_bytes ? " (free disk)" : ""}; what nobody uses goes after ${uploads.limits.kept_hours} hours.`;
  showUploads();
}

function uploadItem({ id, name, size, done, text, isHere, sending }) {
  const item = document.createElement("li");
  const head = element(isHere ? "button" : "span", name);
  head.className = "name";
  if (isHere) {
    head.dataset.upload = id;
    head.setAttribute("aria-current", String(place.id === id));
    head.onclick = () => place.open(id);
  }
  item.append(head, element("small", text));
  if (!isHere) {
    const bar = document.createElement("progress");
    bar.max = size;
    bar.value = done;
    bar.setAttribute("aria-label", `Progress of ${name}`);
    item.append(bar);
  }
  const row = document.createElement("div");
  row.className = "row";
  if (isHere && uploads.here.filter((each) => each.state === "whole").length > 1) {
    const label = document.createElement("label"), tick = document.createElement("input");
    tick.type = "checkbox";
    tick.checked = uploads.views.has(id);
    tick.dataset.view = id;
    tick.setAttribute("aria-label", `${name} is a view to be joined`);
    tick.onchange = () => {
      if (tick.checked) uploads.views.add(id);
      else uploads.views.delete(id);
      showJoin();
    };
    label.append(tick, " a view");
    row.append(label);
  }
  if (sending) {
    const stop = element("button", "Interrupt");
    stop.setAttribute("aria-label", `Interrupt ${name}`);
    stop.onclick = () => (sending.isStopped = true);
    row.append(stop);
  } else {
    const discard = element("button", "Discard");
    discard.setAttribute("aria-label", `Discard ${name}`);
    discard.onclick = () => place.discard(id, name);
    row.append(discard);
  }
  item.append(row);
  return item;
}

// Views of one object, in any pose, become one scan.
// Those that are ticked and here as a whole, in the order of the list.
const viewsToJoin = () => uploads.here.filter((each) => uploads.views.has(each.id) && each.state === "whole").map((each) => each.id);

function showJoin() {
  const count = viewsToJoin().length;
  byId("join").hidden = count < 2 || uploads.isJoining;
  byId("join").textContent = `Join the ${count} views`;
}

async function joinViews() {
  const [id, ...others] = viewsToJoin();
  const say = (text) => (byId("upload-answer").textContent = text);
  uploads.isJoining = true;
  showJoin();
  try {
    let view = await post(`/v1/uploads/${id}/join`, { with: others });
    while (view.joining.state === "working") {
      say(`joining: ${view.joining.stage || "waiting"}${view.joining.share ? `, ${Math.round(100 * view.joining.share)} %` : ""}`);
      await pause(300);
      view = await get(`/v1/uploads/${id}`);
    }
    if (view.joining.state !== "done") throw new Error(view.joining.why || "nothing was joined");
    say([`${view.joining.result.views} views joined`, ...view.joining.result.notes].join("; "));
    uploads.views.clear();
    await refreshUploads();
    place.open(view.joining.result.id);
  } catch (error) {
    say(error.message);
  }
  uploads.isJoining = false;
  showJoin();
}

function showUploads() {
  const list = byId("uploads"), focused = document.activeElement?.dataset?.upload;
  const sent = [...uploads.sending.values()];
  const items = sent.map((s) => uploadItem({ name: s.name, size: s.size, done: s.done, text: s.text, sending: s }));
  for (const each of uploads.here) {
    if (sent.some((s) => s.id === each.id)) continue;
    const isHere = each.state === "whole" || each.state === "checking";
    const share = Math.round((100 * each.received_bytes) / each.size_bytes);
    items.push(uploadItem({ id: each.id, name: each.name, size: each.size_bytes, done: each.received_bytes, isHere,
      text: isHere ? sizeText(each.size_bytes) : each.state === "refused" ? "did not arrive as it was announced; choose the file again" : `interrupted at ${share} %; choose the same file again and it goes on` }));
  }
  list.replaceChildren(...items);
  if (focused) list.querySelector(`[data-upload="${focused}"]`)?.focus();
  showJoin();
}

(() => {
  const drop = byId("drop"), input = byId("scan-file");
  byId("join").onclick = joinViews;
  input.onchange = () => {
    const files = [...input.files];
    uploadAll(files).then(() => (input.value = ""));
  };
  for (const type of ["dragenter", "dragover"])
    document.addEventListener(type, (e) => {
      e.preventDefault();
      drop.classList.add("over");
    });
  document.addEventListener("dragleave", (e) => e.relatedTarget || drop.classList.remove("over"));
  document.addEventListener("drop", (e) => {
    e.preventDefault();
    drop.classList.remove("over");
    if (e.dataTransfer?.files.length) uploadAll([...e.dataTransfer.files]);
  });
})();
